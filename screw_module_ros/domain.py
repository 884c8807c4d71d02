# SPDX-License-Identifier: Apache-2.0
"""The ROS domain of this process as a number, for any spelling of ROS_DOMAIN_ID."""

from __future__ import annotations

import os
import re
import sys

VARIABLE = "ROS_DOMAIN_ID"
_DEFAULT = 0
# As rcl reads it (rcl_get_default_domain_id): C's strtoul with base 0.
_NUMBER = re.compile(r"\s*\+?(0[xX][0-9a-fA-F]+|[0-9]+)\s*", re.ASCII)
_LONGEST = 20
_HIGHEST = 232  # higher domains exceed the range of UDP ports (DDSI-RTPS 2.5, section 9.6.2.3)


class DomainError(ValueError):
    """ROS_DOMAIN_ID is not a valid domain number; the message gives the range."""


def domain_id() -> int:
    """Return the number of the ROS domain: 07 is 7, and an empty or missing variable is 0.

    Locks, files and the page of simulated time of a graph have this number in their name. Raises
    DomainError for an invalid value.
    """
    value = os.environ.get(VARIABLE, "")
    if not value:
        return _DEFAULT
    found = _NUMBER.fullmatch(value) if len(value) <= _LONGEST else None
    digits = found.group(1) if found else "x"
    base = 16 if digits[:2].lower() == "0x" else 8 if digits[0] == "0" else 10
    try:
        number = int(digits, base)
    except ValueError:
        number = None
    if number is None or number > _HIGHEST:
        raise DomainError(
            f"{VARIABLE} = {value[:_LONGEST]!r} is no ROS domain: a number from 0 "
            f"to {_HIGHEST} is wanted"
        )
    return number


def end_without_domain(program: str) -> None:
    """End the program with exit code 2 and a message if ROS_DOMAIN_ID is not a valid domain."""
    try:
        domain_id()
    except DomainError as error:
        print(f"{program}: {error}", file=sys.stderr)
        raise SystemExit(2) from None
