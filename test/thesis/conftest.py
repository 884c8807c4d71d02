# SPDX-License-Identifier: Apache-2.0
"""Without what runs notebooks, which rosdep does not install, their tests are left out."""

from __future__ import annotations

from importlib.util import find_spec

collect_ignore = [] if find_spec("nbclient") and find_spec("ipykernel") else ["test_notebooks.py"]
