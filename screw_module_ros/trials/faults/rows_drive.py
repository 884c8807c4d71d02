# SPDX-License-Identifier: Apache-2.0
"""Rows about faults of a CiA 402 drive."""

from __future__ import annotations

from collections.abc import Iterator

from std_srvs.srv import SetBool, Trigger

from .acts import both, cured, fault, frozen, game, held_by
from .limits import APART, AT_ONCE, COMMAND, DYING, HEARTBEAT, SLOW, VIA_SUPERVISOR
from .row import GOES_ON, OFF, PLANE_BACK, Alarm, Failed, Row

GROUP = "drives"
_SILENT = COMMAND + 4 + DYING
_BEAT = HEARTBEAT + 2 + DYING
_MODE = 100 + AT_ONCE
"""Samples: the drive's second PDO reports the mode each 100 ms."""
_STUCK = 400
"""Samples until a lasting wrong torque is detected, by its duration and by the position."""
_FAR = (0.12, -0.1, 0.31, 0.0, 0.0, 0.0)
"""A set point [m], [m/s] whose spring of 100 N/m turns an arm that nobody holds."""
_UNMOVED = 300
"""Samples until the set point is that far, and the joint has not moved in 0.1 s of 3 Nm."""

# fault of the rig, text, samples until noticed (0 = continues), regular expression of the alarm
_FAULTS = (
    ("over_current", "over-current, 2310", AT_ONCE, "2310"),
    ("over_temperature", "device too hot, 4210", AT_ONCE, "4210"),
    ("fault", "a fault with an unknown code", AT_ONCE, "5000|fault"),
    ("disable", "it drops to switch on disabled by itself", AT_ONCE, "left operation enabled"),
    ("torque_off", "safe torque off", AT_ONCE, "left operation enabled"),
    ("mode_lost", "it leaves torque mode", _MODE, "torque mode"),
    ("heartbeat_lost", "its heartbeat stops, all else continues", _BEAT, "heartbeat"),
    ("pdos_lost", "its PDOs stop, all else continues", _SILENT, "drive|position"),
    ("deaf", "it receives nothing: RPDO timeout, heartbeat of the master lost",
     _SILENT, "RPDO|8250|8130|heartbeat|position|PRE-OPERATIONAL"),
    ("rpdos_lost", "only our RPDOs do not arrive: RPDO timeout", _SILENT,
     "RPDO|8250|position"),
    ("reset", "it restarts in operation", AT_ONCE, "restarted|boot-up|position"),
    ("power_off", "it loses its supply, later back", AT_ONCE,
     "restarted|boot-up|heartbeat|position"),
    ("stuck_torque", "it gives a torque without a command", _STUCK, "torque|disagree|turns"),
    ("motor_open", "a motor wire is broken: enabled, but no torque", 0, ""),
    ("warning", "it reports a warning (statusword bit 7)", 0, ""),
    ("sdo_silent", "it does not answer SDO requests", 0, ""),
    ("inputs", "its limit switch inputs are set", 0, ""),
)  # fmt: skip
# The planar drives have the same driver; the rows cover what differs with two of them.
_SHOULDER_TOO = ("over_current", "disable", "pdos_lost", "deaf", "reset", "power_off",
                 "stuck_torque")  # fmt: skip
_ELBOW_TOO = ("over_current", "reset")
_BACK = {
    "amplifier": "mend it; amplifier/clear_fault, reset, enable",
    "manus": PLANE_BACK,
}


def rows() -> Iterator[Row]:
    """The vertical drive with every fault, the planar ones with some."""
    for name, text, within, alarm_text in _FAULTS:
        yield _row("drive", "amplifier", name, text, within, alarm_text)
    for name, text, within, alarm_text in _FAULTS:
        if name in _SHOULDER_TOO:
            yield _row("shoulder", "manus", name, text, within, alarm_text)
        if name in _ELBOW_TOO:
            yield _row("elbow", "manus", name, text, within, alarm_text)
    for name, text, within, inject in (
        ("position_freeze", "its position stands still", APART, frozen),
        ("position_jump", "its position jumps", SLOW, fault),
    ):
        yield _row("drive", "amplifier", name, text, within, "")._replace(
            inject=inject("drive", name),
            alarm=Alarm("impedance_controller", "disagree", "disagree"),
            noticed_by="impedance_controller",
            recovery="reset, enable",
        )
    yield _row("shoulder", "manus", "position_jump", "its position jumps", AT_ONCE, "jumped")
    yield _frozen_joint()
    yield _refuses_to_enable()
    yield _without_limit()


def _row(device: str, node: str, name: str, text: str, within: int, alarm_text: str) -> Row:
    stops = within > 0
    follows = within + VIA_SUPERVISOR
    vertical, plane = (within, follows) if device == "drive" else (follows, within)
    return Row(
        name=f"{device}-{name}",
        group=GROUP,
        fault=f"{device}: {text}",
        inject=fault(device, name),
        back=cured(device),
        alarm=_alarm(device, node, name, alarm_text) if stops else None,
        recovery=_BACK[node] if stops else "none is needed",
        noticed_by=f"{node}; the drive itself" if stops else "no node: no torque is excessive",
        within=vertical if stops else 0,
        plane_within=plane if stops else 0,
        safe=OFF if stops else GOES_ON,
        watch=0.2 if stops else 0.3,
        limp=name == "motor_open",
    )


def _alarm(device: str, node: str, name: str, alarm_text: str) -> Alarm:
    if (device, name) == ("drive", "pdos_lost"):  # which node is first depends on the rate
        return Alarm("supervisor", "amplifier|disagree", "amplifier|disagree")
    return Alarm(node, alarm_text, node)


def _frozen_joint() -> Row:
    """Return the row of a frozen joint on which the torque is beyond what balance explains."""
    return _row(
        "shoulder", "manus", "position_freeze",
        "its position stands still, the set point moves away, nobody holds the handle",
        _UNMOVED, "has not changed by a count",
    )._replace(
        inject=both(held_by("free"), fault("shoulder", "position_freeze"), game(*_FAR)),
        back=both(cured("shoulder"), held_by("human_arm")),
        noticed_by="manus: more than 3 Nm on the joint for 0.1 s",
        recovery="mend it; manus/clear_fault, manus/home, reset, enable",
    )  # fmt: skip


def _refuses_to_enable() -> Row:
    """Return the row of over-temperature with a clear_fault while the cause persists."""
    row = _row("drive", "amplifier", "over_temperature", "too hot; cleared too early", AT_ONCE,
               "4210")  # fmt: skip
    return row._replace(
        name="drive-cleared-too-early",
        inject=both(fault("drive", "over_temperature"), _clear_in_vain),
    )


def _without_limit() -> Row:
    """Return the row of a restarted drive without a torque limit, which must stay disabled."""
    row = _row("drive", "amplifier", "reset", "it restarts and refuses a torque limit, 6072",
               AT_ONCE, "6072")  # fmt: skip
    return row._replace(
        name="drive-refuses-6072",
        inject=_restarted_without_limit,
        back=both(cured("drive"), fault("drive", "reset")),
        alarm=Alarm("amplifier", "torque limit 6072", "amplifier"),
        noticed_by="amplifier: not enabled without its guards",
    )


def _restarted_without_limit(testbed) -> float:
    fault("drive", "refuse_torque_limit")(testbed)
    begin = fault("drive", "reset")(testbed)
    robot = testbed.robot
    _await_disabled(testbed)
    robot.pause(0.5)
    answer = robot.call(Trigger, "amplifier/clear_fault", deadline_s=6.0)
    if not answer.success:
        raise Failed(f"amplifier/clear_fault: {answer.message}")
    robot.wait_until(
        lambda: robot.call(Trigger, "supervisor/reset").success, 5.0, "supervisor/reset is refused"
    )
    answer = robot.call(SetBool, "amplifier/enable", SetBool.Request(data=True))
    if answer.success or "6072" not in answer.message:
        raise Failed(f"amplifier/enable without a torque limit: {answer.message!r}")
    return begin


def _clear_in_vain(testbed) -> None:
    """Request enable and clear_fault while the cause persists; both must be refused."""
    robot = testbed.robot
    # A robot that has not seen the fault yet is enabled: it would grant `enable` rightly.
    _await_disabled(testbed)
    if robot.call(SetBool, "amplifier/enable", SetBool.Request(data=True)).success:
        raise Failed("amplifier/enable was granted in fault")
    if robot.call(Trigger, "amplifier/clear_fault").success:
        raise Failed("amplifier/clear_fault succeeded while the cause persists")


def _await_disabled(testbed) -> None:
    testbed.robot.wait_until(
        lambda: "amplifier" in testbed.listener.disabled_at(), 2.0, "the amplifier is still enabled"
    )
