# SPDX-License-Identifier: Apache-2.0
"""The whole robot in one process: how it ends, and a recorder that is one of its nodes."""

from __future__ import annotations

import resource
import signal
import subprocess
import threading
from pathlib import Path

import pytest
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from screw_module_msgs.msg import AmplifierState, ForceCommand, PlanarState

from screw_module_ros.graph import WHOLE
from screw_module_ros.nodes.bringup import executable_path, simulated_arguments
from screw_module_ros.operator.robot import Robot
from screw_module_ros.recording.bag_files import information
from screw_module_ros.recording.recover import recover
from screw_module_ros.recording.verify import Report, verify
from screw_module_ros.resources import resource_path
from screw_module_ros.trials.runner import GraphRun, recordings_in

pytestmark = [pytest.mark.graph, pytest.mark.long]

ENDED_S = 60.0
BAG_LIMIT = 200_000  # [B]
SPANS_S = (0.5, 0.2, 0.8)


class Whole:
    """The process, with what it says."""

    def __init__(self):
        file = str(resource_path("params/sim.yaml"))
        words = ["--ros-args", "--params-file", file, *simulated_arguments(WHOLE)]
        self.process = subprocess.Popen(
            [executable_path(WHOLE.executable), *words],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )  # fmt: skip
        self.said: list[str] = []
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        self.said += self.process.stdout

    def active(self) -> int:
        """Return how many of its nodes have said that they are active."""
        return sum(": active" in line for line in self.said)

    def ended(self, number: signal.Signals) -> str:
        """Send a signal, wait for the end; return what was said. It must be an end in order."""
        self.process.send_signal(number)
        code = self.process.wait(ENDED_S)
        self._reader.join(ENDED_S)
        said = "".join(self.said)
        assert code == 0, said
        assert "Traceback" not in said and "Timeout" not in said, said
        return said


@pytest.fixture
def whole(ros_domain_id):
    made = Whole()
    yield made
    made.process.kill()
    made.process.wait()
    made.process.stdout.close()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("active", [0, 1, len(WHOLE.parts)])
def test_a_signal_ends_it_in_order_while_it_starts_and_while_it_runs(
    whole, wait_until, number, active
):
    wait_until(lambda: whole.said and whole.active() >= active, ENDED_S, "its start")
    whole.ended(number)


def test_it_ends_in_order_while_time_stands_still(whole, wait_until):
    """The rig is inactive: no loop comes to the end of its wait."""
    wait_until(lambda: whole.active() == len(WHOLE.parts), ENDED_S, "its start")
    down = ChangeState.Request(transition=Transition(id=Transition.TRANSITION_DEACTIVATE))
    with Robot("tester") as robot:
        assert robot.call(ChangeState, "sim_rig/change_state", down).success, whole.said
    whole.ended(signal.SIGTERM)


def ready(graph: GraphRun, robot: Robot) -> None:
    """Bring the robot to operation."""
    graph.wait_until_ready(robot)
    robot.clear_faults()
    robot.home()
    robot.set_mode(ForceCommand.IMPEDANCE)
    robot.permit()
    robot.enable()
    robot.enable_plane()


def checked(bag: Path, seconds: float) -> Report:
    """Return the report of a bag in which each sample of so many seconds must be."""
    report = verify(bag)
    for topic, rate in (("/screw/encoder", 1000), ("/handle/force", 1000), ("/manus/state", 125)):
        counts = report.topics[topic]
        assert (counts.lost, counts.missed, counts.dropped) == (0, 0, 0), report.problems
        assert counts.messages >= rate * seconds
    return report


def test_its_recorder_has_every_sample_each_time(tmp_path):
    with (
        GraphRun(extra=recordings_in(tmp_path), shared=WHOLE) as graph,
        Robot("tester", watch=graph.watch, simulated=True) as robot,
    ):
        ready(graph, robot)
        for seconds in SPANS_S:
            bag = robot.start_recording()
            robot.pause(seconds)
            assert "; " not in (told := robot.stop_recording()), told
            checked(bag, seconds - 0.1)
            robot.pause(0.1)
        robot.check_enabled()


def test_a_full_disk_ends_no_recording_and_stops_no_loop(tmp_path):
    """Nothing of the process can be written, its log neither; the same recording goes on."""
    with (
        GraphRun(extra=recordings_in(tmp_path), shared=WHOLE) as graph,
        Robot("tester", watch=graph.watch, simulated=True) as robot,
    ):
        ready(graph, robot)
        bag, pid = robot.start_recording(), graph.pids[WHOLE.executable]
        robot.pause(0.3)
        resource.prlimit(pid, resource.RLIMIT_FSIZE, (BAG_LIMIT, resource.RLIM_INFINITY))
        robot.wait_until(
            lambda: "File too large" in robot.said("session_recorder"), 10.0, "it is not told"
        )
        unlimited = (resource.RLIM_INFINITY, resource.RLIM_INFINITY)
        resource.prlimit(pid, resource.RLIMIT_FSIZE, unlimited)
        robot.pause(1.0)
        assert "; " not in (told := robot.stop_recording()), told
        checked(bag, 1.3)
        robot.check_enabled()


def test_after_a_kill_its_bag_is_recovered_and_the_next_start_is_not_hindered(
    tmp_path, wait_until
):
    with GraphRun(extra=recordings_in(tmp_path), shared=WHOLE) as graph:
        with Robot("tester", watch=graph.watch, simulated=True) as robot:
            ready(graph, robot)
            bag = robot.start_recording()
            robot.pause(2.0)
            graph.signal(WHOLE.executable, signal.SIGKILL)
        wait_until(lambda: graph.exit_code(WHOLE.executable) is not None, ENDED_S, "its end")
        graph.restart(WHOLE.executable)
        with Robot("next", watch=graph.watch) as robot:
            ready(graph, robot)
            robot.start_recording()
            robot.pause(0.5)
            told = robot.stop_recording()
    assert "; " not in told, told
    found = recover(bag)
    assert information(found.folder)["custom_data"]["screw_module_ros/state"] == "recovered"
    counts = verify(found.folder).topics["/screw/encoder"]
    assert (counts.lost, counts.missed, counts.dropped) == (0, 0, 0)
    assert counts.messages > 500, "what was flushed each 0.8 s is there"


def test_a_node_that_stays_apart_may_die():
    """The supervisor: the drives go off, and its return is no enabling."""
    with (
        GraphRun(shared=WHOLE, apart=["supervisor"]) as graph,
        Robot("tester", watch=graph.watch) as robot,
    ):
        assert graph.names[0] == "sim_rig" and graph.names[-1] == "supervisor"
        ready(graph, robot)
        graph.signal("supervisor", signal.SIGKILL)
        robot.wait_until(
            lambda: not robot.newest(AmplifierState).enabled
            and not robot.newest(PlanarState).enabled,
            10.0, "a drive stays enabled",
        )  # fmt: skip
        assert "no fresh safety_state" in robot.newest(AmplifierState).reason
        graph.restart("supervisor")
        robot.forget(["supervisor"])
        robot.wait_until_ready(["supervisor"])
        robot.pause(0.5)
        assert not robot.newest(AmplifierState).enabled
        assert not robot.newest(PlanarState).enabled
