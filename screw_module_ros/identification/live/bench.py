# SPDX-License-Identifier: Apache-2.0
"""The live graph as a bench: trials with the running nodes, on the rig or on hardware.

    with LiveBench(robot, loop, fixture, watch, say) as bench:
        result = experiment.run(Lab(bench, folder), settings)

At the end of each trial, after a cancellation and after an error, the torque first goes to zero and
the amplifier is disabled. On exit the bench restores the graph's former state; `left` lists what it
could not restore.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any

from screw_module_msgs.msg import AmplifierState, ImpedanceState

from screw_module_ros.identification.trials import (
    MOTION,
    RELEASE,
    STAGE,
    TORQUE,
    OnProgress,
    Samples,
    StageTrial,
    TorqueTrial,
    Trial,
    require,
)
from screw_module_ros.operator.client import RobotError
from screw_module_ros.operator.robot import Robot
from screw_module_ros.safety.checks import WatchSettings

from .experiment import Experiment
from .fixture import Fixture
from .loop import LiveLoop
from .motion import Motion
from .takeover import Takeover
from .trials import stage_trial, torque_trial

_HEARD_S = 2.0


def _in_time(method: Callable) -> Callable:
    """Let the thread take part in simulated time during the call, but not in its computations."""

    @wraps(method)
    def working(bench: LiveBench, *args: Any) -> Any:
        with bench.clock.working():
            return method(bench, *args)

    return working


class LiveBench:
    """A `trials.Bench` on the live graph, for one experiment; one thread calls it.

    left: sentences about what could not be restored on exit; notes: for the result; clock: of the
    graph.
    """

    def __init__(
        self,
        robot: Robot,
        loop: LiveLoop,
        fixture: Fixture,
        watch: WatchSettings,
        say: Callable[[str], None],
        hurried: Callable[[], bool] = lambda: False,
    ):
        """Start sampling. Raises NotPossible, RobotError.

        say: shows the current step to the user; hurried: whether the restoration must be quick.
        """
        self.left: list[str] = []
        self.clock = robot.clock
        with self.clock.working():
            self._experiment = Experiment(robot, loop, fixture, watch, say, hurried)
        self._takeover = Takeover(robot, loop)
        self._motion = Motion(self._experiment)
        self.rate = self._experiment.rate
        self.offers = frozenset({TORQUE, STAGE, MOTION, *([RELEASE] if fixture.simulated else [])})
        self.name = f"live graph, {'simulated rig' if fixture.simulated else 'hardware'}"
        loop.wake()

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences about the graph for the notes of the result."""
        return tuple(self._experiment.notes)

    @_in_time
    def fingerprint(self) -> str:
        """Return the graph's calibrations; parts measured with others are not reused."""
        robot = self._experiment.robot
        kinds = (AmplifierState, ImpedanceState)
        robot.met(lambda: all(robot.state(kind) for kind in kinds), _HEARD_S)
        states = [robot.state(kind) for kind in kinds]
        return ", ".join(state.calibration if state else "unknown" for state in states)

    @_in_time
    def record(self, trial: Trial, on_progress: OnProgress) -> Samples:
        """Do a trial. Raises NotPossible, Cancelled, RobotError, SamplesLost."""
        require(trial, self)
        on_progress(0.0)
        try:
            return self._record(trial, on_progress)
        finally:
            self._torque_off()

    def _record(self, trial: Trial, on_progress: OnProgress) -> Samples:
        if isinstance(trial, TorqueTrial):
            return torque_trial(self._experiment, self._takeover, trial, on_progress)
        self._give_back()  # restores the controller after a torque trial
        if isinstance(trial, StageTrial):
            return stage_trial(self._experiment, trial, on_progress)
        return self._motion.trial(trial, on_progress)

    @_in_time
    def zero(self) -> tuple[float, float, float, float, float, float]:
        """Return the tared transducer's reading without load: forces [N], torques [Nm], x to z."""
        experiment, fixture = self._experiment, self._experiment.fixture
        if fixture.mounted() in ("free", "locked_rotor"):
            return experiment.zero().wrench
        fixture.require(fixture.mounted() or "human_arm")
        experiment.check_passive()
        zero = experiment.unloaded_zero()
        fixture.reload()
        return zero.wrench

    def _torque_off(self) -> None:
        with self._experiment.unhurried():
            try:
                self._experiment.torque_off()
            except RobotError as error:
                self.left.append(f"amplifier not disabled: {error}")

    def _give_back(self) -> None:
        with self._experiment.unhurried():
            self.left += self._takeover.give_back()

    def __enter__(self) -> LiveBench:
        return self

    @_in_time
    def __exit__(self, *_: object) -> None:
        self._torque_off()
        self._give_back()
        with self._experiment.unhurried():
            self.left += self._motion.put_back()
            try:
                self._experiment.fixture.put_back()
            except RobotError as error:
                self.left.append(f"handle not restored: {error}")
        self._experiment.loop.sleep()
