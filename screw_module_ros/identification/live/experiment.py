# SPDX-License-Identifier: Apache-2.0
"""Common steps of all live trials: recordings, zero of the transducer, torque on and off."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator

from screw_module_msgs.msg import AmplifierState, ImpedanceState, SafetyState

from screw_module_ros import graph
from screw_module_ros.clock import WallClock
from screw_module_ros.control.modes import OFF
from screw_module_ros.geometry import SCREW
from screw_module_ros.identification.trials import NotPossible, OnProgress
from screw_module_ros.loop.ticker import period_of
from screw_module_ros.operator.client import RobotError
from screw_module_ros.operator.robot import Robot
from screw_module_ros.safety.checks import WatchSettings

from .fixture import Fixture
from .graph import disabling, parameters, topic_of
from .loop import LiveLoop
from .samples import Recording, Zero, zero_of

_ZERO_S = 0.5
_SILENT_S = 2.0
_PERMIT_S = 10.0
_POLL_S = 0.05
_CLEAN_UP_S, _HURRIED_S = 40.0, 10.0
_SENSORS = ("encoder", "force_sensor")
_WALL = WallClock()  # for the shutdown of the process, which does not wait by the robot's time


class Experiment:
    """Access of one goal to the graph.

    rate: of the samples [1/s]; period_ns; watch: bounds of valid samples; say: shows the current
    step to the user; notes: sentences for the result.
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
        self.robot, self.loop, self.fixture = robot, loop, fixture
        self.watch, self.say, self._hurried = watch, say, hurried
        self.notes: list[str] = []
        check_screw(robot, "encoder")
        self.rate = common_rate(robot)
        self.period_ns = period_of(self.rate)
        self._torque_on = False

    # Samples -------------------------------------------------------------------------------

    def recording(self, seconds: float) -> Recording:
        """Start and return a recording with room for `seconds`."""
        recording = Recording(max(2, round(seconds * self.rate)))
        self.loop.record(recording)
        return recording

    def wait(
        self,
        recording: Recording,
        done: Callable[[], bool],
        deadline_s: float,
        on_progress: Callable[[float], None] = lambda elapsed: None,
    ) -> None:
        """Wait until `done` while samples arrive; `on_progress` gets the seconds since the start.

        Raises RobotError if no samples arrive or the deadline passes, and errors of `on_progress`.
        """
        clock = self.robot.clock
        begun = newest = clock.now_ns() * 1e-9
        count = recording.encoder.count
        while not done():
            self.robot.pause(_POLL_S)
            now = clock.now_ns() * 1e-9
            on_progress(now - begun)
            if recording.encoder.count != count:
                count, newest = recording.encoder.count, now
            if now - newest > _SILENT_S and not recording.full:
                raise RobotError(f"the encoder is silent{self.robot.complaints_text()}")
            if now - begun > deadline_s:
                raise RobotError(f"not done after {deadline_s:.0f} s, given up")

    def zero(self) -> Zero:
        """Return the transducer's present reading, a mean of half a second."""
        recording = self.recording(_ZERO_S)
        self.wait(recording, lambda: recording.full, 4.0 * _ZERO_S + _SILENT_S)
        self.loop.record(None)
        return zero_of(recording)

    def unloaded_zero(self) -> Zero:
        """Unload the handle and return the transducer's reading; the handle stays unloaded."""
        self.fixture.unload()
        return self.zero()

    def check_homed(self) -> None:
        """Raise NotPossible, with the way out, unless the encoder is homed."""
        self.robot.met(lambda: self.loop.sample is not None, _SILENT_S)
        sample = self.loop.sample
        if sample is None:
            raise NotPossible("the encoder is silent: start and activate it first")
        if not sample.homed:
            home = topic_of(self.robot, "encoder/home")
            raise NotPossible(
                "the encoder is not homed: bring the nut to the reference mark, then "
                f"ros2 service call {home} std_srvs/srv/Trigger"
            )

    def check_height(self, height: float, within: float = 1e-3) -> None:
        """Raise NotPossible if the encoder's height differs from the handle's height [m]."""
        shown = self.loop.sample.position
        if abs(shown - height) > within:
            raise NotPossible(
                f"the handle is at {1e3 * height:.1f} mm, the encoder shows {1e3 * shown:.1f} mm: "
                "home the encoder at the reference mark"
            )

    # Torque --------------------------------------------------------------------------------

    def check_passive(self) -> None:
        """Raise NotPossible, with the way out, if torque may act."""
        robot = self.robot
        if robot.node.count_publishers(graph.AMPLIFIER_STATE) == 0:
            return  # no amplifier node, no heartbeat: the drive is off
        robot.met(lambda: robot.state(AmplifierState) is not None, _SILENT_S)
        amplifier, controller = robot.state(AmplifierState), robot.state(ImpedanceState)
        if amplifier is not None and amplifier.enabled:
            if controller is None or controller.mode != OFF:
                raise NotPossible(
                    "the module must be passive, and the amplifier is enabled; disable it: "
                    f"{disabling(robot, 'amplifier')}"
                )

    def enable(self) -> None:
        """Wait for the supervisor's permission and switch the torque on. Raises RobotError."""
        robot = self.robot

        def permitted() -> bool:
            state = robot.state(SafetyState)
            return state is not None and state.vertical_permitted

        if not robot.met(permitted, _PERMIT_S):
            state = robot.state(SafetyState)
            why = "; ".join(state.reasons) if state else "the supervisor is silent"
            why = why or ("the lock pin is in" if state.vertical_locked else "no reason given")
            raise RobotError(f"no permission to move: {why}")
        self._torque_on = True
        robot.enable()

    def check_enabled(self) -> None:
        """Raise RobotError with the reason if the torque is off, or if nobody says that it is on.

        A killed amplifier's drive is off, by its own guards.
        """
        robot = self.robot
        if not robot.met(lambda: robot.state(AmplifierState) is not None, _SILENT_S):
            raise RobotError(f"the amplifier is silent{robot.complaints_text()}")
        state = robot.newest(AmplifierState)
        if not state.enabled:
            raise RobotError(f"the amplifier switched the torque off: {state.reason}")

    def torque_off(self) -> None:
        """Command zero; disable the amplifier if this experiment enabled it. Raises RobotError."""
        self.loop.halt()
        if self._torque_on:
            self.robot.enable(False)
            self._torque_on = False

    @contextlib.contextmanager
    def unhurried(self) -> Iterator[None]:
        """Ignore cancellation in the block, for the restoration of the graph; limited in time.

        Raises RobotError if the block takes too long.
        """
        watch, begun_ns = self.robot.watch, _WALL.now_ns()

        def in_time() -> None:
            limit_s = _HURRIED_S if self._hurried() else _CLEAN_UP_S
            if (_WALL.now_ns() - begun_ns) * 1e-9 > limit_s:
                raise RobotError(f"the restoration of the graph took longer than {limit_s:g} s")

        self.robot.watch = in_time
        try:
            yield
        finally:
            self.robot.watch = watch


def check_screw(robot: Robot, node: str) -> None:
    """Raise NotPossible if encoder or amplifier has another lead than excitation and fits."""
    lead = parameters(robot, node, ("lead",))["lead"]
    if lead != SCREW.lead:
        raise NotPossible(
            f"{node} runs with a lead of {1e3 * lead:g} mm: the experiments are for a screw of "
            f"{1e3 * SCREW.lead:g} mm, their torques and fits would be wrong by the ratio"
        )


def common_rate(robot: Robot) -> float:
    """Return the tick rate of both sensors [1/s].

    Raises NotPossible if the rates differ, or if a sensor's clock differs from this node's.
    """
    found = [parameters(robot, node, ("rate", "use_sim_time")) for node in _SENSORS]
    for node, values in zip(_SENSORS, found, strict=True):
        if values["use_sim_time"] != robot.clock.simulated:
            raise NotPossible(
                f"{node} runs with use_sim_time {str(values['use_sim_time']).lower()}, "
                "characterize does not: start it with the same"
            )
    rates = [values["rate"] for values in found]
    if rates[0] != rates[1]:
        raise NotPossible(
            f"encoder at {rates[0]:g} and force_sensor at {rates[1]:g} samples per second: start "
            "both with the same rate"
        )
    return rates[0]


def share_of(on_progress: OnProgress, seconds: float) -> Callable[[float], None]:
    """Return a callback for `wait` that converts elapsed time to a share of `seconds` [s]."""
    return lambda elapsed: on_progress(min(elapsed / seconds, 1.0))
