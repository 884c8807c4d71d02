# SPDX-License-Identifier: Apache-2.0
"""The example game against a hand that follows its set points at once."""

import math
import subprocess
import sys
from pathlib import Path

import pytest
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from screw_module_msgs.msg import EndpointSetpoint, EndpointState

ROOT = Path(__file__).parents[2]
GAME = ROOT / "examples" / "fruit_game.py"


@pytest.fixture
def hand():
    """A node with a publisher of states and a list of the set points that came."""
    context = Context()
    rclpy.init(context=context)
    node = rclpy.create_node("hand", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    pulled = []
    node.create_subscription(EndpointSetpoint, "setpoint", lambda m: pulled.append(m.position), 10)
    publisher = node.create_publisher(EndpointState, "endpoint_state", 10)

    def stand(x: float, y: float, z: float) -> tuple[float, float, float] | None:
        state = EndpointState()
        state.position.x, state.position.y, state.position.z = x, y, z
        publisher.publish(state)
        executor.spin_once(timeout_sec=0.05)
        return (pulled[-1].x, pulled[-1].y, pulled[-1].z) if pulled else None

    yield stand
    executor.shutdown()
    node.destroy_node()
    rclpy.try_shutdown(context=context)


@pytest.fixture
def game():
    process = subprocess.Popen([sys.executable, GAME], stdout=subprocess.PIPE, text=True)
    yield process
    process.terminate()
    process.communicate(timeout=20)


def test_the_pull_goes_to_the_next_fruit_once_one_is_picked(game, hand, wait_until):
    aims = []

    def far_away():
        aims[:] = [hand(9.0, 9.0, 9.0)]
        return aims[0]

    wait_until(far_away, 30.0, "a set point of the game")
    first = aims[0]
    wait_until(lambda: hand(*first) != first, 10.0, "another fruit")
    second = hand(9.0, 9.0, 9.0)
    assert math.dist(first, second) > 0.1


def test_an_axis_without_home_picks_nothing(game, hand, wait_until):
    wait_until(lambda: hand(9.0, 9.0, 9.0), 30.0, "a set point of the game")
    first = hand(9.0, 9.0, 9.0)
    assert {hand(first[0], first[1], math.nan) for _ in range(20)} == {first}


def test_it_says_at_once_where_hand_and_fruit_are(game, hand, wait_until):
    """Also when no fruit is picked, and when an axis has no home."""
    wait_until(lambda: hand(9.0, 9.0, math.nan), 30.0, "a set point of the game")
    assert game.stdout.readline().startswith("hand (9.0, 9.0, nan), next fruit (0.08,")


def test_the_readme_shows_this_very_game():
    code = GAME.read_text().split('"""\n\n', 1)[1]
    assert code in (ROOT / "README.md").read_text()
