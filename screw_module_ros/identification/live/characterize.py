# SPDX-License-Identifier: Apache-2.0
"""`characterize`: experiments of the identification (thesis chapters 4 to 6) on the live graph.

Action `~/run`: an experiment's name, settings as YAML, a folder for results and finished trials. An
empty name lists the experiments. The feedback requests the operator's actions; the operator
confirms each with `~/confirm`. The node is started by hand, beside the running robot.
"""

from __future__ import annotations

import math
import os
import tempfile
import threading
import traceback
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.clock import Clock, ClockType
from screw_module_msgs.action import RunExperiment
from std_srvs.srv import Trigger

from screw_module_ros import graph
from screw_module_ros.can_io.bus import BusSettings
from screw_module_ros.clock import TimeStandsStill, WallClock
from screw_module_ros.identification import calibration, delivered_impedance
from screw_module_ros.identification.experiments import EXPERIMENTS, listing, settings_from_yaml
from screw_module_ros.identification.lab import Lab, MissingResult
from screw_module_ros.identification.results import Experiment, Result
from screw_module_ros.identification.trials import Cancelled, NotPossible
from screw_module_ros.nodes.support.node import Node
from screw_module_ros.nodes.support.place import below, root_folder
from screw_module_ros.nodes.support.runtime import main as run_node
from screw_module_ros.nodes.support.states import OK, Health
from screw_module_ros.nodes.support.topics import offered
from screw_module_ros.operator.client import RobotError
from screw_module_ros.operator.robot import Robot
from screw_module_ros.recording.bag import BagError
from screw_module_ros.settings import Setting, shown

from .fixture import OperatorFixture, RigBusSettings, RigFixture, sees_rig
from .samples import SamplesLost
from .stand import LiveStand

_LEAVE_S, _RESULT_S = 60.0, 0.3
_FEEDBACK_S, _GOOD_S = 0.2, 10.0
# Errors that end an experiment; their text is shown to the user.
_REASONS = (
    NotPossible, MissingResult, RobotError, BagError, SamplesLost, TimeStandsStill, ValueError,
    OSError,
)  # fmt: skip
_POLL_S = 0.05
_WALL = WallClock()  # those who wait for this process, or for a result, use wall clock


class ResultsSettings(NamedTuple):
    """Folder of the results."""

    folder: Annotated[
        str, Setting("root folder of the results of all goals; no goal can write outside of it; "
                     "~ is the home folder", at_start=True)
    ] = "~/characterization"


class CharacterizeNode(Node):
    """Runs one experiment at a time, in a thread; the main thread waits."""

    def __init__(self) -> None:
        super().__init__("characterize")
        self.parameters.declare(ResultsSettings, RigBusSettings)
        self.parameters.declare_with(BusSettings, "can", channel=graph.bus_of("encoder"))
        self._robot: Robot | None = None  # of the experiment's thread
        self._leaving = threading.Event()
        self._confirmed = threading.Event()
        self._doing = ""
        self._server = OneGoalServer(
            self, RunExperiment, "~/run", self._work,
            lambda: "" if self.active else "the node is not active",
        )  # fmt: skip
        self.serve(Trigger, "~/confirm", self._confirm, "thank you", always=True)

    # Lifecycle -----------------------------------------------------------------------------

    def connect(self) -> None:
        """Create the topic of the lease, and the client of the experiments."""
        self._publish = self.outlet(*offered(graph.EXCITATION))
        self._robot = Robot(
            f"{self.get_name()}_client", self.get_namespace(), simulated=self.clock.simulated
        )

    def begin(self) -> None:
        """Accept goals."""
        self._leaving.clear()

    def step(self) -> None:
        """Wait: the experiment's thread does the work."""
        self.clock.idle()
        self.stopping.wait(_POLL_S)

    def run(self) -> None:
        """Run until the process must end, then let the experiment restore the graph."""
        super().run()
        if self._server.busy:
            self.end()
            self.clock.idle()
            _WALL.sleep(_RESULT_S)  # the executor still runs and sends the result to the client

    def end(self) -> None:
        """Cancel the experiment; wait until it has restored the graph."""
        self._leaving.set()
        end_ns = _WALL.now_ns() + round(_LEAVE_S * 1e9)
        while self._server.busy and _WALL.now_ns() < end_ns:
            _WALL.sleep(_POLL_S)

    def disconnect(self) -> None:
        """Leave the graph as a client."""
        if self._robot is not None:
            self._robot.close()
            self._robot = None

    def destroy_node(self) -> None:
        """Destroy the action server, then the node."""
        self._server.destroy()
        super().destroy_node()

    # Action --------------------------------------------------------------------------------

    def _confirm(self, request: Trigger.Request) -> str:
        self._confirmed.set()
        return "" if self._server.busy else "nothing is being asked"

    def _work(self, goal: Any) -> Outcome:
        """Execute a goal; never raises."""
        request = goal.request
        if not request.experiment:
            return Outcome(RunExperiment.Result(success=True, message=listing()), True)
        self._doing = request.experiment
        answer = RunExperiment.Result()
        left: list[str] = []
        kept, cancelled = "", False
        try:
            root = root_folder(self.parameters.read(ResultsSettings).folder)
            experiment, settings, folder = _checked(request, root)
            kept = f"; what was finished is kept in {folder}"
            result = self._measured(goal, experiment, settings, folder, left)
            answer.files = [str(path) for path in result.save(folder)]
            answer.result, answer.success = result.as_yaml(), True
            message = f"{request.experiment} is done: {folder}"
        except Cancelled as error:
            cancelled, message = True, f"{error}{kept}"
        except _REASONS as error:
            cancelled, message = goal.is_cancel_requested, " ".join(str(error).split())
        except Exception as error:
            self.get_logger().error(traceback.format_exc())
            message = f"{request.experiment}: {type(error).__name__}: {error}"
        finally:
            self._doing = ""
            self.clock.leave()
        answer.message = "; ".join(dict.fromkeys([message, *left]))
        if answer.success and not left:
            self.get_logger().info(answer.message)
        else:
            self.get_logger().warning(answer.message)
        return Outcome(answer, answer.success, cancelled)

    def _measured(
        self, goal: Any, experiment: Experiment, settings: Any, folder: Path, left: list[str]
    ) -> Result:
        """Run the experiment; left: gets sentences about what could not be restored."""

        def watch() -> None:
            if goal.is_cancel_requested:
                raise Cancelled("cancelled")
            if self._leaving.is_set() or self.stopping.is_set():
                raise Cancelled("the node is ending")

        feedback = Feedback(goal, RunExperiment.Feedback, watch)
        feedback.say("looking at the graph")
        robot, say = self._robot, feedback.say
        assert robot is not None, "a goal is accepted by an active node alone"
        robot.watch = watch
        seen = sees_rig(
            robot, self.parameters.read(BusSettings, "can"), self.parameters.read(RigBusSettings)
        )
        parts, hurried = folder / "parts" / experiment.name, self.stopping.is_set
        with closing(
            RigFixture(robot) if seen else OperatorFixture(robot, self._confirmed, say)
        ) as fixture, LiveStand(robot, self._publish, fixture, parts, say, left, hurried) as stand:
            lab = Lab(stand, folder, feedback.progress, stand.fingerprint())
            result = lab.run(experiment, settings)
        return result._replace(notes=(*result.notes, *stand.notes))

    def health(self) -> Health:
        """The running experiment."""
        return Health(OK, f"running {self._doing}" if self._doing else "idle", {})


class Outcome(NamedTuple):
    """How a goal ended: the action's result, and whether it succeeded or was cancelled."""

    result: Any
    succeeded: bool
    cancelled: bool = False


class OneGoalServer(ActionServer):
    """An action server that executes one goal at a time, in a thread.

    work: called in a thread with the goal handle; refusal: returns why no goal can be accepted,
    empty if one can. rclpy runs a goal as a task of the executor: a plain callback would delay
    cancel requests, and a coroutine that awaits the thread's future is polled in every spin, which
    keeps a core busy. Here the task is created only after the work.
    """

    def __init__(
        self,
        node: Node,
        kind: type,
        name: str,
        work: Callable[[ServerGoalHandle], Outcome],
        refusal: Callable[[], str],
    ):
        self._work, self._refusal = work, refusal
        self._thread: threading.Thread | None = None
        super().__init__(
            _BySystemTime(node),
            kind,
            name,
            work,  # which its thread does
            goal_callback=self._decide,
            cancel_callback=lambda goal: CancelResponse.ACCEPT,
        )

    @property
    def busy(self) -> bool:
        """Whether a goal is being executed."""
        return self._thread is not None and self._thread.is_alive()

    def _decide(self, request: Any) -> GoalResponse:
        refused = "a goal is being worked on: cancel it first" if self.busy else self._refusal()
        if refused:
            self._logger.error(f"goal refused: {refused}")
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    def notify_execute(self, goal_handle: ServerGoalHandle, execute_callback: Any) -> None:
        """Start the thread of an accepted goal; called by rclpy."""
        self._thread = threading.Thread(
            target=self._work_on, args=(goal_handle,), name="goal", daemon=True
        )
        self._thread.start()

    def _work_on(self, goal: ServerGoalHandle) -> None:
        outcome = self._work(goal)

        def finish(goal: ServerGoalHandle) -> Any:
            if outcome.cancelled and goal.is_cancel_requested:
                goal.canceled()
            elif outcome.succeeded:
                goal.succeed()
            else:
                goal.abort()
            return outcome.result

        super().notify_execute(goal, finish)


class _BySystemTime:
    """A node with the system clock, for the expiry of results: ROS time may stand still."""

    def __init__(self, node: Node):
        self._node, self._clock = node, Clock(clock_type=ClockType.SYSTEM_TIME)

    def get_clock(self) -> Clock:
        return self._clock

    def __getattr__(self, name: str) -> Any:
        return getattr(self._node, name)


class Feedback:
    """Publishes feedback of one goal; `watch` is called each time and may raise to end the goal.

    clock: for the remaining time; by default wall clock, also in simulated time.
    """

    def __init__(
        self,
        goal: Any,
        kind: type,
        watch: Callable[[], None],
        clock: WallClock = _WALL,
    ):
        self._goal, self._message, self._watch, self._clock = goal, kind(), watch, clock
        self._due = 0.0
        self._first = (0.0, math.inf)  # time and seconds of excitation done then

    def say(self, doing: str) -> None:
        """Publish the current step at once."""
        self._message.doing = doing
        self._goal.publish_feedback(self._message)

    def progress(self, experiment: str, done: float, total: float) -> None:
        """Publish the progress; done, total: seconds of excitation, from `Lab`.

        The remaining time is the remaining excitation times the pace so far.
        """
        self._watch()
        now = self._clock.now_ns() * 1e-9
        if done < self._first[1]:
            self._first = (now, done)
        begun, before = self._first
        # As if `_GOOD_S` had passed in real time at first, because preparations come first.
        pace = (now - begun + _GOOD_S) / (done - before + _GOOD_S)
        self._message.progress = min(done / total, 1.0) if total > 0.0 else 1.0
        self._message.remaining = (total - done) * max(pace, 1.0)
        if now >= self._due:
            self._due = now + _FEEDBACK_S
            self._goal.publish_feedback(self._message)

def _checked(request: RunExperiment.Goal, root: Path) -> tuple[Any, Any, Path]:
    """Return experiment, settings and folder of a goal; the folder must be below `root`.

    Raises ValueError that names the wrong field.
    """
    experiment = EXPERIMENTS.get(request.experiment)
    if experiment is None:
        raise ValueError(
            f"no experiment {shown(request.experiment)}; there are {', '.join(EXPERIMENTS)}"
        )
    settings = settings_from_yaml(request.settings, experiment.settings)
    if not request.folder:
        raise ValueError("folder is empty: name one for the results")
    folder = below(root, request.folder, "folder")
    below(root, str(folder / "parts" / experiment.name), "folder")
    written = [f"{experiment.name}.yaml", f"{experiment.name}.npz"]
    written += {
        calibration.NAME: [calibration.FILE], delivered_impedance.NAME: [calibration.GAIN_LIMITS]
    }.get(experiment.name, [])  # fmt: skip
    for name in written:
        if os.path.lexists(folder / name):  # also a dangling link
            raise ValueError(
                f"{folder / name} exists already and is never overwritten: name another folder, or "
                "move it away"
            )
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise ValueError(f"folder {folder} cannot be written: {error.strerror}") from error
    for need in experiment.needs:
        if not (folder / f"{need}.yaml").is_file():
            raise ValueError(f"{experiment.name} needs the result of {need} in {folder}")
    return experiment, settings, folder


def main() -> int:
    """Console entry point."""
    return run_node(CharacterizeNode)
