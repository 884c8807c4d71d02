# SPDX-License-Identifier: Apache-2.0
"""Property tests may use each other's strategies, the scripted devices and the bench."""

from __future__ import annotations

import sys
from pathlib import Path

_HERE = Path(__file__).parent
for folder in (_HERE, _HERE.parent / "devices", _HERE.parent / "loop"):
    sys.path.insert(0, str(folder))
