# SPDX-License-Identifier: Apache-2.0
"""The tests of this folder share the simulated patients."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
