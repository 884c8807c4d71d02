# SPDX-License-Identifier: Apache-2.0
"""Rows about faults of a CiA 402 drive."""

from __future__ import annotations

from acts import both, cured, fault, frozen, game, held_by, refused
from row import (
    APART,
    AT_ONCE,
    CLEAR,
    COMMAND,
    DYING,
    ENABLE,
    HEARTBEAT,
    HOME,
    PLANE_BACK,
    RESET,
    SLOW,
    STOPPED,
    VIA_SUPERVISOR,
    Report,
    Row,
    goes_on,
)
from std_srvs.srv import SetBool, Trigger

GROUP = "drives"
_SILENT = COMMAND + 4 + DYING
_BEAT = HEARTBEAT + 2 + DYING
_MODE = 100 + AT_ONCE
"""Samples: the drive's second PDO reports the mode each 100 ms."""
_STUCK = 400
"""Samples until a lasting wrong torque is detected, by its duration and by the position."""
_FAR = (0.12, 0.1, 0.31, 0.0, 0.0, 0.0)
"""A set point [m], [m/s] whose spring of 100 N/m turns an arm that nobody holds."""
_UNMOVED = 300
"""Samples until the set point is that far, and the joint has not moved in 0.1 s of 3 Nm."""

# fault of the rig, text, samples until noticed (0 = continues), regular expression of the alarm
_FAULTS = {
    "over_current": ("over-current, 2310", AT_ONCE, "2310"),
    "over_temperature": ("device too hot, 4210", AT_ONCE, "4210"),
    "fault": ("a fault with an unknown code", AT_ONCE, "5000|fault"),
    "disable": ("it drops to switch on disabled by itself", AT_ONCE, "left operation enabled"),
    "torque_off": ("safe torque off", AT_ONCE, "left operation enabled"),
    "mode_lost": ("it leaves torque mode", _MODE, "torque mode"),
    "heartbeat_lost": ("its heartbeat stops, all else continues", _BEAT, "heartbeat"),
    "pdos_lost": ("its PDOs stop, all else continues", _SILENT, "drive|position"),
    "deaf": ("it receives nothing: RPDO timeout, heartbeat of the master lost", _SILENT,
             "RPDO|8250|8130|heartbeat|position|PRE-OPERATIONAL"),
    "rpdos_lost": ("only our RPDOs do not arrive: RPDO timeout", _SILENT, "RPDO|8250|position"),
    "reset": ("it restarts in operation", AT_ONCE, "restarted|boot-up|position"),
    "hung": ("its communication hangs until it is reset", _SILENT, "silent|heartbeat|position"),
    "power_off": ("it loses its supply, later back", AT_ONCE,
                  "restarted|boot-up|heartbeat|position"),
    "stuck_torque": ("it gives a torque without a command", _STUCK, "torque|disagree|turns"),
    "motor_open": ("a motor wire is broken: enabled, but no torque", 0, ""),
    "warning": ("it reports a warning (statusword bit 7)", 0, ""),
    "sdo_silent": ("it does not answer SDO requests", 0, ""),
    "inputs": ("its limit switch inputs are set", 0, ""),
    "position_freeze": ("its position stands still", APART, ""),
    "position_jump": ("its position jumps", SLOW, ""),
}  # fmt: skip
_CONTROLLERS = ("position_freeze", "position_jump")
# The planar drives have the same driver; the rows cover what differs with two of them.
_PLANAR = {
    "over_current": ("shoulder", "elbow"), "disable": ("shoulder",), "pdos_lost": ("shoulder",),
    "deaf": ("shoulder",), "reset": ("shoulder", "elbow"), "power_off": ("shoulder",),
    "stuck_torque": ("shoulder",),
}  # fmt: skip


def _vertical(name: str, text: str = "") -> Row:
    """Return the row of a fault of the vertical drive."""
    known, within, said = _FAULTS[name]
    inject, mend, text = fault("drive", name), cured("drive"), f"drive: {text or known}"
    if not within:
        return goes_on(f"drive-{name}", GROUP, text, inject, "no node: no torque is excessive",
                       mend, watch=0.3, limp=name == "motor_open")  # fmt: skip
    report = Report("amplifier", said, "amplifier")
    if name == "pdos_lost":  # which node is first depends on the rate
        report = Report("supervisor", "amplifier|disagree", "amplifier|disagree")
    row = Row(
        f"drive-{name}", GROUP, text, inject, report, (CLEAR, *STOPPED),
        "amplifier; the drive itself", within, within + VIA_SUPERVISOR, mend=mend,
    )  # fmt: skip
    if name not in _CONTROLLERS:
        return row
    return row._replace(
        inject=frozen("drive", name) if name == "position_freeze" else inject,
        report=Report("impedance_controller", "disagree", "disagree"), services=(HOME, *STOPPED),
        noticed_by="impedance_controller",
    )  # fmt: skip


def _planar(device: str, name: str, text: str, within: int, said: str) -> Row:
    """Return the row of a fault of a joint's drive."""
    return Row(f"{device}-{name}", GROUP, f"{device}: {text}", fault(device, name),
               Report("manus", said, "manus"), PLANE_BACK, "manus; the drive itself",
               within + VIA_SUPERVISOR, within, mend=cured(device))  # fmt: skip


def _await_disabled(robot) -> None:
    robot.wait_until(
        lambda: "amplifier" in robot.record.disabled_at, 2.0, "the amplifier is still enabled"
    )


def _restarted_without_limit(robot) -> float:
    """Restart the drive so that it refuses a torque limit; it must stay disabled."""
    fault("drive", "refuse_torque_limit")(robot)
    begin = fault("drive", "reset")(robot)
    _await_disabled(robot)
    robot.pause(0.5)
    answer = robot.call(Trigger, CLEAR, deadline_s=6.0)
    assert answer.success, answer.message
    robot.wait_until(
        lambda: robot.call(Trigger, RESET).success, 5.0, "supervisor/reset is refused"
    )
    refused(ENABLE[0], SetBool, "6072", data=True)(robot)
    return begin


# A robot that has not seen the fault yet is enabled: it would grant `enable` rightly.
_CLEAR_IN_VAIN = both(_await_disabled, refused(ENABLE[0], SetBool, data=True), refused(CLEAR))
ROWS = [_vertical(name) for name in _FAULTS]
ROWS += [
    _planar(device, name, *_FAULTS[name]) for name, devices in _PLANAR.items() for device in devices
]
ROWS += [
    _planar("shoulder", "position_jump", "its position jumps", AT_ONCE, "jumped"),
    # On a frozen joint the torque is beyond what balance explains.
    _planar("shoulder", "position_freeze", "its position stands still, the set point moves away, "
            "nobody holds the handle", _UNMOVED, "has not changed by a count")._replace(
        inject=both(held_by("free"), fault("shoulder", "position_freeze"), game(*_FAR)),
        mend=both(cured("shoulder"), held_by("human_arm")),
        noticed_by="manus: more than 3 Nm on the joint for 0.1 s"),
    _vertical("over_temperature", "too hot; cleared too early")._replace(
        name="drive-cleared-too-early",
        inject=both(fault("drive", "over_temperature"), _CLEAR_IN_VAIN)),
    _vertical("reset", "it restarts and refuses a torque limit, 6072")._replace(
        name="drive-refuses-6072", inject=_restarted_without_limit,
        mend=both(cured("drive"), fault("drive", "reset")),
        report=Report("amplifier", "torque limit 6072", "amplifier"),
        noticed_by="amplifier: not enabled without its guards"),
]  # fmt: skip
