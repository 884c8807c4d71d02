# SPDX-License-Identifier: Apache-2.0
"""The far side of the bus shares nothing with the project: no rig, no profile, no codec."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
NEAR = {"near_end", "conftest"}
FAR = sorted(
    file.stem
    for file in HERE.glob("*.py")
    if file.stem not in NEAR and not file.stem.startswith("test_")
)
_LOADED = (
    "import importlib, sys; sys.path.insert(0, sys.argv[1]); importlib.import_module(sys.argv[2]);"
    "print([name for name in sys.modules if name.split('.')[0] == 'screw_module_ros'])"
)


@pytest.mark.parametrize("module", FAR)
def test_a_device_imports_nothing_of_this_project(module):
    if module == "durand_device":
        pytest.importorskip("durand", reason="durand is not installed: see requirements/dev.txt")
    done = subprocess.run(
        [sys.executable, "-c", _LOADED, str(HERE), module], capture_output=True, text=True,
        check=True,
    )  # fmt: skip
    assert done.stdout.strip() == "[]"
