# SPDX-License-Identifier: Apache-2.0
"""Names from the network lead to no place outside of the folder that was given."""

from __future__ import annotations

import pytest

from screw_module_ros.nodes.support.place import below, one_name, root_folder


def test_names_below_are_taken(tmp_path):
    root = root_folder(str(tmp_path))
    assert below(root, "a/b", "folder") == root / "a/b"
    assert below(root, str(root / "a"), "folder") == root / "a"
    assert below(root, "a/../b", "folder") == root / "b"


@pytest.mark.parametrize(
    "name", ["..", "../x", "/etc", "a/../../x", "link/x", "link", "~/../../x"]
)
def test_names_that_lead_out_are_refused(tmp_path, name):
    root = tmp_path / "root"
    root.mkdir()
    (root / "link").symlink_to(tmp_path)
    with pytest.raises(ValueError, match="lies outside of"):
        below(root, name, "folder")


def test_no_path_at_all(tmp_path):
    with pytest.raises(ValueError, match="is no path"):
        below(tmp_path, "a\0b", "folder")


@pytest.mark.parametrize("name", ["", ".", "..", "../x", "/abs", "a/b", "a\0b", "a\nb"])
def test_what_is_no_plain_name(name):
    with pytest.raises(ValueError, match="no plain name"):
        one_name(name, "name")


def test_a_plain_name():
    assert one_name("Sitzung 3 (früh)", "name") == "Sitzung 3 (früh)"


def test_a_home_that_nobody_has():
    with pytest.raises(ValueError, match="cannot use folder"):
        root_folder("~nobody_of_this_name/x")
