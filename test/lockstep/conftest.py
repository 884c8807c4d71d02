# SPDX-License-Identifier: Apache-2.0
"""One page of simulated time per test."""

from __future__ import annotations

import uuid
from collections.abc import Iterator

import pytest

from screw_module_ros.lockstep.conductor import Conductor
from screw_module_ros.lockstep.page import Page


@pytest.fixture
def name() -> str:
    return f"test_{uuid.uuid4().hex}"


@pytest.fixture
def page(name) -> Iterator[Page]:
    made = Page(name)
    yield made
    made.close()
    assert not made.path.exists(), "the last one out removes the page"


class Told(list):
    """Sentences that the conductor said."""


@pytest.fixture
def told() -> Told:
    return Told()


@pytest.fixture
def conductor(page, told) -> Iterator[Conductor]:
    made = Conductor(page, 0.0, told.append)
    yield made
    made.close()
