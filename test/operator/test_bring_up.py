# SPDX-License-Identifier: Apache-2.0
"""What an operator does next, by what he sees; the steps one after the other. No graph runs."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from screw_module_msgs.msg import (
    AmplifierState,
    EncoderSample,
    ForceCommand,
    ImpedanceState,
    PlanarState,
    SafetyState,
)

from screw_module_ros.clock import ManualClock
from screw_module_ros.operator import bring_up as bringing
from screw_module_ros.operator.bring_up import DRIVES, WORKS, Seen, bring_up, next_step
from screw_module_ros.operator.client import RobotError

MODE = ForceCommand.COMBINED
ENABLED = AmplifierState.OPERATION_ENABLED
RESTS = SimpleNamespace(
    at_rest=True, to_mark="to mark", plane_to_mark="plane to mark", let_go="let go",
    take_hold="take hold",
)  # fmt: skip
MOVES = SimpleNamespace(**{**vars(RESTS), "at_rest": False})
WORKING = Seen(
    encoder=EncoderSample(homed=True, position=0.25),
    wrench=WrenchStamped(),
    force_level=DiagnosticStatus.OK,
    amplifier=AmplifierState(enabled=True, state=ENABLED),
    manus=PlanarState(enabled=True, homed=True, drive_state=[ENABLED, ENABLED]),
    safety=SafetyState(level=SafetyState.OK),
    controller=ImpedanceState(mode=MODE),
)
ILL = {"force_level": DiagnosticStatus.ERROR}
OFF = AmplifierState(state=AmplifierState.SWITCHED_ON)
PLANE_OFF = PlanarState(homed=True, drive_state=[3, 3])
IS_OFF = {"amplifier": OFF, "manus": PLANE_OFF}


def amplifier(**fields):
    return {"amplifier": AmplifierState(**fields)}


def manus(**fields):
    return {"manus": PlanarState(**{"drive_state": [3, 3], **fields})}


def safety(level, *reasons):
    return {"safety": SafetyState(level=level, reasons=list(reasons))}


@pytest.mark.parametrize(
    ("change", "services", "before"),
    [
        ({"encoder": None}, ["encoder/home"], "to mark"),
        ({"encoder": EncoderSample(homed=False, position=0.2)}, ["encoder/home"], "to mark"),
        ({"encoder": EncoderSample(homed=True, position=0.39)}, ["encoder/home"], "to mark"),
        ({"encoder": EncoderSample(homed=True, position=-0.03)}, ["encoder/home"], "to mark"),
        ({"controller": ImpedanceState(home_in_doubt=True)}, ["encoder/home"], "to mark"),
        (safety(SafetyState.STOPPED) | {"controller": ImpedanceState(home_in_doubt=True)},
         ["encoder/home"], "to mark"),
        ({**IS_OFF, "wrench": None}, ["force_sensor/tare"], "let go"),
        ({**IS_OFF, "wrench": None, "tared_s": 0.1}, ["force_sensor/tare"], "let go"),
        ({**IS_OFF, **ILL}, ["force_sensor/tare"], "let go"),
        ({**IS_OFF, "force_level": DiagnosticStatus.WARN}, ["force_sensor/tare"], "let go"),
        ({**IS_OFF, **ILL, "tared_s": 2.0}, ["force_sensor/tare"], "let go"),
        ({**ILL, "amplifier": None, "manus": None}, ["force_sensor/tare"], "let go"),
        (amplifier(faulted=True, reason="smoke"), ["amplifier/clear_fault"], None),
        (manus(faulted=True, reason="smoke"), ["manus/clear_fault"], None),
        (manus(homed=False), ["manus/home"], "plane to mark"),
        (safety(SafetyState.STOPPED, "estop"), ["supervisor/reset"], None),
        ({"controller": ImpedanceState(mode=1)}, ["impedance_controller/set_mode"], None),
        ({"amplifier": OFF}, ["amplifier/enable"], "take hold"),
        ({"manus": PLANE_OFF}, ["manus/enable"], "take hold"),
        ({"amplifier": OFF, "manus": PLANE_OFF}, ["amplifier/enable", "manus/enable"], "take hold"),
        (safety(SafetyState.STOPPED) | amplifier(faulted=True), ["amplifier/clear_fault"], None),
        ({**ILL, "encoder": None}, ["encoder/home"], "to mark"),
    ],
)
def test_what_is_missing_is_mended_first_things_first(change, services, before):
    step = next_step(WORKING._replace(**change), MODE, RESTS)
    assert list(step.services) == services
    assert before is None or step.before == before
    assert (step.after == "take hold") == (services == ["force_sensor/tare"])
    assert step.why


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({**IS_OFF, "force_level": None}, "force sensor has not reported"),
        ({**IS_OFF, **ILL, "force_rate": 0.3}, "have just begun"),
        ({"amplifier": None}, "amplifier is silent"),
        ({"manus": None}, "manus is silent"),
        (amplifier(state=AmplifierState.UNKNOWN), "amplifier: its drive is silent"),
        (manus(drive_state=[3, AmplifierState.UNKNOWN]), "manus: its drive is silent"),
        ({"safety": None}, "supervisor is silent"),
        (safety(SafetyState.WAITING, "manus: not seen"), "manus: not seen"),
        (safety(SafetyState.WAITING), "the supervisor waits"),
        ({"controller": None}, "impedance_controller is silent"),
        ({**ILL, "tared_s": 0.5}, "does not report its tare yet"),
    ],
)
def test_what_comes_by_itself_is_waited_for(change, why):
    step = next_step(WORKING._replace(**change), MODE, RESTS)
    assert step is not WORKS and step.services == () and why in step.why


def test_a_tare_takes_a_moment_to_show():
    step = next_step(WORKING._replace(**IS_OFF, **ILL, tared_s=0.5), MODE, RESTS)
    assert step.services == ("amplifier/enable", "manus/enable")


def test_a_tare_that_the_sensor_would_refuse_is_not_asked_for():
    """Either axis feeds the force back."""
    assert next_step(WORKING._replace(**ILL), MODE, RESTS) is WORKS
    for off in ({"amplifier": OFF}, {"manus": PLANE_OFF}):
        step = next_step(WORKING._replace(**ILL, **off), MODE, RESTS)
        assert step.services == (f"{next(iter(off))}/enable",)


def test_a_moving_hand_gets_no_torque_and_a_robot_that_works_is_left_alone():
    assert next_step(WORKING, MODE, MOVES) is WORKS
    step = next_step(WORKING._replace(amplifier=OFF), MODE, MOVES)
    assert step.services == () and step.why == "the hand moves"


def test_a_drive_that_is_not_wanted_stays_as_it_is():
    seen = WORKING._replace(manus=None)
    assert next_step(seen, MODE, RESTS, DRIVES[:1]) is WORKS
    assert next_step(seen, MODE, RESTS) is not WORKS
    seen = WORKING._replace(manus=PLANE_OFF)
    assert next_step(seen, MODE, RESTS, DRIVES[:1]) is WORKS
    faulted = seen._replace(**manus(faulted=True))  # without it the supervisor permits nothing
    assert next_step(faulted, MODE, RESTS, DRIVES[:1]).services == ("manus/clear_fault",)


class PlayedRobot:
    """Answers as it is told; a granted service changes what is seen, as the real nodes do."""

    def __init__(self, seen, refusals=()):
        self.clock, self.asked = ManualClock(1_000_000_000), []
        self.seen, self._refusals = seen, dict(refusals)

    def call(self, kind, service, request, deadline_s):
        self.asked.append((service, self.clock.now_ns()))
        left = self._refusals.get(service, 0)
        self._refusals[service] = left - 1
        if left > 0:
            return SimpleNamespace(success=False, message="not now")
        node, _, act = service.partition("/")
        if act == "enable":
            self.seen = self.seen._replace(**{node: getattr(WORKING, node)})
        elif act == "home":
            self.seen = self.seen._replace(encoder=WORKING.encoder)
        elif act == "tare":
            self.seen = self.seen._replace(force_level=WORKING.force_level)
        return SimpleNamespace(success=True, message="done")

    def pause(self, seconds):
        self.clock.sleep(seconds)

    def complaints_text(self):
        return "; a complaint"


@pytest.fixture
def brought_up(monkeypatch):
    """Bring a played robot up, nobody's hand in the way."""
    monkeypatch.setattr(bringing, "look", lambda robot, tared_s: robot.seen)
    nobody = SimpleNamespace(at_rest=True, **dict.fromkeys(vars(RESTS).keys() - {"at_rest"}, int))
    return lambda robot, **more: bring_up(robot, MODE, nobody, **more)


STARTED = WORKING._replace(encoder=None, amplifier=OFF, manus=PLANE_OFF)


def test_a_refused_homing_is_asked_for_again_when_it_can_count(brought_up):
    robot = PlayedRobot(STARTED, {"encoder/home": 1})
    operation = brought_up(robot)
    (first, at), (again, later), *enabling = robot.asked
    assert (first, again) == ("encoder/home", "encoder/home") and 1e9 < later - at < 15e9
    assert [service for service, _ in enabling] == ["amplifier/enable", "manus/enable"]
    assert operation.services == {"encoder/home", "amplifier/enable", "manus/enable"}
    assert operation.enabled_ns == enabling[0][1]
    assert robot.clock.now_ns() - operation.enabled_ns >= 0.6e9, "the torque has ramped in"


def test_a_refused_tare_is_asked_for_again_when_it_can_count(brought_up):
    robot = PlayedRobot(WORKING._replace(**IS_OFF, **ILL), {"force_sensor/tare": 1})
    brought_up(robot)
    (first, at), (again, later), *_ = robot.asked
    assert (first, again) == ("force_sensor/tare", "force_sensor/tare")
    assert 1e9 < later - at < 15e9


def test_an_axis_is_not_enabled_while_the_other_refuses(brought_up):
    robot = PlayedRobot(STARTED._replace(encoder=WORKING.encoder), {"amplifier/enable": 2})
    operation = brought_up(robot)
    asked = [service for service, _ in robot.asked]
    assert asked == ["amplifier/enable"] * 3 + ["manus/enable"]
    assert operation.enabled_ns == robot.asked[2][1], "the first one that was granted"


def test_what_did_not_help_is_said_at_the_deadline(brought_up):
    robot = PlayedRobot(STARTED, {"encoder/home": 1000})
    with pytest.raises(
        RobotError, match="no operation: encoder/home was refused: not now; a complaint"
    ):
        brought_up(robot, deadline_s=5.0)
    robot = PlayedRobot(WORKING._replace(safety=None))
    with pytest.raises(RobotError, match="no operation: the supervisor is silent"):
        brought_up(robot, deadline_s=5.0)
    assert robot.clock.now_ns() == pytest.approx(6e9, rel=0.01) and not robot.asked


def test_a_robot_that_works_is_asked_for_nothing(brought_up):
    robot = PlayedRobot(WORKING)
    assert brought_up(robot).services == frozenset() and not robot.asked
