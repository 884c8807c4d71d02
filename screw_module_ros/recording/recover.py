# SPDX-License-Identifier: Apache-2.0
"""Makes a readable copy of a bag that was cut off or damaged; the original is never touched."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import NamedTuple

from .bag import METADATA_FILE, RECOVERED, Bag, BagError, Message
from .records import File, files_of, information, noted

ENDING = "_recovered"


class Recovered(NamedTuple):
    """Result of `recover`: the new bag, its messages, and what could not be read."""

    folder: Path
    messages: int
    problems: list[str]


def recover(bag: Path | str) -> Recovered:
    """Copy the messages of every whole chunk and the notes into the new bag NAME_recovered.

    Raises BagError if `bag` is no bag or the copy cannot be written: then none is left.
    """
    folder = Path(bag).resolve()
    files = [File(path) for path in files_of(folder)]
    problems: list[str] = []
    try:
        told = information(folder)
    except BagError as error:
        told = {}
        problems.append(str(error))
    copy = Bag(folder.with_name(folder.name + ENDING))
    try:
        channels: dict[str, int] = {}
        for file in files:
            for topic, message in file.messages():
                if topic.name not in channels:
                    channels[topic.name] = copy.add_topic(topic)
                times = message.log_time, message.publish_time
                channel = channels[topic.name]
                copy.write([Message(channel, *times, message.sequence, message.data)])
            for topic in file.topics.values():
                if topic.name not in channels:
                    channels[topic.name] = copy.add_topic(topic)
            problems += file.problems
        if not channels:
            raise BagError(f"nothing in {folder} can be read: {'; '.join(problems)}")
        for name, values in noted(told, files).items():
            copy.note(name, {key: str(value) for key, value in values.items()})
        copy.close(RECOVERED)
    except BaseException:
        shutil.rmtree(copy.folder)
        raise
    return Recovered(copy.folder, copy.message_count, problems)


def bag_names(parent: Path, begin: str) -> set[str]:
    """Return the names of the bags directly below `parent` that begin so, recovered ones once.

    None while there is no such folder. Raises OSError if it cannot be read.
    """
    if not parent.exists():
        return set()
    found = (path for path in parent.iterdir() if path.name.startswith(begin) and path.is_dir())
    return {path.name.removesuffix(ENDING) for path in found}


def unfinished(parent: Path) -> list[Path]:
    """Return the bags directly below `parent` whose recorder ended without closing them."""
    return [
        path.parent
        for path in sorted(parent.glob("[!.]*/[!.]*_0.mcap"))
        if not (path.parent / METADATA_FILE).exists()
        and not path.parent.with_name(path.parent.name + ENDING).exists()
    ]
