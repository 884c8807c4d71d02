# SPDX-License-Identifier: Apache-2.0
"""What is `module`'s own: one process and one loop, and the drive that stops without them.

That it has the topics and services of the four nodes in it is in test_graph.py.
"""

from __future__ import annotations

import os
import signal
import subprocess

import pytest
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from screw_module_msgs.msg import (
    AmplifierState,
    EncoderSample,
    ForceCommand,
    ImpedanceState,
    SafetyState,
    SimTruth,
)

from screw_module_ros.graph import COMPOSED
from screw_module_ros.nodes.bringup import executable_path
from screw_module_ros.nodes.support import topics
from screw_module_ros.operator.robot import Robot, RobotError, arm
from screw_module_ros.trials.runner import GraphRun

pytestmark = pytest.mark.graph

HOME = 0.25
NO_TORQUE = 1e-3  # Nm, of a motor whose current decays


class Vertical(Robot):
    """The operator of a robot without a plane, who also sees the truth."""

    def __init__(self):
        super().__init__("tester", simulated=True)
        self.truth = SimTruth()
        self.node.create_subscription(SimTruth, "sim/truth", self._see, 10)

    def _see(self, truth: SimTruth) -> None:
        self.truth = truth

    def pull(self) -> None:
        """Enable, and let the spring pull at the relaxed hand until the motor has torque."""
        self.set_mode(ForceCommand.IMPEDANCE)
        self.set_impedance(400.0, 0.0)
        self.set_arm(arm(kind="relaxed"))
        self.set_setpoint(z=HOME)
        self.clear_amplifier()
        self.permit()
        self.enable()
        self.set_setpoint(z=HOME + 0.06)
        self.wait_until(lambda: abs(self.truth.motor_torque) > 0.01, 20.0, "the motor is idle")


@pytest.fixture(scope="module")
def run():
    """Return the running process with the rig and a supervisor that wants no plane."""
    needed = ", ".join(COMPOSED.parts)
    extra = ["-p", f"supervisor:required:=[{needed}]"]
    with GraphRun(extra=extra, only=["sim_rig", "supervisor", "module"], composed=True) as graph:
        yield graph


@pytest.fixture(scope="module")
def operator(run):
    """Return the operator of a robot that is ready."""
    with Vertical() as robot:
        robot.wait_until_ready(run.names)
        robot.clear_amplifier()
        robot.trigger("encoder/home")
        yield robot


@pytest.fixture
def robot(operator):
    """Return the operator with the torque off and the hand at home."""
    operator.set_arm(arm(kind="active", target=(0.0, 0.0, HOME), duration=0.3))
    operator.enable(False)
    return operator


def test_one_process_moves_the_handle(robot, run):
    """All four nodes live in one process, which pulls the handle up."""
    assert set(run.pids) == {"sim_rig", "supervisor", "module"}
    assert set(COMPOSED.parts) < set(run.names)
    robot.pull()
    robot.wait_until(
        lambda: robot.newest(ImpedanceState).position > HOME + 0.02, 20.0, "the handle stays"
    )
    state = robot.newest(AmplifierState)
    assert state.enabled and state.commands > 0 and state.lost == 0


def test_the_drive_stops_when_the_loop_hangs(robot, run):
    """Frozen, the process sends nothing: the drive takes the torque off; thawed, it stays off."""
    robot.pull()
    os.kill(run.pids["module"], signal.SIGSTOP)
    try:
        robot.wait_until(
            lambda: abs(robot.truth.motor_torque) < NO_TORQUE, 5.0, "the drive goes on by itself"
        )
    finally:
        os.kill(run.pids["module"], signal.SIGCONT)
    robot.wait_until(lambda: robot.state(AmplifierState) is not None, 10.0, "not awake again")
    robot.pause(0.5)
    state = robot.newest(AmplifierState)
    assert not state.enabled and state.reason
    assert abs(robot.truth.motor_torque) < NO_TORQUE
    robot.clear_amplifier()
    robot.wait_until(
        lambda: robot.newest(SafetyState).level != SafetyState.UNKNOWN, 5.0, "no supervisor"
    )
    robot.pull()


def test_a_rate_of_its_own_is_refused(robot):
    """One loop drives the parts: a rate cannot be changed for one of them."""
    with pytest.raises(RobotError, match="common to the nodes"):
        robot.set_parameter("encoder", "rate", 100.0)


def test_somebody_else_may_command_while_the_controller_is_off(robot):
    """As `characterize` does: without a controller here the amplifier listens to the topic."""
    samples: list[EncoderSample] = []
    robot.node.create_subscription(EncoderSample, "screw/encoder", samples.append, topics.SAMPLE)
    change(robot, Transition.TRANSITION_DEACTIVATE)
    change(robot, Transition.TRANSITION_CLEANUP)
    publisher = robot.node.create_publisher(ForceCommand, "screw/force_command", topics.COMMAND)
    try:
        robot.wait_until(lambda: publisher.get_subscription_count() == 1, 10.0, "nobody hears it")
        before = robot.newest(AmplifierState).commands

        def heard() -> bool:
            sample = samples[-1]
            publisher.publish(
                ForceCommand(
                    sequence=sample.sequence, monotonic_ns=sample.monotonic_ns, force=12.5
                )
            )
            state = robot.newest(AmplifierState)
            return state.commands >= before + 20 and state.commanded_force == 12.5

        robot.wait_until(heard, 20.0, "the amplifier does not act upon the topic")
    finally:
        robot.node.destroy_publisher(publisher)
        change(robot, Transition.TRANSITION_CONFIGURE)
        change(robot, Transition.TRANSITION_ACTIVATE)
    wait_until_heard_again(robot)
    robot.pull()


def wait_until_heard_again(robot: Robot) -> None:
    """Wait for a state of the controller, and then for a permission given after it."""
    newest = {ImpedanceState: 0, SafetyState: 0}

    def newer(kind: type, than: int) -> bool:
        state = robot.state(kind)
        if state is not None:
            newest[kind] = state.header.stamp.sec * 10**9 + state.header.stamp.nanosec
        return newest[kind] > than

    begun = robot.clock.stamp_ns()
    robot.wait_until(lambda: newer(ImpedanceState, begun), 10.0, "the controller is silent")
    heard = newest[ImpedanceState] + 100_000_000
    robot.wait_until(lambda: newer(SafetyState, heard), 10.0, "the supervisor is silent")


def change(robot: Robot, transition: int) -> None:
    """Take the controller one lifecycle step."""
    request = ChangeState.Request(transition=Transition(id=transition))
    robot.wait_until(
        lambda: robot.call(ChangeState, "impedance_controller/change_state", request).success,
        10.0,
        "the controller stays as it is",
    )


def test_it_ends_in_order(robot, run):
    """SIGTERM in motion: exit code 0 and the torque off. The last test but one for this process."""
    robot.pull()
    answer = robot.call(GetState, "amplifier/get_state")
    assert answer.current_state.id == State.PRIMARY_STATE_ACTIVE
    assert run.stop() == {"module": 0, "supervisor": 0, "sim_rig": 0}


def test_the_drive_stops_when_the_process_is_killed():
    """SIGKILL in motion: the drive takes the torque off by itself."""
    needed = ", ".join(COMPOSED.parts)
    extra = ["-p", f"supervisor:required:=[{needed}]"]
    only = ["sim_rig", "supervisor", "module"]
    with GraphRun(extra=extra, only=only, composed=True) as graph, Vertical() as robot:
        robot.wait_until_ready(graph.names)
        robot.trigger("encoder/home")
        robot.pull()
        os.kill(graph.pids["module"], signal.SIGKILL)
        robot.wait_until(
            lambda: abs(robot.truth.motor_torque) < NO_TORQUE, 5.0, "the drive goes on by itself"
        )
        robot.wait_until(
            lambda: robot.newest(SafetyState).level == SafetyState.STOPPED, 5.0, "not stopped"
        )
        assert graph.stop() == {"module": -signal.SIGKILL, "supervisor": 0, "sim_rig": 0}


def test_rates_that_differ_are_refused():
    """The sentence names the nodes and their rates."""
    done = subprocess.run(
        [executable_path("module"), "--ros-args", "-p", "encoder:rate:=500.0"],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert "encoder: 500" in done.stderr and "amplifier: 1000" in done.stderr
