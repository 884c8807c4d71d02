# SPDX-License-Identifier: Apache-2.0
"""How a bag is stored: the settings of writer and session, with units and bounds."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from screw_module_ros.settings import Setting


class StorageSettings(NamedTuple):
    """Storage preset, like rosbag2's `zstd_fast`; changes count from the next recording."""

    chunk_size: Annotated[
        int,
        Setting(
            "a chunk is closed when it holds this much, uncompressed", "B", 1024, 2**26, live=True
        ),
    ] = 786_432
    compression: Annotated[
        str, Setting("compression of the chunks", "", choices=("zstd", "none"), live=True)
    ] = "zstd"
    compression_level: Annotated[
        int, Setting("zstd level, higher is smaller and slower", "", 1, 19, live=True)
    ] = 1
    flush_period: Annotated[
        float,
        Setting(
            "after this time at the latest a message is safe on the disk", "s", 0.1, 1.0, live=True
        ),
    ] = 0.8
    max_file_duration: Annotated[
        float,
        Setting(
            "a new file of the same bag begins after this time, 0 for never", "s", 0.0, live=True
        ),
    ] = 1800.0
    max_cache: Annotated[
        int,
        Setting(
            "messages waiting for the disk, beyond it they are dropped and counted",
            "B",
            2**20,
            2**33,
            live=True,
        ),
    ] = 100 * 2**20
    min_free_space: Annotated[
        int,
        Setting(
            "recording stops in good order when the disk has less than this left",
            "B",
            0,
            2**40,
            live=True,
        ),
    ] = 50 * 2**20
