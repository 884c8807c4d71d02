# SPDX-License-Identifier: Apache-2.0
"""Fixtures for the buses: the scripted far end of the drivers' tests."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "devices"))
from scripted_fixtures import encoder_end, wire  # noqa: F401
