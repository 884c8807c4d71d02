# SPDX-License-Identifier: Apache-2.0
"""The files of a bag, however it is named and whoever wrote it; the one place that finds them.

A bag is a folder, with metadata.yaml or without, or a single file. Its files are `NAME_0.mcap`,
`NAME_1.mcap` and so on, or one `NAME.mcap`; rosbag2's compression of whole files appends `.zstd`.
`storage_identifier` is not asked: some recorders leave it empty, and the content tells.
"""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, NamedTuple

import yaml
import zstandard

from .bag import METADATA_FILE, BagError

ZSTD = b"\x28\xb5\x2f\xfd"
"""The first bytes of what zstd has compressed."""
_NAME = re.compile(r"(?P<stem>.+?)(?:_(?P<number>\d+))?\.mcap(?:\.zstd?)?")
_OTHER = (".db3", ".db3.zstd", ".bag")
_BLOCK = 2**20


class Opened(NamedTuple):
    """The content of a file: file, size [B], and what is wrong with its compression, or empty."""

    file: IO[bytes]
    size: int
    problem: str


def name_of(bag: Path | str) -> str:
    """Return the name of a bag: of its folder, or of its file without the endings."""
    path = Path(bag).resolve()
    found = _NAME.fullmatch(path.name)
    return path.name.removesuffix(".zstd").removesuffix(".mcap") if found else path.name


def files_of(bag: Path | str) -> list[Path]:
    """Return the MCAP files of a bag in the order of recording.

    That is the order of metadata.yaml, else of the numbers in the names. Hidden files are not its
    own: other systems add some when they copy, like `._NAME_0.mcap`. Raises BagError if there is no
    bag, or if it is not clear which files are one.
    """
    path = Path(bag)
    if not path.exists():
        raise BagError(f"there is no bag {bag}")
    if path.is_file():
        return [path]
    found = {
        each: match
        for each in sorted(path.iterdir())
        if (match := _NAME.fullmatch(each.name)) and not each.name.startswith(".")
    }
    told, _ = readable(path)
    place = {name: number for number, name in enumerate(told.get("relative_file_paths", ()))}
    for each in list(found):  # a player unpacks NAME_0.mcap beside NAME_0.mcap.zstd, and leaves it
        packed = next((p for p in found if p != each and p.name.startswith(f"{each.name}.")), None)
        if packed is not None:
            found.pop(each if packed.name in place and each.name not in place else packed)
    if not found:
        raise BagError(_no_bag(path))
    stems = {match["stem"] for match in found.values()}
    if len(stems) > 1 and not any(each.name in place for each in found):
        names = ", ".join(each.name for each in found)
        raise BagError(f"{bag} holds {len(stems)} recordings ({names}): name one of the files")
    last = len(place)
    return sorted(
        found,
        key=lambda each: (place.get(each.name, last), int(found[each]["number"] or 0), each.name),
    )


def _no_bag(folder: Path) -> str:
    other = next((each.name for each in sorted(folder.iterdir()) if each.name.endswith(_OTHER)), "")
    if other:
        return (
            f"{folder} holds {other}, which is no MCAP file: convert it first (ros2 bag convert, "
            "with storage_id: mcap)"
        )
    return f"{folder} is no bag folder: it holds no MCAP file, like NAME_0.mcap"


def information(bag: Path | str) -> dict[str, Any]:
    """Return the content of metadata.yaml, empty without the file. Raises BagError.

    `custom_data`, `relative_file_paths` and `topics_with_message_count` are there if it is one. A
    single file has none: the one beside it is that of the whole bag.
    """
    path = Path(bag) / METADATA_FILE
    try:
        found = dict(yaml.safe_load(path.read_text("utf-8"))["rosbag2_bagfile_information"])
        found["custom_data"] = dict(found.get("custom_data") or {})
        paths = found["relative_file_paths"]  # older ones stand below the bag's folder
        found["relative_file_paths"] = [Path(str(name)).name for name in paths]
        found["topics_with_message_count"] = {
            line["topic_metadata"]["name"]: line["message_count"]
            for line in found["topics_with_message_count"]
        }
        return found
    except (FileNotFoundError, NotADirectoryError):
        return {}
    except (OSError, ValueError, TypeError, KeyError, RecursionError, yaml.YAMLError) as error:
        raise BagError(f"{METADATA_FILE} cannot be read: {type(error).__name__}") from None


def readable(bag: Path | str) -> tuple[dict[str, Any], list[str]]:
    """Return the content of metadata.yaml, empty without a readable one, and what is wrong."""
    try:
        return information(bag), []
    except BagError as error:
        return {}, [str(error)]


@contextmanager
def opened(path: Path) -> Iterator[Opened]:
    """Open a file of a bag; one that is compressed as a whole is unpacked into a temporary file.

    The temporary file has no name, so that nobody else can open it. Raises BagError if the disk
    cannot be read.
    """
    try:
        with open(path, "rb") as file:
            if file.read(len(ZSTD)) != ZSTD:
                yield Opened(file, os.fstat(file.fileno()).st_size, "")
                return
            file.seek(0)
            with tempfile.TemporaryFile() as unpacked:
                problem = _unpack(file, unpacked)
                yield Opened(unpacked, unpacked.tell(), problem)
    except OSError as error:
        raise BagError(f"{path.name} cannot be read: {error.strerror}") from None


def _unpack(packed: IO[bytes], into: IO[bytes]) -> str:
    """Decompress as far as possible; return why it ends early, or empty."""
    frame = zstandard.ZstdDecompressor().decompressobj()
    try:
        while block := packed.read(_BLOCK):
            while block:
                into.write(frame.decompress(block))
                block = frame.unused_data if frame.eof else b""
                if block:
                    frame = zstandard.ZstdDecompressor().decompressobj()
    except zstandard.ZstdError as error:
        return f"its compression is damaged: {error}"
    return "" if frame.eof else "its compression is cut off"
