# SPDX-License-Identifier: Apache-2.0
"""Commands that all come too late stop the torque, though each is fresh enough by itself."""

from __future__ import annotations

import threading

import pytest
from screw_module_msgs.msg import AmplifierState, ForceCommand, SafetyState

from screw_module_ros.loop.ticker import Ticker
from screw_module_ros.nodes.support import topics
from screw_module_ros.operator.robot import Robot
from screw_module_ros.trials.runner import GraphRun

pytestmark = [pytest.mark.graph, pytest.mark.long]

PERIOD_NS = 10_000_000
LIMIT = 20


class Sender(threading.Thread):
    """Controller and supervisor in one: a command and a permission each period.

    late: periods by which the samples behind the commands are too old.
    """

    def __init__(self, robot: Robot):
        super().__init__(daemon=True)
        self._clock = robot.clock
        self.late = 0
        self._ended = threading.Event()
        node = robot.node
        self._commands = node.create_publisher(ForceCommand, "screw/force_command", topics.COMMAND)
        self._safety = node.create_publisher(SafetyState, "safety_state", topics.COMMAND)

    def run(self) -> None:
        """Send until `end`."""
        ticker = Ticker(self._clock, PERIOD_NS)
        while not self._ended.is_set():
            tick = ticker.sleep().monotonic_ns // PERIOD_NS - self.late
            self._safety.publish(
                SafetyState(level=SafetyState.OK, motion_permitted=True, vertical_permitted=True)
            )
            self._commands.publish(
                ForceCommand(sequence=tick & 0xFFFFFFFF, monotonic_ns=tick * PERIOD_NS, force=5.0)
            )
        self._clock.leave()

    def end(self) -> None:
        """Send nothing more."""
        self._ended.set()
        self._clock.wait_for(lambda: not self.is_alive(), 1.0)


@pytest.fixture(scope="module")
def robot():
    """Return a client of an amplifier that is alone with the rig."""
    given = {
        "rate": 1e9 / PERIOD_NS,
        "missed_limit": LIMIT,
        "gate.command_periods": 100.0,  # the age alone is to be no reason
        "gate.safety_timeout": 1.0,
        "command_timeout": 1.0,
        "heartbeat_timeout": 1.0,
    }
    extra = [w for name, value in given.items() for w in ("-p", f"amplifier:{name}:={value}")]
    with (
        GraphRun(extra=extra, only=["sim_rig", "amplifier"]) as graph,
        Robot("tester", watch=graph.watch, simulated=True) as client,
    ):
        graph.wait_until_ready(client)
        yield client


def test_twenty_missed_in_a_row_stop_the_torque(robot):
    """In time nothing happens; late, the torque goes, says why, and does not come back."""

    def stopped() -> bool:
        state = robot.newest(AmplifierState)
        return state.faulted and not state.enabled

    sender = Sender(robot)
    sender.start()
    try:
        robot.wait_until(
            lambda: robot.newest(AmplifierState).commands > 10,
            20.0,
            "the commands do not reach the amplifier",
        )
        robot.clear_amplifier()
        robot.enable()
        robot.pause(0.5)
        assert robot.newest(AmplifierState).enabled
        sender.late = 3
        robot.wait_until(stopped, 20.0, "not stopped")
        state = robot.newest(AmplifierState)
        assert "deadlines missed in a row" in state.reason
        assert int(state.reason.split()[0]) >= LIMIT
        assert state.commanded_torque == 0.0 and state.late >= LIMIT // 2
        robot.wait_until(
            lambda: robot.said("amplifier") == state.reason, 5.0, "the diagnostics do not tell"
        )
        sender.late = 0
        robot.pause(0.5)
        assert not robot.newest(AmplifierState).enabled
        robot.clear_amplifier()
        robot.enable()
    finally:
        sender.end()
