# SPDX-License-Identifier: Apache-2.0
"""Fixtures of a bus on which our drivers meet devices of stacks that nobody here wrote."""

from __future__ import annotations

from contextlib import ExitStack

import pytest
from far_end import DURAND, HAS_DURAND, far_end
from near_end import NearEnd


@pytest.fixture
def closing():
    """What is opened in a test and closed after it."""
    with ExitStack() as stack:
        yield stack


@pytest.fixture
def near(request, closing):
    """Our end of a virtual bus of this test's own."""
    made = NearEnd(request.node.nodeid)
    closing.callback(made.close)
    return made


@pytest.fixture
def device(request, near, closing):
    """Return a maker of devices on that bus: `device(stack, make)`."""

    def build(stack: str, make: str, node_id: int = 0):
        if stack == DURAND and not HAS_DURAND:
            pytest.skip("durand is not installed: pip install durand (requirements/dev.txt)")
        made = far_end(stack, request.node.nodeid, make, node_id)
        closing.callback(made.close)
        return made

    return build
