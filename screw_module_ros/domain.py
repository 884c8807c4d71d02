# SPDX-License-Identifier: Apache-2.0
"""The ROS domain of this process: the same number however ROS_DOMAIN_ID spells it."""

from __future__ import annotations

import os
import re

VARIABLE = "ROS_DOMAIN_ID"
_DEFAULT = 0
# As rcl reads it (rcl_get_default_domain_id): C's strtoul with base 0.
_NUMBER = re.compile(r"\s*\+?(0[xX][0-9a-fA-F]+|[0-9]+)\s*", re.ASCII)
_LONGEST = 20


def domain_id() -> int:
    """Return the number of the ROS domain: 07 is 7, and an empty or missing variable is 0.

    What names something of a graph on this machine, a lock, a file or the page of simulated time,
    names it by this number. Raises ValueError for a value that is no number.
    """
    value = os.environ.get(VARIABLE, "")
    if not value:
        return _DEFAULT
    found = _NUMBER.fullmatch(value) if len(value) <= _LONGEST else None
    digits = found.group(1) if found else "x"
    base = 16 if digits[:2].lower() == "0x" else 8 if digits[0] == "0" else 10
    try:
        return int(digits, base)
    except ValueError:
        raise ValueError(
            f"{VARIABLE} = {value[:_LONGEST]!r} is no number: 0 to 232 is wanted"
        ) from None
