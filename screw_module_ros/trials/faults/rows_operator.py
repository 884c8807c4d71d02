# SPDX-License-Identifier: Apache-2.0
"""What an operator, a patient and the computer itself do."""

from __future__ import annotations

import math
import resource
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

from screw_module_msgs.msg import EndpointSetpoint, ImpedanceState, SafetyState
from screw_module_msgs.srv import SetFixture
from std_srvs.srv import SetBool

from screw_module_ros import graph
from screw_module_ros.control.modes import COMBINED, FORCE_FEEDBACK
from screw_module_ros.operator.robot import arm

from .acts import both, called, cured, fault, published, refused, repeated, switched
from .limits import BY_SERVICE, DYING, STALE, TOLD
from .patient import HOME, SPRING
from .recovery import AGAIN
from .row import EITHER, GOES_ON, MISSED, OFF, VERTICAL_OFF, Act, Alarm, Failed, Row, nothing

_ESTOP = Alarm("supervisor", "emergency stop", "emergency stop")
_RESET = "supervisor/reset, enable"
_DRIVERS = ("encoder", "force_sensor", "impedance_controller", "amplifier", "manus")
_BY_CHANCE = TOLD + 2 * DYING
_BOTTOM, _TOP = 0.005, 0.355  # the end stops are at 0 and 0.36 [m]
_FAST = 0.5  # [m/s]
_HEARD_S = 0.02
_ENDING = 100  # samples in which nodes that end in order have all heard of it
_BAG_LIMIT = 200_000  # [B]


def rows() -> Iterator[Row]:
    """Operator, patient, machine."""
    yield _stops("estop", "emergency stop", called("supervisor/estop"), "supervisor", _ESTOP,
                 _RESET)._replace(mode=COMBINED)  # fmt: skip
    yield from _operator()
    yield from _patient()
    yield from _machine()


def _stops(name: str, text: str, act: Act, who: str, alarm: Alarm | None, recovery: str) -> Row:
    return Row(
        name=name, group="operator", fault=text, inject=act, alarm=alarm, recovery=recovery,
        noticed_by=who, within=BY_SERVICE, plane_within=BY_SERVICE,
    )  # fmt: skip


def _goes_on(name: str, text: str, act: Act, who: str, back: Act = nothing) -> Row:
    return Row(
        name=name, group="operator", fault=text, inject=act, back=back, alarm=None,
        recovery="none is needed", noticed_by=who, safe=GOES_ON, watch=0.3,
    )  # fmt: skip


def _operator() -> Iterator[Row]:
    estop, reset = called("supervisor/estop"), called("supervisor/reset")
    yield _stops("estop-pressed-often", "emergency stop, 20 times", repeated(estop, 20),
                 "supervisor", _ESTOP, _RESET)  # fmt: skip
    yield _stops("estop-reset-at-once", "emergency stop, reset while still stopping",
                 both(estop, reset), "supervisor", Alarm("", "", "emergency stop"),
                 "reset where it was refused, enable")  # fmt: skip
    yield _stops("estop-enable-without-reset", "enable after an emergency stop, without reset",
                 both(estop, _heard, refused("amplifier/enable", SetBool, data=True),
                      refused("manus/enable", SetBool, data=True)),
                 "amplifier, manus refuse", _ESTOP, _RESET)  # fmt: skip
    yield _stops("reset-while-cause-persists", "cable out, reset again and again",
                 both(fault("encoder", "cable_out"), _until_latched,
                      repeated(refused("supervisor/reset", said=""), 10)),
                 "supervisor refuses", Alarm("supervisor", "encoder", "encoder"),
                 f"plug it in; {MISSED}, reset, enable")._replace(
        back=cured("encoder"), within=STALE + 2 + DYING,
        plane_within=STALE + 2 + DYING + TOLD)  # fmt: skip
    yield _stops("estop-and-supervisor-killed", "emergency stop, and the supervisor killed at once",
                 both(estop, lambda testbed: testbed.kill("supervisor")),
                 "supervisor: started again it is still stopped", Alarm("", "", "emergency stop"),
                 "start it; clear_fault of both drives, reset, enable")._replace(
        back=_still_estopped)  # fmt: skip
    yield _goes_on("reset-while-enabled", "reset while a drive is enabled",
                   repeated(refused("supervisor/reset", said="still enabled"), 5),
                   "supervisor refuses")  # fmt: skip
    yield _goes_on("enable-again", "enable while enabled, 20 times",
                   repeated(both(switched("amplifier/enable", True),
                                 switched("manus/enable", True)), 10),
                   "amplifier, manus: nothing changes")  # fmt: skip
    yield _goes_on("home-while-moving", "encoder/home in motion",
                   repeated(refused("encoder/home", said="enabled"), 3),
                   "encoder refuses")  # fmt: skip
    yield _goes_on("home-while-enabled", "encoder/home while enabled, the hand at rest elsewhere",
                   both(_at_rest_elsewhere, refused("encoder/home", said="disable it first")),
                   "encoder refuses: soft stops and set points would move with the origin"
                   )  # fmt: skip
    yield _goes_on("home-elsewhere", "encoder/home while disabled, away from the mark",
                   _home_elsewhere, "encoder refuses the first time, and who asks again at once",
                   )._replace(safe=OFF, within=BY_SERVICE, plane_within=BY_SERVICE,
                              recovery="encoder/home at the mark, enable")  # fmt: skip
    yield _goes_on("plane-home-while-enabled", "manus/home while enabled",
                   refused("manus/home", said="disable"), "manus refuses")  # fmt: skip
    yield Row(
        name="lock-vertical", group="operator", fault="supervisor/lock_vertical in motion",
        inject=both(switched("supervisor/lock_vertical", True), _told_locked),
        back=switched("supervisor/lock_vertical", False), alarm=None,
        recovery="lock_vertical off, amplifier/enable", noticed_by="supervisor",
        within=BY_SERVICE + 20, plane_within=0, safe=VERTICAL_OFF,
    )  # fmt: skip
    yield _stops("disable", "both drives disabled by their services, in motion",
                 both(switched("amplifier/enable", False), switched("manus/enable", False)),
                 "amplifier, manus", None, "enable")  # fmt: skip


def _heard(testbed) -> None:
    """Wait until the drives have got it: a request at the same time meets enabled drives."""
    testbed.robot.pause(_HEARD_S)


def _still_estopped(testbed) -> None:
    testbed.restart("supervisor")
    testbed.await_restarted()
    if not testbed.robot.newest(SafetyState).estopped:
        raise Failed("the emergency stop was forgotten")


def _told_locked(testbed) -> None:
    def is_reported() -> bool:
        state = testbed.robot.state(SafetyState)
        return state is not None and state.vertical_locked

    if not testbed.until(is_reported, 3.0):
        raise Failed("safety_state does not tell of the lock")


def _until_latched(testbed) -> None:
    testbed.until(lambda: len(testbed.heard.disabled_at()) == 2, 3.0)
    testbed.until(lambda: any("encoder" in r for r in testbed.heard.reasons()), 3.0)
    testbed.robot.pause(0.6)  # until the encoder counts as lost, not only as late


def _at_rest_elsewhere(testbed) -> None:
    """Let the hand rest where the spring and its arm let it, some way from the mark."""
    testbed.patient.rest()
    if not testbed.until(lambda: testbed.patient.at_rest, 5.0):
        raise Failed("the hand does not come to rest")


def _home_elsewhere(testbed) -> float:
    """Ask for it where the last homing is far off, again and again: the origin must not move."""
    begin = testbed.just_now()
    for node in ("amplifier", "manus"):
        testbed.robot.call(SetBool, f"{node}/enable", SetBool.Request(data=False))
    there = (math.nan, math.nan, HOME + 0.08)  # friction holds it on the way
    still = (math.nan, math.nan, 0.0)
    testbed.robot.set_arm(arm(there, amplitude=still, omega=still))
    if not testbed.until(lambda: testbed.heard.now.height > HOME + 0.02, 5.0):
        raise Failed("the hand does not leave the mark")
    testbed.robot.pause(1.0)
    before = testbed.heard.now.height
    for _ in range(10):
        refused("encoder/home", said=AGAIN)(testbed)
    state = testbed.robot.state(ImpedanceState)
    if state is None or abs(state.position - before) > 0.005:
        raise Failed("the origin has moved")
    testbed.patient.place()
    return begin


def _patient() -> Iterator[Row]:
    yield Row(
        name="end-stop-full-speed", group="operator",
        fault="the patient throws the handle against the upper end stop",
        inject=both(_throw(0.5), _hits(lambda height: height > _TOP)),
        alarm=None, recovery="reset, enable",
        noticed_by="impedance_controller: soft stop, speed limit", within=_BY_CHANCE,
        plane_within=_BY_CHANCE, safe=EITHER, watch=0.8,
    )  # fmt: skip
    yield Row(
        name="end-stop-bottom", group="operator",
        fault="the patient throws the handle against the lower end stop",
        inject=both(_throw(-0.3), _hits(lambda height: height < _BOTTOM)),
        alarm=None, recovery="reset, enable",
        noticed_by="impedance_controller: soft stop, speed limit", within=_BY_CHANCE,
        plane_within=_BY_CHANCE, safe=EITHER, watch=0.8, mode=3,
    )  # fmt: skip
    yield _goes_on("patient-lets-go", "the patient lets go of the handle", _fixture("free"),
                   "nobody: forces stay within their limits",
                   _fixture("human_arm"))._replace(mode=FORCE_FEEDBACK, watch=0.8)  # fmt: skip
    yield Row(
        name="pin-in-while-enabled", group="operator", fault="the lock pin goes in in motion",
        inject=_pin(True), back=_pin(False), alarm=None, recovery="pin out, reset, enable",
        noticed_by="nobody, or impedance_controller by the jolt", within=_BY_CHANCE,
        plane_within=_BY_CHANCE, safe=EITHER, watch=0.8,
    )  # fmt: skip


def _throw(height: float) -> Act:
    def act(testbed) -> None:
        testbed.robot.set_arm(
            arm((0.0, 0.0, height), 0.1, amplitude=(0.0,) * 3, omega=(0.0,) * 3)
        )

    return act


def _hits(arrived: Callable[[float], bool]) -> Act:
    """Wait until the handle has come to the stop, and fast."""

    def act(testbed) -> None:
        begin = testbed.just_now()
        if not testbed.until(lambda: arrived(testbed.heard.now.height), 3.0):
            raise Failed("the handle did not come to the end stop")
        fastest = max(abs(moment.speed) for moment in testbed.heard.since(begin))
        if fastest < _FAST:
            raise Failed(f"the handle came to the end stop with {fastest:.2f} m/s")

    return act


def _fixture(name: str) -> Act:
    return lambda testbed: testbed.robot.set_fixture(name)


def _pin(locked: bool) -> Act:
    def act(testbed) -> None:
        request = SetFixture.Request(fixture="", position=float("nan"), locked=locked)
        testbed.robot.ask(SetFixture, "sim_rig/set_fixture", request)

    return act


def _machine() -> Iterator[Row]:
    yield _goes_on("disk-full-while-recording", "the disk is full while recording", _disk_full,
                   "session_recorder", _disk_again)._replace(
        group="machine", alarm=Alarm("session_recorder", "File too large|No space"),
        recovery="make room, start again",
        watch=0.5)  # fmt: skip
    yield _goes_on("bag-deleted-while-recording", "the bag's folder is deleted while recording",
                   _delete_bag, "session_recorder, at the latest when it stops",
                   _disk_again)._replace(group="machine", watch=0.5)  # fmt: skip
    yield _goes_on("clock-jump", "set points with stamps of another year",
                   both(_stamped(4_000_000_000), _stamped(1)),
                   "nobody: only the time of arrival counts")._replace(group="machine")  # fmt: skip
    yield Row(
        name="bring-up-in-reverse", group="machine",
        fault="supervisor, drivers and controllers stopped in motion, started in the wrong order",
        inject=_stop_all, back=_start_in_reverse, alarm=None,
        recovery="home, tare, clear_fault, reset, enable", noticed_by="all of them",
        within=_ENDING, plane_within=_ENDING, apart=True,
    )  # fmt: skip


def _recording(testbed) -> Path:
    return testbed.robot.start_recording()


def _disk_full(testbed) -> None:
    _recording(testbed)
    testbed.robot.pause(0.3)
    _limit_files(testbed, _BAG_LIMIT)


def _limit_files(testbed, size: int) -> None:
    resource.prlimit(
        testbed.graph.pid("session_recorder"), resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY)
    )


def _disk_again(testbed) -> None:
    """There is room again: stop what was recorded, and a new recording works."""
    _limit_files(testbed, resource.RLIM_INFINITY)
    called("session_recorder/stop")(testbed)
    folder = _recording(testbed)
    testbed.robot.pause(0.3)
    testbed.robot.stop_recording()
    shutil.rmtree(folder)


def _delete_bag(testbed) -> None:
    shutil.rmtree(_recording(testbed))


def _stamped(second: int) -> Act:
    """Set points that are right but for their stamp."""
    x, y, z, *_ = SPRING
    return published(
        EndpointSetpoint, graph.SETPOINT, 20, 0.005, header__stamp__sec=second,
        position__x=x, position__y=y, position__z=z,
    )  # fmt: skip


def _stop_all(testbed) -> float:
    begin = testbed.just_now()
    for node in ("supervisor", *_DRIVERS):
        testbed.terminate(node)
    return begin


def _start_in_reverse(testbed) -> None:
    for node in (*reversed(_DRIVERS), "supervisor"):
        testbed.restart(node)
