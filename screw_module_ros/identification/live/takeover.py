# SPDX-License-Identifier: Apache-2.0
"""Replaces `impedance_controller` for torque trials, and restores it afterwards.

The amplifier accepts only one commanding node, and the supervisor requires a controller. So the
controller is cleaned up, which removes its publishers, `characterize` publishes instead, and the
amplifier is configured without its linearization and with wider limits of force and force rate. The
restoration verifies every step and reports what it could not restore.
"""

from __future__ import annotations

from collections.abc import Callable

from screw_module_msgs.msg import AmplifierState, PlanarState, SafetyState

from screw_module_ros.clock import TimeStandsStill
from screw_module_ros.control.limits import TRIAL_RATE
from screw_module_ros.geometry import torque_to_force
from screw_module_ros.identification.trials import NotPossible
from screw_module_ros.operator.client import RobotError
from screw_module_ros.operator.robot import Robot
from screw_module_ros.safety.checks import LARGEST_COMMAND, WatchSettings

from .graph import (
    ACTIVE,
    INACTIVE,
    UNCONFIGURED,
    bring,
    disabling,
    lifecycle_state,
    parameters,
    topic_of,
)
from .loop import LiveLoop
from .torque_source import TorqueSource

CONTROLLER, AMPLIFIER = "impedance_controller", "amplifier"
_MARGIN = 1.02  # of the force limits above the peak
_ANSWER_S = 10.0


class Takeover:
    """Replacement of the controller. source: computes the commands meanwhile, else None."""

    def __init__(self, robot: Robot, loop: LiveLoop):
        self.source: TorqueSource | None = None
        self._robot, self._loop = robot, loop
        self._found: dict[str, object] = {}
        self._begun = False

    def take(self, peak: float, watch: WatchSettings, period_ns: int) -> TorqueSource:
        """Replace the controller for torque commands up to `peak` [Nm]; return the source.

        Raises NotPossible if the robot's state does not permit it, RobotError if a step fails;
        `give_back` undoes the steps so far.
        """
        force = torque_to_force(peak)
        if force > LARGEST_COMMAND:
            largest = peak * LARGEST_COMMAND / force
            raise NotPossible(
                f"a torque command of {peak:.3f} Nm: the amplifier accepts at most "
                f"{largest:.3f} Nm ({LARGEST_COMMAND:g} N)"
            )
        if self._begun and min(self._limits()) >= force:
            return self.source
        if not self._begun:
            self._check_robot()
            self._found = parameters(
                self._robot, AMPLIFIER, ("linearize", "command_up", "command_down", "command_rate")
            )
            _check_own(self._found)
            self._begun = True
            bring(self._robot, CONTROLLER, UNCONFIGURED)
            self.source = self._loop.take_place(watch, period_ns)
        bring(self._robot, AMPLIFIER, INACTIVE)
        bring(self._robot, AMPLIFIER, UNCONFIGURED)
        wide = min(LARGEST_COMMAND, _MARGIN * force)
        widened = {
            name: max(float(self._found[name]), wide) for name in ("command_up", "command_down")
        }
        freed = {"linearize": False, "command_rate": TRIAL_RATE}
        self._robot.set_parameters(AMPLIFIER, {**freed, **widened})
        bring(self._robot, AMPLIFIER, ACTIVE)
        self._wait_until_ready()
        return self.source

    def _limits(self) -> list[float]:
        return list(parameters(self._robot, AMPLIFIER, ("command_up", "command_down")).values())

    def _check_robot(self) -> None:
        robot = self._robot
        for node in (CONTROLLER, AMPLIFIER):
            if lifecycle_state(robot, node) != ACTIVE:
                name = topic_of(robot, node)
                raise NotPossible(f"{node} is not active: ros2 lifecycle set {name} activate")
        check_disabled(robot)
        plane = robot.state(PlanarState)
        if plane is not None and plane.enabled:
            raise NotPossible(
                "the plane is enabled, and the amplifier must restart; disable it: "
                f"{disabling(robot, 'manus')}"
            )
        check_not_stopped(robot)

    def _wait_until_ready(self) -> None:
        """Wait until the amplifier passes commands on as they are and reports no fault."""

        def ready() -> bool:
            state = self._robot.state(AmplifierState)
            if state is None or state.state == AmplifierState.UNKNOWN:
                return False
            return state.calibration == "none" and not state.faulted

        if self._robot.met(ready, 1.0):
            return
        self._robot.clear_amplifier()  # a restart on a busy machine can latch a fault
        self._robot.wait_until(ready, _ANSWER_S, "the amplifier did not come back without fault")

    def give_back(self) -> list[str]:
        """Undo `take`; return sentences about what could not be restored."""
        if not self._begun:
            return []
        left: list[str] = []

        def attempt(what: str, action: Callable[[], None]) -> None:
            try:
                action()
            except (RobotError, TimeStandsStill) as error:  # what comes next may still succeed
                left.append(f"{what}: {error}")

        attempt("amplifier not stopped", lambda: bring(self._robot, AMPLIFIER, UNCONFIGURED))
        attempt("amplifier's settings not restored", self._restore)
        if self.source is not None:
            self.source = None
            attempt("the controller's place not left", self._leave_place)
        attempt("amplifier not restarted", lambda: bring(self._robot, AMPLIFIER, ACTIVE))
        attempt("controller not restarted", lambda: bring(self._robot, CONTROLLER, ACTIVE))
        self._begun = False
        return left

    def _leave_place(self) -> None:
        self._loop.leave_place(self._robot.met)

    def _restore(self) -> None:
        self._robot.set_parameters(AMPLIFIER, self._found)
        now = parameters(self._robot, AMPLIFIER, self._found)
        if now != self._found:
            raise RobotError(f"{self._found} was wanted, they are {now}")


def _check_own(found: dict[str, object]) -> None:
    """Raise NotPossible if these settings of the amplifier are those of a torque trial.

    An experiment whose process was killed cannot restore them; the next one must not take them for
    the robot's own.
    """
    if not found["linearize"] and found["command_rate"] >= TRIAL_RATE:
        raise NotPossible(
            "the amplifier still has the wide limits of a torque trial, whose process was killed: "
            "start amplifier and impedance_controller anew"
        )


def check_disabled(robot: Robot) -> None:
    """Raise NotPossible, with the way out, unless the amplifier reports that it is disabled."""
    if not robot.met(lambda: robot.state(AmplifierState) is not None, _ANSWER_S):
        raise NotPossible("the amplifier is silent: start and activate it first")
    if robot.newest(AmplifierState).enabled:
        raise NotPossible(f"the amplifier is enabled; disable it: {disabling(robot, AMPLIFIER)}")


def check_not_stopped(robot: Robot) -> None:
    """Raise NotPossible, with the way out, if the supervisor has stopped the robot."""
    if not robot.met(lambda: robot.state(SafetyState) is not None, _ANSWER_S):
        raise NotPossible("the supervisor is silent: start and activate it first")
    state = robot.state(SafetyState)
    if state.level == SafetyState.STOPPED:
        raise NotPossible(
            f"the supervisor has stopped the robot ({'; '.join(state.reasons)}): ros2 service call "
            f"{topic_of(robot, 'supervisor/reset')} std_srvs/srv/Trigger"
        )
