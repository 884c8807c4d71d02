# SPDX-License-Identifier: Apache-2.0
"""`characterize`: experiments of the identification (thesis chapters 4 to 6) on the live graph.

Action `~/run`: an experiment's name, settings as YAML, a folder for results and finished trials. An
empty name lists the experiments. The feedback requests the operator's actions; the operator
confirms each with `~/confirm`. The node is started by hand, beside the running robot.
"""

from __future__ import annotations

import os
import tempfile
import threading
import traceback
from contextlib import closing, suppress
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from screw_module_msgs.action import RunExperiment
from std_srvs.srv import Trigger

from screw_module_ros import graph
from screw_module_ros.can_io.bus import BusSettings
from screw_module_ros.clock import TimeStandsStill, WallClock
from screw_module_ros.identification import calibration, certificate, delivered_impedance
from screw_module_ros.identification.experiments import EXPERIMENTS, listing, settings_from_yaml
from screw_module_ros.identification.lab import Lab, MissingResult
from screw_module_ros.identification.results import Result
from screw_module_ros.identification.trials import Cancelled, NotPossible
from screw_module_ros.nodes.support.node import Node
from screw_module_ros.nodes.support.place import below, root_folder
from screw_module_ros.nodes.support.runtime import main as run_node
from screw_module_ros.nodes.support.states import OK, Health
from screw_module_ros.operator.client import RobotError
from screw_module_ros.operator.robot import Robot
from screw_module_ros.safety.checks import WatchSettings
from screw_module_ros.settings import Setting, shown

from .action import OneGoalServer, Outcome
from .bench import LiveBench
from .feedback import Feedback
from .fixture import fixture_of
from .loop import LiveLoop
from .rig_seen import RigBusSettings, sees_rig
from .samples import SamplesLost

_LEAVE_S, _RESULT_S = 60.0, 0.3
# Errors that end an experiment; their text is shown to the user.
_REASONS = (
    NotPossible, MissingResult, RobotError, SamplesLost, TimeStandsStill, ValueError, OSError
)  # fmt: skip
_WALL = WallClock()  # those who wait for this process, or for a result, use wall clock


class ResultsSettings(NamedTuple):
    """Folder of the results."""

    folder: Annotated[
        str, Setting("root folder of the results of all goals; no goal can write outside of it; "
                     "~ is the home folder", at_start=True)
    ] = "~/characterization"


class CharacterizeNode(Node):
    """Runs one experiment at a time in a thread; the main thread takes the samples."""

    def __init__(self):
        super().__init__("characterize")
        self.parameters.declare(ResultsSettings)
        self.parameters.declare(WatchSettings, "watch")
        self.parameters.declare(BusSettings, "can", channel=graph.bus_of("encoder"))
        self.parameters.declare(RigBusSettings)
        self._loop: LiveLoop | None = None
        self._robot: Robot | None = None  # of the experiment's thread
        self._leaving = threading.Event()
        self._confirmed = threading.Event()
        self._doing = ""
        self._server = OneGoalServer(
            self, RunExperiment, "~/run", self._work, self._refusal, self._cancelling
        )
        self.serve(Trigger, "~/confirm", self._confirm, "thank you", always=True)

    # Lifecycle -----------------------------------------------------------------------------

    def connect(self) -> None:
        """Create the topics, and the client of the experiments."""
        self._loop = LiveLoop(self)
        self._robot = Robot(
            f"{self.get_name()}_client", self.get_namespace(), simulated=self.clock.simulated
        )

    def begin(self) -> None:
        """Accept goals."""
        self._leaving.clear()

    def step(self) -> None:
        """One pass of the hot loop."""
        self._loop.step()

    def run(self) -> None:
        """Run until the process must end, then let the experiment restore the graph."""
        super().run()
        if self._server.busy:
            self.end()
            self.clock.idle()
            _WALL.sleep(_RESULT_S)  # the executor still runs and sends the result to the client

    def end(self) -> None:
        """Cancel the experiment; sampling continues until it has restored the graph."""
        self._leaving.set()
        end_ns = _WALL.now_ns() + round(_LEAVE_S * 1e9)
        while self._server.busy and _WALL.now_ns() < end_ns:
            with suppress(TimeStandsStill):  # it also ends the experiment's thread
                self._loop.step()

    def disconnect(self) -> None:
        """Remove the topics."""
        if self._loop is not None:
            self._loop.close()
            self._loop = None
        if self._robot is not None:
            self._robot.close()
            self._robot = None

    def destroy_node(self) -> None:
        """Destroy the action server, then the node."""
        self._server.destroy()
        super().destroy_node()

    # Action --------------------------------------------------------------------------------

    def _refusal(self) -> str:
        return "" if self.active else "the node is not active"

    def _cancelling(self) -> None:
        self._loop.halt()  # at once; the experiment's thread does the rest

    def _confirm(self, request: Trigger.Request) -> str:
        self._confirmed.set()
        return "" if self._server.busy else "nothing is being asked"

    def _work(self, goal: Any) -> Outcome:
        """Execute a goal; never raises."""
        request = goal.request
        if not request.experiment:
            return Outcome(RunExperiment.Result(success=True, message=listing()), True)
        self._doing = request.experiment
        try:
            return self._experiment(goal)
        except Exception as error:
            self.get_logger().error(traceback.format_exc())
            said = f"{request.experiment}: {type(error).__name__}: {error}"
            return _failed("; ".join([said, *_left(error)]))
        finally:
            self._doing = ""
            self.clock.leave()

    def _experiment(self, goal: Any) -> Outcome:
        request = goal.request
        left: list[str] = []
        cancelled, files = False, []
        text = ""
        try:
            root = root_folder(self.parameters.read(ResultsSettings).folder)
            experiment, settings, folder = _checked(request, root)
            kept = f"what was finished is kept in {folder}"
            result, left = self._measured(goal, experiment, settings, folder)
            files = [str(path) for path in _saved(result, folder, left)]
            text = result.as_yaml()
            message = f"{request.experiment} is done: {folder}"
        except Cancelled as error:
            cancelled, left = True, _left(error)
            message = f"{error}; {kept}"
        except _REASONS as error:
            left = _left(error)
            message = " ".join(str(error).split())
            cancelled = goal.is_cancel_requested
        message = "; ".join(dict.fromkeys([message, *left]))
        done = bool(text)
        if done and not left:
            self.get_logger().info(message)
        else:
            self.get_logger().warning(message)
        answer = RunExperiment.Result(success=done, message=message, result=text, files=files)
        return Outcome(answer, done, cancelled)

    def _measured(
        self, goal: Any, experiment: Any, settings: Any, folder: Path
    ) -> tuple[Result, list[str]]:
        """Run the experiment; return its result and sentences about what could not be restored.

        After an error these sentences are in the error's attribute `left` (see `_left`).
        """

        def watch() -> None:
            if goal.is_cancel_requested:
                raise Cancelled("cancelled")
            if self._leaving.is_set() or self.stopping.is_set():
                raise Cancelled("the node is ending")

        feedback = Feedback(goal, RunExperiment.Feedback, watch)
        feedback.say("looking at the graph")
        robot, loop = self._robot, self._loop
        robot.watch = watch
        bounds = self.parameters.read(WatchSettings, "watch")
        seen = sees_rig(
            robot, self.parameters.read(BusSettings, "can"), self.parameters.read(RigBusSettings)
        )
        with closing(
            fixture_of(seen, robot, self._confirmed, feedback.say, lambda: loop.sample)
        ) as fixture:
            bench = LiveBench(robot, loop, fixture, bounds, feedback.say, self.stopping.is_set)
            try:
                with bench:
                    lab = Lab(bench, folder, feedback.progress, bench.fingerprint())
                    result = experiment.run(lab, settings)
            except Exception as error:
                error.left = bench.left
                raise
        return result._replace(notes=(*result.notes, *bench.notes)), bench.left

    def health(self) -> Health:
        """The running experiment."""
        return Health(OK, f"running {self._doing}" if self._doing else "idle", {})


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
        calibration.NAME: [calibration.FILE], delivered_impedance.NAME: [certificate.FILE]
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


def _saved(result: Result, folder: Path, left: list[str]) -> list[Path]:
    """Write a result; return its files. After an error, `left` is in its attribute `left`."""
    try:
        return result.save(folder)
    except Exception as error:
        error.left = left
        raise


def _failed(message: str) -> Outcome:
    return Outcome(RunExperiment.Result(success=False, message=message), False)


def _left(error: Exception) -> list[str]:
    return getattr(error, "left", [])


def main() -> int:
    """Console entry point."""
    return run_node(CharacterizeNode)
