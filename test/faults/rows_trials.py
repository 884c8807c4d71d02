# SPDX-License-Identifier: Apache-2.0
"""Rows about trials: whoever sends them dies, or something does not fit their torque."""

from __future__ import annotations

import itertools

from acts import both, held_by, published
from row import AT_ONCE, BY_SERVICE, CLEAR, STOPPED, VIA_SUPERVISOR, Act, Report, Row
from screw_module_msgs.msg import ExcitationRequest, ForceCommand

from screw_module_ros import graph
from screw_module_ros.control.modes import EXCITATION, FORCE_FEEDBACK, IMPEDANCE
from screw_module_ros.operator.robot import RobotError

GROUP = "trials"
_NODE = "impedance_controller"
_EVERY_S = 0.1
_LEASE = 300 + 100
"""Samples: the sender has sent up to 0.1 s after it was told to end."""
_AMPLITUDE, _FREQUENCY, _TICKS = 0.3, 2.0, 60_000
_LIVELY = {"force_gain": 8.0, "chatter_limit": 50.0, "mode": FORCE_FEEDBACK}
_IDS = itertools.count(1)
_SILENT = Report(_NODE, "its sender has fallen silent", "fallen silent")


def _lease(robot, **sine) -> ExcitationRequest:
    """Begin a trial's lease while the torque is off; return the request, which may be changed."""
    robot.enable(False)
    request = ExcitationRequest(id=next(_IDS), **sine)
    robot.intruders.publish(ExcitationRequest, graph.EXCITATION, lambda: request, 0, _EVERY_S)

    def begun() -> bool:
        try:
            robot.set_mode(EXCITATION)
        except RobotError:
            return False
        return True

    robot.wait_until(begun, 3.0, "the lease does not begin")
    return request


def _acts(robot) -> None:
    """Enable, and wait for torque; what follows counts from here."""
    robot.enable()
    robot.wait_until(lambda: abs(robot.record.now.torque) > 0.02, 6.0, "no torque in the trial")
    robot.record.mark()


def _excited(robot) -> None:
    """Let a sine of torque act on the locked rotor."""
    robot.enable(False)
    robot.set_fixture("locked_rotor")
    request = _lease(robot)
    robot.enable()
    robot.pause(0.8)
    request.amplitude, request.frequency, request.ticks = _AMPLITUDE, _FREQUENCY, _TICKS
    request.id = next(_IDS)
    _acts(robot)


def _lively(robot) -> None:
    """Let a law of force feedback act as a trial wants it: more gain, and no chatter guard."""
    _lease(robot)
    robot.added["settings"] = robot.parameters(_NODE, _LIVELY)
    robot.set_parameters(_NODE, _LIVELY)
    _acts(robot)


def _killed(robot) -> float:
    """End whoever sends the trial's requests."""
    begin = robot.time
    robot.intruders.dismiss()
    return begin


def _as_before(robot) -> None:
    """Check that the controller has its own settings and mode again."""
    wanted = {**robot.added.pop("settings"), "mode": IMPEDANCE}
    robot.wait_until(
        lambda: robot.parameters(_NODE, wanted) == wanted, 2.0, "the trial's settings stay"
    )


_HAND = held_by("human_arm")


def _row(
    name: str, text: str, act: Act, who: str, within: int, report: Report, mend: Act = _HAND,
    services: tuple[str, ...] = STOPPED,
) -> Row:  # fmt: skip
    plane = within + VIA_SUPERVISOR
    return Row(name, GROUP, text, act, report, services, who, within, plane, mend=mend,
               watch=0.5)


ROWS = [
    _row("excitation-sender-killed", "whoever plays a sine of torque dies", both(_excited, _killed),
         "impedance_controller: the lease has lapsed", _LEASE + AT_ONCE, _SILENT),
    _row("trial-sender-killed", "whoever runs a law with a trial's gain, without chatter guard, "
         "dies", both(_lively, _killed), "impedance_controller: the lease has lapsed, all is "
         "put back", _LEASE + AT_ONCE, _SILENT, _as_before),
    _row("excitation-rotor-turns", "the rotor comes off its lock during a sine of torque",
         both(_excited, _HAND), "impedance_controller: the nut moves", BY_SERVICE + 100 + AT_ONCE,
         Report(_NODE, "the rotor is not locked", "not locked")),
    _row("excitation-another-mode", "a command of a law while the torque is enabled for a sine",
         both(_excited, published(ForceCommand, graph.FORCE_COMMAND, 1, 0.01, force=5.0,
                                  mode=IMPEDANCE)),
         "amplifier: another mode on an open gate", BY_SERVICE + AT_ONCE,
         Report("amplifier", "force command: mode IMPEDANCE", "force command"),
         services=(CLEAR, *STOPPED))._replace(shared=None),
]  # fmt: skip
