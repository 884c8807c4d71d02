# SPDX-License-Identifier: Apache-2.0
"""Makes a readable copy of a bag that was cut off or damaged; the original is never touched."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from .bag import METADATA_FILE, RECOVERED, Bag, BagError
from .bag_files import files_of, name_of, readable
from .records import File, noted

ENDING = "_recovered"


class Recovered(NamedTuple):
    """Result of `recover`.

    folder: of the new bag; messages: in it; problems: what could not be read; missing: messages
    that the bag states and the copy has not.
    """

    folder: Path
    messages: int
    problems: list[str]
    missing: int = 0


def recover(bag: Path | str, out: Path | str | None = None) -> Recovered:
    """Copy the messages of every whole record and the notes into the new bag NAME_recovered.

    out: folder of the new bag's folder, by default that of `bag`. Raises BagError if `bag` is no
    bag or the copy cannot be written: then none is left.
    """
    files = [File(path) for path in files_of(bag)]
    told, problems = readable(bag)
    parent = Path(out) if out is not None else Path(bag).resolve().parent
    copy = Bag(parent / (name_of(bag) + ENDING))
    try:
        channels: dict[str, int] = {}
        for file in files:
            for topic, message in file.messages():
                if topic.name not in channels:
                    channels[topic.name] = copy.add_topic(topic)
                copy.write([message._replace(channel=channels[topic.name])])
                if copy.held_reason:  # what waits for room would fill the memory
                    raise BagError(f"the copy cannot be written: {copy.held_reason}")
            for topic in file.topics.values():
                if topic.name not in channels:
                    channels[topic.name] = copy.add_topic(topic)
            problems += file.problems
        if not (channels and (copy.written or not problems)):
            raise BagError(f"nothing in {bag} can be read: {'; '.join(problems) or 'it is empty'}")
        for name, values in noted(told, files).items():
            copy.note(name, {key: str(value) for key, value in values.items()})
        copy.close(RECOVERED)
    except BaseException:
        shutil.rmtree(copy.folder)
        raise
    missing = max(0, _stated(told, files) - copy.message_count)
    if missing:
        problems.append(
            f"the bag states {missing + copy.message_count} messages, the copy has "
            f"{copy.message_count}"
        )
    return Recovered(copy.folder, copy.message_count, problems, missing)


def _stated(told: Mapping[str, Any], files: Sequence[File]) -> int:
    """Return how many messages metadata.yaml or the files' indexes state, whichever are more."""
    counts = told.get("topics_with_message_count", {}).values()
    listed = sum(count for count in counts if isinstance(count, int))
    return max(listed, sum(max(file.stated or 0, file.read) for file in files))


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
