# SPDX-License-Identifier: Apache-2.0
"""A game that is cut off leaves no spring behind; the relay runs without ROS's graph."""

from __future__ import annotations

import math
import threading
from functools import partial
from types import SimpleNamespace

import pytest
from screw_module_msgs.msg import EndpointSetpoint

from screw_module_ros.clock import ManualClock
from screw_module_ros.nodes.therapy_session import TherapySessionNode
from screw_module_ros.nodes.wish_relay import WishRelay
from screw_module_ros.therapy.wishes import WishLimits

S = 1_000_000_000
HAND = (0.05, 0.0, 0.2)


@pytest.fixture
def relay():
    wishes, asked = [], []

    def publish(message):
        asked.append((message.position.x, message.position.y, message.position.z))

    node = SimpleNamespace(outlet=lambda *offer: publish, stamp=lambda header: None)
    inbox = SimpleNamespace(
        subscribe=lambda *request: lambda: wishes.pop(0) if wishes else None
    )
    made = WishRelay(node, inbox, WishLimits())
    made.wishes, made.asked = wishes, asked
    return made


def wish(x):
    message = EndpointSetpoint()
    message.position.x, message.position.z = x, 0.2
    return message


def test_a_game_that_is_cut_off_lets_the_hand_go_at_once(relay):
    relay.wishes.append(wish(0.1))
    relay.relay(True, HAND, 10 * S)
    assert len(relay.asked) == 1 and relay.asked[0] != HAND
    relay.wishes.append(wish(0.1))
    relay.relay(False, HAND, 10 * S + 50_000_000)  # the therapist allows no wishes any more
    assert relay.asked[1:] == [HAND]
    relay.wishes.append(wish(0.1))
    relay.relay(False, HAND, 20 * S)
    assert len(relay.asked) == 2, "once: others may ask for set points as well"
    relay.wishes.append(wish(0.14))
    relay.relay(True, HAND, 21 * S)
    assert relay.asked[2][0] == pytest.approx(0.05 + 0.2 * 0.3), "from the hand on, at its speed"


@pytest.mark.parametrize("allowed", [True, False])
def test_a_hand_of_unknown_position_is_let_go_as_soon_as_it_is_known(relay, allowed):
    """endpoint_state fails together with the game: no set point at all would leave the spring."""
    relay.wishes.append(wish(0.1))
    relay.relay(True, HAND, 10 * S)
    relay.relay(allowed, None, 12 * S)
    relay.relay(allowed, (math.nan, math.nan, 0.2), 13 * S)
    assert len(relay.asked) == 1, "nowhere is no place to let it go at"
    relay.relay(allowed, HAND, 14 * S)
    relay.relay(allowed, HAND, 15 * S)
    assert relay.asked[1:] == [HAND]


@pytest.mark.parametrize(("age_s", "expected"), [(0.1, HAND), (0.5, None)])
def test_where_the_hand_was_before_a_silence_is_no_set_point(age_s, expected):
    """Else the first wish, or the release, would pull from a place that the hand has left."""
    given = []
    node = SimpleNamespace(
        _session=None, _sampled_ns=10 * S, _sample=SimpleNamespace(position=HAND),
        parameters=SimpleNamespace(read=lambda kind: SimpleNamespace(allow_wishes=True)),
        _wishes=SimpleNamespace(relay=lambda allowed, hand, now_ns: given.append(hand)),
    )  # fmt: skip
    node._silent = lambda now_ns: TherapySessionNode._silent(node, now_ns)
    node._is_under_way = lambda: False
    TherapySessionNode._relay_wishes(node, 10 * S + round(age_s * S))
    node._sampled_ns = node._sample = None  # nothing was heard yet
    TherapySessionNode._relay_wishes(node, 11 * S)
    assert given == [expected, None]


def test_a_session_begins_without_the_games_set_point(relay):
    """NaN alone leaves the spring where it is, and it pulled until the recording had begun."""
    relay.wishes.append(wish(0.1))
    relay.relay(True, HAND, 10 * S)
    relay.begin(WishLimits())
    assert all(value != value for value in relay.asked[-1])
    for second in (11, 12):
        relay.relay(False, HAND, second * S)
    assert relay.asked[2:] == [HAND]


def test_the_sessions_node_takes_a_games_pull_with_it(relay):
    """Nobody would ever let the hand go: the controllers keep the newest set point."""
    relay.wishes.append(wish(0.1))
    relay.relay(True, HAND, 10 * S)
    recording = SimpleNamespace(close=lambda: None)
    node = SimpleNamespace(
        _lock=threading.Lock(), _session=None, _recording=recording, _wishes=relay,
        clock=ManualClock(10 * S), _silent=lambda now_ns: False,
        _sample=SimpleNamespace(position=HAND), _is_under_way=lambda: False,
    )  # fmt: skip
    node._relay_wishes = partial(TherapySessionNode._relay_wishes, node)
    TherapySessionNode.end(node)
    assert relay.asked[1:] == [HAND]
