# SPDX-License-Identifier: Apache-2.0
"""`characterize` beside the running graph, all as separate processes in simulated time at 1 kHz."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from screw_module_msgs.action import RunExperiment
from screw_module_msgs.msg import AmplifierState, ForceCommand, ImpedanceState, SafetyState
from screw_module_msgs.srv import SetFixture
from std_srvs.srv import Trigger

from screw_module_ros.control.modes import OBSERVER
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.graph import MODULE
from screw_module_ros.identification import force_error, friction_map
from screw_module_ros.identification.force_metric import ErrorOf
from screw_module_ros.identification.gravity import Crossing
from screw_module_ros.identification.lab import Lab
from screw_module_ros.identification.results import Result, load_result
from screw_module_ros.identification.stand import LoopSettings, SimulatedStand
from screw_module_ros.nodes.bringup import Process
from screw_module_ros.operator.robot import Robot, RobotError
from screw_module_ros.plant.settings import load_world
from screw_module_ros.rig.build import RigSettings
from screw_module_ros.trials.runner import GraphRun, recordings_in

pytestmark = [pytest.mark.graph, pytest.mark.long]

AMPLIFIER = ("linearize", "command_up", "command_down", "command_rate")
CONTROLLER = ("mode", *VerticalSettings._fields)


class Goal:
    """A running goal: its handle, feedback and result."""

    def __init__(self, robot: Robot, client: ActionClient, name: str, folder: Any, **settings: Any):
        self._robot = robot
        self.told: list[RunExperiment.Feedback] = []
        goal = RunExperiment.Goal(
            experiment=name, settings=json.dumps(settings), folder=str(folder)
        )
        sent = client.send_goal_async(goal, lambda message: self.told.append(message.feedback))
        robot.wait_until(sent.done, 10.0, "no answer to the goal")
        self.handle = sent.result()

    def wait_for(self, doing: str) -> None:
        """Wait until the feedback says so."""
        self._robot.wait_until(
            lambda: any(doing in told.doing for told in self.told), 20.0, f"never said {doing!r}"
        )

    def result(self, status: int = GoalStatus.STATUS_SUCCEEDED) -> RunExperiment.Result:
        """Wait for the end, with this status; return the result."""
        future = self.handle.get_result_async()
        self._robot.wait_until(future.done, 60.0, "no result")
        result = future.result().result
        assert future.result().status == status, result.message
        assert result.success == (status == GoalStatus.STATUS_SUCCEEDED)
        return result

    def refusal(self) -> str:
        """Wait for the end, which must be an abort; return the message."""
        return self.result(GoalStatus.STATUS_ABORTED).message


class Stand:
    """The operator, the action client and the graph's former state."""

    def __init__(self, robot: Robot, client: ActionClient, process: Process):
        self.robot, self.client, self.process = robot, client, process
        self.found = self.settings()

    def goal(self, name: str, folder: Any = "", **settings: Any) -> Goal:
        return Goal(self.robot, self.client, name, folder, **settings)

    def kill(self) -> None:
        """End `characterize` with SIGKILL."""
        os.kill(self.process.pid, signal.SIGKILL)
        self.robot.met_by_wall(lambda: self.process.exit_code() is not None, 10.0)

    def start_again(self) -> None:
        """Start it again, until it answers: the middleware lists the killed one for 20 s."""
        self.process = self.process.again()

        def answers() -> bool:
            sent = self.client.send_goal_async(RunExperiment.Goal())
            return self.robot.met_by_wall(sent.done, 3.0)

        assert any(answers() for _ in range(10)), "it does not come back"

    def make_ready(self) -> None:
        """Have the robot stand still, permitted and not enabled."""
        self.robot.enable(False)
        self.robot.clear_faults()
        self.robot.permit()

    def fix(self, fixture: str) -> None:
        request = SetFixture.Request(fixture=fixture, position=float("nan"))
        self.robot.ask(SetFixture, "sim_rig/set_fixture", request)

    def settings(self) -> dict[str, Any]:
        """Return what an experiment may change."""
        return {
            **self.robot.parameters("amplifier", AMPLIFIER),
            **self.robot.parameters("impedance_controller", CONTROLLER),
        }

    def goals_in_time(self) -> list[str]:
        """Return the threads of experiments that simulated time may still wait for."""
        page = self.robot.clock.page
        names = [page.name(row) for row, pid in enumerate(page.thread_pid) if pid]
        return [name for name in names if name.endswith("/goal")]

    def check_put_back(self) -> None:
        """Everything as found: parameters, torque off, nothing latched, nothing recorded."""
        robot = self.robot

        def calm() -> bool:
            controller = robot.state(ImpedanceState)
            permitted = robot.newest(SafetyState).level == SafetyState.OK
            return permitted and controller is not None and not controller.faulted

        robot.wait_until(lambda: not self.goals_in_time(), 10.0, "an experiment holds time")
        assert self.settings() == self.found
        assert not robot.call(Trigger, "session_recorder/stop").success
        robot.wait_until(calm, 10.0, "no permission again, or the controller is in fault")
        state = robot.newest(AmplifierState)
        assert (state.enabled, state.faulted, state.commanded_torque) == (False, False, 0.0)
        assert state.calibration != "none"


@contextmanager
def own_node() -> Iterator[tuple[Node, SingleThreadedExecutor]]:
    """Give a node served by the thread that sends the goals.

    rclpy's action client loses a response that comes before `send_goal_async` has returned.
    """
    context = Context()
    context.init()
    node = Node("goals", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    yield node, executor
    executor.shutdown(timeout_sec=1.0)
    node.destroy_node()
    context.try_shutdown()


@contextmanager
def operated(graph: GraphRun) -> Iterator[tuple[Robot, ActionClient]]:
    """Give an operator, the robot homed, and a client of `characterize` beside a graph."""
    with own_node() as (node, executor):

        def watch() -> None:
            graph.watch()
            executor.spin_once(timeout_sec=0.0)

        with Robot("tester", watch=watch, simulated=True) as robot:
            robot.wait_until_ready([*graph.names, "characterize"])
            graph.wait_until_ready(robot, lambda waiting: None)
            robot.clear_faults()
            robot.home()
            client = ActionClient(node, RunExperiment, "characterize/run")
            robot.wait_until(client.server_is_ready, 20.0, "no action")
            yield robot, client
            client.destroy()


@pytest.fixture(scope="module")
def running(tmp_path_factory) -> Iterator[Stand]:
    """Return the operator beside a running graph and `characterize`; all must end in order."""
    folder = tmp_path_factory.getbasetemp()
    fast = ["-p", "sim_rig:speed:=0.0", *recordings_in(folder / "bags")]
    with GraphRun(extra=fast, without=["endpoint_state"], shared=MODULE) as graph:
        given = ["--ros-args", "-p", "use_sim_time:=true", "-p", f"folder:={folder}"]
        process = Process("characterize", given)
        try:
            with operated(graph) as (robot, client):
                made = Stand(robot, client, process)
                yield made
                process = made.process
        finally:
            code = process.stop()
        codes = graph.stop()
    assert code == 0
    assert set(codes.values()) == {0}


@pytest.fixture
def stand(running: Stand) -> Stand:
    """Return the operator of a robot that stands still, permitted and not enabled."""
    running.make_ready()
    return running


def test_experiments_are_listed_and_what_is_not_there_is_refused(stand, tmp_path):
    assert "static_torque" in stand.goal("").result().message
    assert "no experiment 'juggling'; there are" in stand.goal("juggling", tmp_path).refusal()
    assert "signal analyser" in stand.goal("amplifier_response", tmp_path).refusal()


def test_the_wrong_mounting_and_an_enabled_amplifier_are_refused(stand, tmp_path):
    stand.fix("human_arm")
    said = stand.goal("friction_map", tmp_path).refusal()
    assert "not on the positioning stage but on 'human_arm': ros2 service call" in said
    said = stand.goal("static_torque", tmp_path).refusal()
    assert "the rotor is not locked" in said and "fixture: locked_rotor" in said
    stand.fix("stage")
    stand.robot.permit()
    stand.robot.enable()
    try:
        assert "must be passive" in stand.goal("friction_map", tmp_path).refusal()
    finally:
        stand.robot.enable(False)
    stand.check_put_back()


def test_static_torque(stand, tmp_path):
    """The dead zone through the whole graph, and everything as it was afterwards."""
    stand.fix("locked_rotor")
    goal = stand.goal("static_torque", tmp_path, duration=2.0, omega=6.3, amplitude=0.3)
    result, found = goal.result(), load_result(tmp_path, "static_torque")
    assert result.message == f"static_torque is done: {tmp_path}"
    assert result.result == found.as_yaml()
    assert result.files == [str(tmp_path / f"static_torque{end}") for end in (".yaml", ".npz")]
    assert found.value("torque_constant") == pytest.approx(0.16, rel=0.05)
    assert found.value("dead_zone") == pytest.approx(0.025, abs=0.005)
    assert max(told.progress for told in goal.told) == 1.0
    stand.check_put_back()


def test_cancelled_the_torque_is_off_and_all_is_put_back(stand, tmp_path):
    """Within the first trial; a second goal meanwhile is refused."""
    robot = stand.robot
    stand.fix("locked_rotor")
    goal = stand.goal("static_torque", tmp_path, duration=20.0, amplitude=0.3)
    goal.wait_for("sine of")
    assert stand.goals_in_time() == ["characterize/goal"]
    robot.wait_until(
        lambda: (state := robot.state(AmplifierState)) and state.commanded_torque > 0.1,
        10.0,
        "no torque",
    )
    assert not stand.goal("static_torque", tmp_path).handle.accepted
    goal.handle.cancel_goal_async()
    result = goal.result(GoalStatus.STATUS_CANCELED)
    assert result.message == f"cancelled; what was finished is kept in {tmp_path}"
    stand.check_put_back()


def test_settings_that_are_allowed_only_together_are_put_back(stand):
    """The observer refuses to run without damping, so mode and damping must come back together."""
    robot, node = stand.robot, "impedance_controller"
    found = robot.parameters(node, ("damping", "mode"))
    undamped = {"damping": 0.0, "mode": ForceCommand.IMPEDANCE}
    try:
        robot.set_parameters(node, undamped)
        robot.set_parameters(node, {"damping": 10.0, "mode": ForceCommand.OBSERVER})
        with pytest.raises(RobotError, match="damping = 0.0: .*damping"):
            robot.set_parameters(node, {"damping": 0.0})
        robot.set_parameters(node, undamped)
        assert robot.parameters(node, undamped) == undamped
    finally:
        robot.set_parameters(node, found)


class BySensors(SimulatedStand):
    """The stand in process without the truth, which the live graph does not have."""

    def record(self, trial, on_progress):
        samples = super().record(trial, on_progress)
        return samples._replace(handle=None, handle_velocity=None, true_force=None)


def test_observer_delivers_on_the_graph_what_it_does_in_process(stand, tmp_path):
    """Small motion, in which delay, friction, gain and zero of the transducer all count.

    The guard, tripped by mounting, once left 40 % of the gain: 1.8 times the error.
    """
    stand.fix("human_arm")
    chosen = {"modes": (OBSERVER,), "cases": ("small",), "side_force": 0.0}
    stand.goal("force_error", tmp_path, **chosen).result()
    loop = LoopSettings(rate=1000.0, command_delay=RigSettings().command_latency)
    here = force_error.run(Lab(BySensors(load_world(), loop), tmp_path / "in_process"),
                           force_error.Settings(**chosen))  # fmt: skip
    there = load_result(tmp_path, "force_error")
    live, in_process = (ErrorOf(*result.data["observer_small"]) for result in (there, here))
    assert live.rms == pytest.approx(in_process.rms, rel=0.2)
    assert live.share == 1.0
    assert live.travel == pytest.approx(in_process.travel, abs=0.5e-3)
    stand.check_put_back()


def test_friction_at_one_speed(stand, tmp_path):
    """The stage up and down over a few centimetres; the maps of the thesis lie at 13 to 23 N."""
    stand.fix("stage")
    goal = stand.goal(
        "friction_map", tmp_path, speeds=[0.06], inverted_speeds=[], low=0.135, high=0.165
    )
    goal.result()
    found = load_result(tmp_path, "friction_map")
    assert found.value("mean_up") == pytest.approx(18.0, abs=4.0)
    assert abs(found.value("mean_down")) < 4.0
    assert found.value("filled_up") > 0.05
    assert any("stage at -60 mm/s" in told.doing for told in goal.told)
    stand.check_put_back()


def test_the_weight_across_the_play_both_ways(stand, tmp_path):
    """The stage creeps to the other side of the play and back; the guide's friction cancels."""
    nothing = np.full((1, 142), np.nan)
    data = {"centres": 2.5 * (np.arange(142) + 0.5), "speeds": np.array((0.05,))}
    data |= dict.fromkeys(friction_map.MAPS, nothing)
    Result("friction_map", (), {}, (), data).save(tmp_path)
    stand.fix("stage")
    goal = stand.goal("gravity", tmp_path, speeds=[0.0005, 0.001], heights=[0.25])
    goal.result()
    found, vertical = load_result(tmp_path, "gravity"), load_world().vertical
    for name, truth, margin in (
        ("gravity", vertical.moving_mass * vertical.gravity, 0.05),
        ("guide", vertical.rail_friction, 0.1),
        ("play", vertical.play, 3e-6),
    ):
        assert found.value(name) == pytest.approx(truth, abs=margin), name
    force = found.data["crossings"][:, Crossing._fields.index("force")]
    assert np.isfinite(force).all(), "both ways of each run cross the play"
    assert any("stage at -1 mm/s to 250.0 mm" in told.doing for told in goal.told)
    stand.check_put_back()


@pytest.mark.parametrize(
    ("experiment", "fixture", "settings", "doing"),
    [("static_torque", "locked_rotor", {"duration": 20.0, "amplitude": 0.3}, "sine of"),
     ("force_gain", "human_arm", {"gains": [8.0], "preloaded": False}, "the hand moves")],
)  # fmt: skip
def test_killed_it_leaves_no_gain_no_torque_and_no_guard_off(
    stand, tmp_path, experiment, fixture, settings, doing
):
    """A killed torque trial left 141 N and no limit of the rate, a killed motion trial its gain."""
    robot = stand.robot
    stand.fix(fixture)
    stand.goal(experiment, tmp_path, **settings).wait_for(doing)
    robot.wait_until(
        lambda: abs(robot.newest(AmplifierState).commanded_torque) > 0.02, 31.4,  # a whole sine
        "no torque",
    )
    assert stand.settings() != stand.found
    stand.kill()
    robot.wait_until(
        lambda: not (state := robot.newest(AmplifierState)).enabled and not state.commanded_torque,
        1.0, "the torque stays",
    )  # fmt: skip
    assert "fallen silent" in " ".join(robot.newest(SafetyState).reasons)
    robot.wait_until(lambda: stand.settings() == stand.found, 1.0, "the trial's settings stay")
    assert robot.call(Trigger, "session_recorder/stop").success, "nothing else has stayed"
    stand.make_ready()
    stand.start_again()
    stand.check_put_back()
