# SPDX-License-Identifier: Apache-2.0
"""The commands of therapy sessions beside a running robot; with a real bag see test/nodes."""

from __future__ import annotations

import pytest

from screw_module_ros.recording.pseudonym import checked_pseudonym
from screw_module_ros.session_command import main


def test_new_prints_a_pseudonym(capsys):
    assert main(["new"]) == 0
    assert checked_pseudonym(capsys.readouterr().out.strip())


@pytest.mark.parametrize(
    "command", [["verify"], ["replay"], ["report", "--out"], ["export", "--out"]]
)
def test_a_folder_that_is_no_bag_is_said_so(command, tmp_path, capsys):
    extra = [str(tmp_path / "out")] if "--out" in command else []
    assert main([*command, *extra, str(tmp_path / "nothing")]) == 1
    assert capsys.readouterr().err == f"session: there is no bag {tmp_path / 'nothing'}\n"
    assert not (tmp_path / "out").exists(), "nothing is made of nothing"


def test_reports_need_a_place(tmp_path, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["report", str(tmp_path)])
    assert ended.value.code == 2
    assert "--out" in capsys.readouterr().err
