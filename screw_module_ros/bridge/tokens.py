# SPDX-License-Identifier: Apache-2.0
"""The tokens: random, in a file that only its owner can read, a line for each who has one.

    {"therapist:T7": "...", "therapist": "...", "patient": "..."}

One for the patients' screens, one for whoever comes as therapist, one for each therapist with a
code. They survive the bridge's process, so that pages reconnect after a restart of the bridge. If
the file is missing at its start, the bridge creates it. A line that is removed ends its token at
once. The patients' one comes last, so that what is left is JSON.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import secrets
import stat
from collections.abc import Mapping
from pathlib import Path

from ..files import PRIVATE_FILE, PRIVATE_FOLDER, replace, state_folder
from .rights import PATIENT, THERAPIST

_BYTES = 24
_LEAST = 32  # characters of a token
_LARGEST = 16384  # bytes of the file
_WHO = re.compile(rf"{PATIENT}|{THERAPIST}(:T\d{{1,3}})?")


class TokenError(OSError):
    """The file of the tokens cannot be used; the message says why and the way out."""


def token_file() -> Path:
    """Return where the bridge has them by default."""
    return state_folder() / "web_bridge" / "tokens.json"


def role_of(who: str) -> str:
    """Return the role of whom a token belongs to, PATIENT or THERAPIST."""
    return who.partition(":")[0]


def tokens_in(file: Path, makes: bool = True) -> dict[str, str]:
    """Return the tokens by whom they belong to. Raises TokenError.

    makes: create a missing file.
    """
    try:
        if makes and not file.exists():
            _make(file)
        _check_private(file)
        return _read(file)
    except TokenError:
        raise
    except OSError as error:
        raise TokenError(f"{file}: the tokens cannot be kept there: {error.strerror}") from None


def _read(file: Path) -> dict[str, str]:
    with file.open("rb") as stream:
        content = stream.read(_LARGEST)
    try:
        tokens = dict(json.loads(content))
        known = all(map(_WHO.fullmatch, tokens)) and PATIENT in tokens
        long_enough = all(isinstance(each, str) and len(each) >= _LEAST for each in tokens.values())
        if known and long_enough and len(set(tokens.values())) == len(tokens):
            return tokens
    except (ValueError, TypeError):
        pass
    raise TokenError(f"{file}: holds no tokens; remove it, and the bridge's next start makes new")


def _make(file: Path) -> None:
    if not file.parent.is_dir():
        file.parent.mkdir(parents=True, mode=PRIVATE_FOLDER)
        file.parent.chmod(PRIVATE_FOLDER)  # independent of the umask
    _write(file, {who: secrets.token_urlsafe(_BYTES) for who in (THERAPIST, PATIENT)})


def _write(file: Path, tokens: Mapping[str, str]) -> None:
    ordered = {who: tokens[who] for who in sorted(tokens, reverse=True)}
    replace(file, json.dumps(ordered, indent=0), private=True)


def _check_private(file: Path) -> None:
    for path, what in ((file.parent, "folder"), (file, "file")):
        found = path.stat()
        if found.st_uid != os.getuid() or stat.S_IMODE(found.st_mode) & 0o077:
            raise TokenError(
                f"{path}: others can reach this {what} of tokens; give it to yourself alone "
                f"(chmod {PRIVATE_FOLDER if what == 'folder' else PRIVATE_FILE:o}), or name another"
            )


def add_commands(commands: argparse._SubParsersAction) -> None:
    """Add the command of tokens to those of `session`."""
    text = "give a therapist a token of their own, in place of an earlier one; prints it"
    command = commands.add_parser("token", help=text, description=text)
    command.add_argument("code", type=_code, help="T and a number, like T7; no names")
    command.add_argument("--remove", action="store_true", help="take it away, at once")
    command.add_argument("--file", type=Path, default=None, help="the bridge's token_file")
    command.set_defaults(run=_token)


def _code(text: str) -> str:
    if not _WHO.fullmatch(who := f"{THERAPIST}:{text}"):
        raise argparse.ArgumentTypeError(f"{text!r}: T and a number is wanted, like T7")
    return who


def _token(options: argparse.Namespace) -> int:
    file = options.file or token_file()
    tokens = tokens_in(file)
    if not options.remove:
        tokens[options.code] = secrets.token_urlsafe(_BYTES)
        print(f"/therapist#token={tokens[options.code]}")
    elif tokens.pop(options.code, None) is None:
        raise TokenError(f"{options.code} has no token in {file}")
    _write(file, tokens)
    return 0
