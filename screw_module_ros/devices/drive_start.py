# SPDX-License-Identifier: Apache-2.0
"""Start of drives that share a bus: never one whose guards may be disarmed.

`drive_exit` disarms the guards, and while nobody reads the bus a drive may restart unseen: such a
drive is configured anew before it starts.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .drive import Drive


def start(drives: Sequence[Drive]) -> list[Drive]:
    """Start all drives, disabled; return those that had to be configured anew. Blocking then.

    Raises as `Drive.configure` and `Drive.start`; all are configured before any is started.
    """
    anew = [drive for drive in drives if not drive.configured]
    for drive in anew:
        drive.configure()
    for drive in drives:
        drive.start()
    return anew
