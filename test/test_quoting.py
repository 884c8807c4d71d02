# SPDX-License-Identifier: Apache-2.0
"""Quotations are short and cheap, whatever is quoted."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.quoting import LONGEST, quoted

LAUGHS: object = "x"
for _ in range(12):
    LAUGHS = [LAUGHS] * 9
LOOP: list = []
LOOP.append(LOOP)


@pytest.mark.parametrize(
    "value", [1, -2.5, math.nan, math.inf, "text", True, None, [1, 2], {"a": (1.0,)}, b"raw"]
)
def test_short_values_are_as_repr_has_them(value):
    assert quoted(value) == repr(value)


@pytest.mark.parametrize(
    "value",
    [LAUGHS, LOOP, "x" * 10**7, b"x" * 10**7, [0] * 10**6, {k: k for k in range(10**5)}, 10**9999],
    ids=["laughs", "loop", "text", "bytes", "list", "dict", "integer"],
)
@pytest.mark.timeout(10)
def test_anything_else_is_cut(value):
    assert len(quoted(value)) <= LONGEST


@given(st.recursive(st.text() | st.integers() | st.floats(), lambda x: st.lists(x)))
def test_never_longer(value):
    assert len(quoted(value)) <= LONGEST
