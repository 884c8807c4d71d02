# SPDX-License-Identifier: Apache-2.0
"""The example game against a hand that follows its wishes at once."""

import math
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from screw_module_msgs.msg import EndpointSetpoint, EndpointState, ForceCommand

from screw_module_ros.graph import WHOLE
from screw_module_ros.operator.bring_up import bring_up
from screw_module_ros.operator.robot import Robot
from screw_module_ros.trials.patient import Hand
from screw_module_ros.trials.runner import GraphRun

ROOT = Path(__file__).parents[2]
GAME = ROOT / "examples" / "fruit_game.py"
FAR = (9.0, 9.0, 9.0)


class PlayedHand:
    """The far end of the game: publishes states, notes wishes."""

    def __init__(self, context):
        self.node = rclpy.create_node("hand", context=context)
        self.executor = SingleThreadedExecutor(context=context)
        self.executor.add_node(self.node)
        self._states = self.node.create_publisher(EndpointState, "endpoint_state", 10)
        self._wishes, self._subscription = [], None

    def take_wishes(self):
        """Subscribe to wishes, as therapy_session does."""
        self._subscription = self.node.create_subscription(
            EndpointSetpoint, "therapy/wish", lambda m: self._wishes.append(m.position), 10
        )

    def leave(self):
        self.node.destroy_publisher(self._states)

    def stand(self, x, y, z, valid=True, enabled=True):
        """Publish one state; return the newest wish, None before the first."""
        state = EndpointState(valid=[valid] * 3, enabled=[enabled] * 2)
        state.position.x, state.position.y, state.position.z = x, y, z
        self._states.publish(state)
        self.executor.spin_once(timeout_sec=0.05)
        newest = self._wishes[-1] if self._wishes else None
        return newest and (newest.x, newest.y, newest.z)


@pytest.fixture
def hand():
    context = Context()
    rclpy.init(context=context)
    hand = PlayedHand(context)
    yield hand
    hand.executor.shutdown()
    hand.node.destroy_node()
    rclpy.try_shutdown(context=context)


@pytest.fixture
def game():
    """The game's process and the lines that it has written."""
    process = subprocess.Popen(
        [sys.executable, GAME], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        env={**os.environ, "RCUTILS_LOGGING_BUFFERED_STREAM": "0"},
    )  # fmt: skip
    lines = []
    reader = threading.Thread(target=lambda: lines.extend(process.stdout), daemon=True)
    reader.start()
    yield process, lines
    process.terminate()
    process.wait(timeout=20)
    reader.join(timeout=5)
    process.stdout.close()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_is_played_and_ends_without_a_traceback(number, game, hand, wait_until):
    """Each fruit picked is told and another one wished for; an axis without home picks none."""
    hand.take_wishes()
    wait_until(lambda: hand.stand(*FAR), 30.0, "a wish")
    first = hand.stand(*FAR)
    assert {hand.stand(first[0], first[1], math.nan) for _ in range(20)} == {first}
    wait_until(lambda: hand.stand(*first) != first, 10.0, "another fruit")
    assert math.dist(first, hand.stand(*FAR)) > 0.1
    process, lines = game
    wait_until(lambda: any("picked" in line for line in lines), 10.0, "the line")
    process.send_signal(number)
    assert process.wait(timeout=20) == 0
    assert not any("Traceback" in line for line in lines)


@pytest.mark.parametrize(
    ("state", "takes", "why"),
    [
        ({"valid": False}, True, "not homed"),
        ({"enabled": False}, True, "torque is off"),
        ({}, False, "does therapy_session run?"),
        (None, False, "no robot"),
    ],
)
def test_it_says_why_nothing_moves(state, takes, why, game, hand, wait_until):
    if takes:
        hand.take_wishes()
    if state is None:
        hand.leave()

    def told():
        if state is not None:
            hand.stand(*FAR, **state)
        return any(why in line for line in game[1])

    wait_until(told, 30.0, why)


@pytest.mark.graph
@pytest.mark.long
def test_a_second_fruit_comes_with_ones_own_robot_too(tmp_path):
    """`bringup --patient healthy` and `therapy_session`, as docs/games.md says."""
    with (
        GraphRun(shared=WHOLE, patient="healthy") as graph,
        Robot("operator", watch=graph.watch, simulated=True) as robot,
    ):
        graph.add("therapy_session")
        robot.wait_until_ready([*graph.names])
        bring_up(robot, ForceCommand.IMPEDANCE, Hand(robot))
        with (
            open(tmp_path / "game.txt", "w+", encoding="utf-8") as told,
            subprocess.Popen([sys.executable, "-u", GAME], stdout=told) as game,
        ):
            text = Path(told.name).read_text
            robot.wait_until(lambda: text().count("picked") >= 3, 60.0, "fruits are not picked")
            game.terminate()


def test_the_page_of_games_shows_this_very_game():
    code = GAME.read_text("utf-8").split('"""\n\n', 1)[1]
    assert code in (ROOT / "docs" / "games.md").read_text("utf-8")
