# SPDX-License-Identifier: Apache-2.0
"""Forgets a patient, and carries a record in one file: to a backup, another computer or robot."""

from __future__ import annotations

import os
import shutil
import tempfile
import time
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath

from ..files import PRIVATE_FOLDER, owner_only
from ..recording.bag import BagError
from . import arm_weights
from .record import ACCESS, Record, alone, digest, sources
from .scores import ENDING, keep_scores, scores_in

BEYOND_REACH = (
    "backups, and copies of bags, reports and exports anywhere else; what was printed",
    "exports with another pseudonym, and those of more than a year ago or of no record",
    "the list of patients on paper; what browsers hold and have saved",
    "blocks of the disk that were freed and not yet written again",
)
"""What `forget` cannot delete."""


def logs_with(text: str) -> list[Path]:
    """Return the log files of ROS in which a text stands."""
    folder = os.environ.get("ROS_LOG_DIR") or Path(os.environ.get("ROS_HOME", "~/.ros"), "log")
    found = sorted(Path(folder).expanduser().rglob("*.log"))
    return [path for path in found if text.encode() in path.read_bytes()]


def of_patient(record: Record, folder: Path, pseudonym: str) -> tuple[list[Path], list[Path]]:
    """Return what is of a patient alone, bags, scores, reports and exports.

    And what names him and holds others too: shared bags, logs.
    """
    told = record.base.execute("SELECT DISTINCT source, pseudonym FROM session").fetchall()
    own = {source for source, of in told if of == pseudonym}
    others = {source for source, of in told if of != pseudonym}
    named = {path.name for path in folder.glob(f"{pseudonym}*")}
    places = record.base.execute("SELECT DISTINCT place FROM kept.access WHERE place != ''")
    made = [path for (place,) in places if (path := Path(place, pseudonym)).exists()]
    shared = [folder / name for name in sorted((own | named) & others)]
    of_him = [folder / name for name in sorted((own | named) - others)]
    return [*of_him, *made], [*shared, *logs_with(pseudonym)]


def forget(record: Record, folder: Path, pseudonym: str) -> None:
    """Delete what `of_patient` returns first, the weights of his arms, and his rows everywhere.

    A digest stays, so that a bag of his that comes back does not count. Raises OSError, also
    `WeightsError`; then the rest is still there, and it can be done again.
    """
    own, _ = of_patient(record, folder, pseudonym)
    with alone(folder):
        arm_weights.forget(arm_weights.weights_file(), pseudonym)
        for path in own:
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path)
            else:
                path.unlink()
        with record.writing():
            for path in own:
                record.base.execute("DELETE FROM source WHERE name = ?", (path.name,))
            for where in ("session WHERE", "score WHERE", "kept.access WHERE instr(place, ?1) OR"):
                record.base.execute(f"DELETE FROM {where} pseudonym = ?1", (pseudonym,))
            record.base.execute("INSERT OR REPLACE INTO kept.forgotten VALUES (?, ?)",
                                (digest(pseudonym), int(time.time())))  # fmt: skip
        for schema in ("main", "kept"):
            record.base.execute(f"VACUUM {schema}")


def back_up(record: Record, folder: Path, file: Path, pseudonym: str = "") -> int:
    """Write the sources of a record, or those of a patient alone, into one file; return how many.

    All of them, with who read what and who was forgotten, if no patient is named. An existing file
    is never overwritten. Raises OSError.
    """
    own, _ = of_patient(record, folder, pseudonym)
    kept = [path for path in sources(folder) if not pseudonym or path in own]
    files = [] if pseudonym else [folder / ACCESS]
    for path in kept:
        files += sorted(path.iterdir()) if path.is_dir() else [path]
    beside = file.with_name(f".{file.name}.{os.getpid()}.tmp")
    try:
        with open(beside, "xb", opener=owner_only) as raw, zipfile.ZipFile(raw, "w") as packed:
            for each in files:
                packed.write(each, each.relative_to(folder))
        os.link(beside, file)  # fails where it is there
    finally:
        beside.unlink(missing_ok=True)
    return len(kept)


def restore(record: Record, folder: Path, file: Path) -> int:
    """Put what is in a backup into a folder, beside what is there; return how many bags came.

    A bag that is there stays as it is, scores are put together, and nothing comes of a patient who
    was forgotten in one of both. Raises BagError for a damaged file, OSError.
    """
    with alone(folder), _unpacked(folder, file) as unpacked:
        if (unpacked / ACCESS).exists():
            record.base.execute("ATTACH ? AS other", (str(unpacked / ACCESS),))
            with record.writing():
                for table in ("access", "forgotten"):
                    news = f"SELECT * FROM other.{table} EXCEPT SELECT * FROM kept.{table}"
                    record.base.execute(f"INSERT OR IGNORE INTO kept.{table} {news}")
                told = record.base.execute("SELECT DISTINCT pseudonym FROM kept.access").fetchall()
                for (of,) in told:
                    if record.is_forgotten(of):
                        record.base.execute("DELETE FROM kept.access WHERE pseudonym = ?", (of,))
            record.base.execute("DETACH other")
        came = 0
        for path in sources(unpacked):
            pseudonym = path.name[:7]
            if record.is_forgotten(pseudonym):
                record.notes.append(f"{path.name}: its patient was forgotten: left out")
            elif path.name.endswith(ENDING):
                keep_scores(folder, pseudonym, scores_in(path))
            elif not (folder / path.name).exists():
                path.rename(folder / path.name)
                came += 1
        return came


@contextmanager
def _unpacked(folder: Path, file: Path) -> Iterator[Path]:
    """Unpack a backup beside the bags, for its owner alone, until the end."""
    place = Path(tempfile.mkdtemp(dir=folder, prefix=".restored_"))
    try:
        with zipfile.ZipFile(file) as packed:
            for name in packed.namelist():
                parts = PurePosixPath(name).parts
                if len(parts) not in (1, 2) or any(part.startswith(("/", ".")) for part in parts):
                    raise zipfile.BadZipFile(f"it holds {name!r}")
                into = place / name
                into.parent.mkdir(mode=PRIVATE_FOLDER, exist_ok=True)
                with packed.open(name) as source, open(into, "xb", opener=owner_only) as target:
                    shutil.copyfileobj(source, target)
        yield place
    except zipfile.BadZipFile as error:
        raise BagError(f"{file} is no whole backup: {error}") from None
    finally:
        shutil.rmtree(place)
