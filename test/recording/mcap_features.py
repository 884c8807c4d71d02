# SPDX-License-Identifier: Apache-2.0
"""MCAP files as other recorders write them: the messages of a bag in each layout of the format.

They are written by the mcap library, and what it does not write is changed in its bytes. Nothing of
the recorder's own code is used.
"""

from __future__ import annotations

import shutil
import struct
from collections.abc import Callable
from pathlib import Path

import yaml
import zstandard
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType, Writer

NONE, LZ4, ZSTD = CompressionType.NONE, CompressionType.LZ4, CompressionType.ZSTD
WRITERS: dict[str, dict] = {
    "chunked": {"compression": NONE},
    "lz4": {"compression": LZ4},
    "zstd": {"compression": ZSTD},
    "not chunked": {"use_chunking": False},
    "no checksums": {"enable_crcs": False},
    "a checksum of all data": {"enable_data_crcs": True},
    "no index": {"index_types": IndexType.NONE},
    "no index of messages": {"index_types": IndexType.CHUNK},
    "no summary": {
        "index_types": IndexType.NONE, "repeat_channels": False, "repeat_schemas": False,
        "use_statistics": False, "use_summary_offsets": False,
    },
    "no statistics": {"use_statistics": False},
    "no repeated declarations": {"repeat_channels": False, "repeat_schemas": False},
    "not chunked, no summary": {
        "use_chunking": False, "index_types": IndexType.NONE, "repeat_channels": False,
        "repeat_schemas": False, "use_statistics": False, "use_summary_offsets": False,
    },
}  # fmt: skip


def _copied(source: Path, target: Path, **options) -> None:
    """Write the messages of a file into another, with these options of the library's writer."""
    with source.open("rb") as given, target.open("wb") as file:
        reader, writer = make_reader(given), Writer(file, chunk_size=4000, **options)
        writer.start("ros2", "another recorder")
        channels: dict[int, int] = {}
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            if channel.id not in channels:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, number, channel.metadata
                )
            writer.add_message(
                channels[channel.id], message.log_time, message.data, message.publish_time,
                message.sequence,
            )  # fmt: skip
        writer.finish()


def _mixed(source: Path, target: Path) -> None:
    """The first half in chunks, the other half outside of them, after them."""
    _copied(source, target)
    content = target.read_bytes()
    _, chunks = _chunks(content)
    loose = b"".join(_content(content, place) for place in chunks[len(chunks) // 2 :])
    kept = content[: chunks[len(chunks) // 2]]
    target.write_bytes(kept + loose + _data_end() + _footer())


def _chunks(content: bytes) -> tuple[int, list[int]]:
    """Return the end of the data, and the places of the chunks in them."""
    place, found = 8, []
    while content[place] != 0x0F:
        if content[place] == 6:
            found.append(place)
        place += 9 + struct.unpack_from("<Q", content, place + 1)[0]
    return place, found


def _content(content: bytes, place: int) -> bytes:
    (named,) = struct.unpack_from("<I", content, place + 9 + 28)
    at = place + 9 + 32 + named
    (length,) = struct.unpack_from("<Q", content, at)
    return zstandard.decompress(content[at + 8 : at + 8 + length])


def _data_end() -> bytes:
    return struct.pack("<BQI", 0x0F, 4, 0)


def _footer() -> bytes:
    return struct.pack("<BQQQI", 2, 20, 0, 0, 0) + b"\x89MCAP0\r\n"


def _disagreeing(by: int) -> Callable[[Path, Path], None]:
    """Statistics that state more or fewer messages; their checksum is left out, as it may be."""

    def write(source: Path, target: Path) -> None:
        _copied(source, target)
        content = bytearray(target.read_bytes())
        end, _ = _chunks(content)
        place = end + 13
        while content[place] != 0x0B:
            place += 9 + struct.unpack_from("<Q", content, place + 1)[0]
        (count,) = struct.unpack_from("<Q", content, place + 9)
        struct.pack_into("<Q", content, place + 9, count + by)
        struct.pack_into("<I", content, len(content) - 12, 0)
        target.write_bytes(content)

    return write


def _packed(source: Path, target: Path) -> None:
    """The whole file compressed, as rosbag2 does with compression_mode FILE."""
    packer, content = zstandard.ZstdCompressor().compressobj(), source.read_bytes()
    parts = (content[at : at + 5000] for at in range(0, len(content), 5000))
    flush = zstandard.COMPRESSOBJ_FLUSH_BLOCK
    packed = [packer.compress(part) + packer.flush(flush) for part in parts]
    target.write_bytes(b"".join(packed) + packer.flush())


def _packed_messages(source: Path, target: Path) -> None:
    """Each message compressed, as rosbag2 does with compression_mode MESSAGE."""
    with source.open("rb") as given, target.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2", "another recorder")
        channels: dict[int, int] = {}
        for schema, channel, message in make_reader(given).iter_messages(log_time_order=False):
            if channel.id not in channels:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, number, channel.metadata
                )
            data = zstandard.compress(message.data)
            times = message.log_time, data, message.publish_time
            writer.add_message(channels[channel.id], *times, message.sequence)
        writer.finish()


FEATURES: dict[str, Callable[[Path, Path], None]] = {
    **{
        name: (lambda source, target, options=options: _copied(source, target, **options))
        for name, options in WRITERS.items()
    },
    "mixed": _mixed,
    "each message compressed": _packed_messages,
    "states too many": _disagreeing(+7),
    "states too few": _disagreeing(-7),
}
SHORT = {"states too many"}
"""Of which less can be read than they state."""


def _bag(folder: Path, name: str, file: Path, **changes) -> Path:
    """Make a bag of a file: a folder with the metadata.yaml of another recorder."""
    folder.mkdir()
    shutil.copy(file, folder / name)
    told = {
        "version": 9, "storage_identifier": "mcap", "duration": {"nanoseconds": 0},
        "starting_time": {"nanoseconds_since_epoch": 0}, "message_count": 0,
        "topics_with_message_count": [], "compression_format": "", "compression_mode": "",
        "relative_file_paths": [name], "custom_data": None, "ros_distro": "jazzy", **changes,
    }  # fmt: skip
    text = yaml.safe_dump({"rosbag2_bagfile_information": told})
    (folder / "metadata.yaml").write_text(text)
    return folder


def _bare(place: Path, file: Path) -> Path:
    return Path(shutil.copy(file, place / "session.mcap"))


def _bare_packed(place: Path, file: Path) -> Path:
    _packed(file, place / "session.mcap.zstd")
    return place / "session.mcap.zstd"


def _in_folder(name: str) -> Callable[[Path, Path], Path]:
    def make(place: Path, file: Path) -> Path:
        (place / "session").mkdir()
        shutil.copy(file, place / "session" / name)
        return place / "session"

    return make


def _compressed_bag(place: Path, file: Path) -> Path:
    _packed(file, place / "packed")
    return _bag(place / "session", "session_0.mcap.zstd", place / "packed",
                compression_format="zstd", compression_mode="FILE")  # fmt: skip


def _played_bag(place: Path, file: Path) -> Path:
    """`ros2 bag play` has unpacked the file beside the compressed one."""
    bag = _compressed_bag(place, file)
    shutil.copy(file, bag / "session_0.mcap")
    return bag


PLACES: dict[str, Callable[[Path, Path], Path]] = {
    "a bag": lambda place, file: _bag(place / "session", "session_0.mcap", file),
    "a file of another name": lambda place, file: _bag(place / "session", "mine.mcap", file),
    "no storage identifier": lambda place, file: _bag(
        place / "session", "session_0.mcap", file, storage_identifier=""
    ),
    "a path below the bag": lambda place, file: _bag(
        place / "session", "session_0.mcap", file, relative_file_paths=["session/session_0.mcap"]
    ),
    "no metadata.yaml": _in_folder("session_0.mcap"),
    "no metadata.yaml, no number": _in_folder("NAME.mcap"),
    "a bare file": _bare,
    "a bare compressed file": _bare_packed,
    "a compressed file": _compressed_bag,
    "a compressed file that was played": _played_bag,
}
"""How the file of a bag may lie: functions of a folder and a file that return the bag."""
