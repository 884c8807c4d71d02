# SPDX-License-Identifier: Apache-2.0
"""Settings of the bag's writer and session."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from screw_module_ros.settings import Setting


class StorageSettings(NamedTuple):
    """Storage settings, like rosbag2's `zstd_fast`; changes apply to the next recording."""

    chunk_size: Annotated[
        int,
        Setting(
            "uncompressed size at which a chunk is closed", "B", 1024, 2**26, live=True
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
            "longest time until a message is on the disk", "s", 0.1, 1.0, live=True
        ),
    ] = 0.8
    max_file_duration: Annotated[
        float,
        Setting(
            "duration after which a new file of the bag begins, 0 = never", "s", 0.0, live=True
        ),
    ] = 1800.0
    max_cache: Annotated[
        int,
        Setting(
            "memory for messages waiting for the disk; more are dropped and counted",
            "B",
            2**20,
            2**33,
            live=True,
        ),
    ] = 100 * 2**20
    min_free_space: Annotated[
        int,
        Setting(
            "free disk space below which the recording is closed",
            "B",
            0,
            2**40,
            live=True,
        ),
    ] = 50 * 2**20
