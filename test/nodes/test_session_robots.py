# SPDX-License-Identifier: Apache-2.0
"""A recorder takes its own robot's topics."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from screw_module_ros.nodes.session_intake import Selection
from screw_module_ros.nodes.session_robots import OtherRobots


def robots(own: str, *nodes: tuple[str, str]) -> OtherRobots:
    return OtherRobots(
        SimpleNamespace(
            get_namespace=lambda: own, get_node_names_and_namespaces=lambda: list(nodes)
        )
    )


@pytest.mark.parametrize(
    ("own", "topic", "other"),
    [
        ("/left", "/left/screw/encoder", False),
        ("/left", "/right/screw/encoder", True),
        ("/left", "/leftover/x", True),
        ("/left", "/screw/encoder", True),
        ("/left", "/diagnostics", False),
        ("/", "/screw/encoder", False),
        ("/", "/game/score", False),
        ("/", "/left/screw/encoder", True),
        ("/", "/leftover/x", False),
    ],
)
def test_whose_topic_it_is(own, topic, other):
    there = robots(own, ("supervisor", "/left"), ("supervisor", "/right"), ("encoder", "/"),
                   ("session_recorder", "/game"))  # fmt: skip
    assert there.have(topic) is other
    assert Selection(others=there).takes(topic) is not other
    assert Selection(topics=(topic,), others=there).takes(topic)
    assert Selection().takes(topic)
