# SPDX-License-Identifier: Apache-2.0
"""What files of gain limits share: the parameters of a node that keeps to one, their checksum."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Annotated, NamedTuple

from ..settings import Setting
from ..settings_file import read_text

_CHECKSUM = "sha256: "


class GainLimitsSettings(NamedTuple):
    """Parameters of a node that keeps to a module's gain limits."""

    gain_limits_file: Annotated[
        str, Setting("gain limits of a linear model of the module, empty for none",
                     formerly="certificate_file")
    ] = ""
    gain_limits_required: Annotated[
        bool, Setting("refuse modes with force feedback or observer without gain limits",
                      formerly="certificate_required")
    ] = True
    beyond_gain_limits: Annotated[
        bool, Setting("also take force gains beyond the gain limits and their conditions; or "
                      "without limits, where they are required", formerly="uncertified_gains")
    ] = False


def text_checksum(text: str) -> str:
    """Return the checksum of a file's text before its last line."""
    return hashlib.sha256(text.encode()).hexdigest()


def was_changed(path: str | Path, checksum: str) -> bool:
    """Return whether a file is another than the one with that checksum. Raises SettingError."""
    return checksum != text_checksum(read_text(path).rpartition(_CHECKSUM)[0])
