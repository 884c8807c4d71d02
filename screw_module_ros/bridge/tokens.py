# SPDX-License-Identifier: Apache-2.0
"""The two tokens: random, in a file that only its owner can read.

They survive the bridge's process, so that pages reconnect after a restart of the bridge. If the
file is missing, the bridge creates new ones.
"""

from __future__ import annotations

import json
import os
import secrets
import stat
from pathlib import Path
from typing import NamedTuple

from ..files import PRIVATE_FILE, PRIVATE_FOLDER, replace

_BYTES = 24
_LEAST = 32  # characters of a token
_LARGEST = 4096  # bytes of the file


class TokenError(OSError):
    """The file of the tokens cannot be used; the message says why and the way out."""


class Tokens(NamedTuple):
    """One token per role; its owner has the role."""

    patient: str
    therapist: str


def tokens_in(file: Path) -> Tokens:
    """Return the tokens of a file; create a missing file. Raises TokenError."""
    try:
        if not file.exists():
            return _made(file)
        _check_private(file)
        return _read(file)
    except TokenError:
        raise
    except OSError as error:
        raise TokenError(f"{file}: the tokens cannot be kept there: {error.strerror}") from None


def _made(file: Path) -> Tokens:
    if not file.parent.is_dir():
        file.parent.mkdir(parents=True, mode=PRIVATE_FOLDER)
        file.parent.chmod(PRIVATE_FOLDER)  # independent of the umask
    tokens = Tokens(secrets.token_urlsafe(_BYTES), secrets.token_urlsafe(_BYTES))
    replace(file, json.dumps(tokens._asdict()), private=True)
    _check_private(file)
    return tokens


def _check_private(file: Path) -> None:
    for path, what in ((file.parent, "folder"), (file, "file")):
        found = path.stat()
        if found.st_uid != os.getuid() or stat.S_IMODE(found.st_mode) & 0o077:
            raise TokenError(
                f"{path}: others can reach this {what} of tokens; give it to yourself alone "
                f"(chmod {PRIVATE_FOLDER if what == 'folder' else PRIVATE_FILE:o}), or name another"
            )


def _read(file: Path) -> Tokens:
    with file.open("rb") as stream:
        content = stream.read(_LARGEST)
    try:
        tokens = Tokens(**json.loads(content))
        long_enough = all(isinstance(each, str) and len(each) >= _LEAST for each in tokens)
    except (ValueError, TypeError):
        long_enough = False
    if not long_enough or tokens.patient == tokens.therapist:
        raise TokenError(f"{file}: holds no two tokens; remove it, and new ones are made")
    return tokens
