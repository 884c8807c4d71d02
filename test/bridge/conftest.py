# SPDX-License-Identifier: Apache-2.0
"""The tests of this folder share a robot without ROS, and pages without a browser."""

from __future__ import annotations

import json
import shutil
import subprocess

import pytest
from fake_gateway import FakeGateway
from page_modules import node_program

from screw_module_ros.bridge.pages import FOLDER


@pytest.fixture
def gateway():
    return FakeGateway()


@pytest.fixture
def result_of(tmp_path):
    """Return a function that gives the value of `result` at the end of a script."""
    program = node_program()
    if program is None:
        pytest.skip("neither Playwright nor Node is installed")
    shutil.copytree(FOLDER / "js", tmp_path / "js")
    (tmp_path / "package.json").write_text('{"type": "module"}')

    def run(script: str):
        file = tmp_path / "script.js"
        file.write_text(f"{script}\nconsole.log(JSON.stringify(result));\n")
        ended = subprocess.run(
            [program, str(file)], check=False, capture_output=True, text=True, timeout=60
        )
        assert ended.returncode == 0, ended.stderr
        return json.loads(ended.stdout)

    return run
