# SPDX-License-Identifier: Apache-2.0
"""The parts of the live stand that need no graph: a bag's samples, refusals, lease."""

from __future__ import annotations

import shlex
from types import SimpleNamespace
from typing import Annotated, NamedTuple

import numpy as np
import pytest
from screw_module_msgs.msg import AmplifierState

from screw_module_ros import graph
from screw_module_ros.clock import ManualClock, WallClock
from screw_module_ros.control.excitation import Excitation
from screw_module_ros.control.law import Law, Variant
from screw_module_ros.control.modes import FORCE_FEEDBACK
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.geometry import Screw, torque_to_force
from screw_module_ros.identification.live import stand as live
from screw_module_ros.identification.live.samples import Recorded, SamplesLost, Window, joined
from screw_module_ros.identification.live.stand import LiveStand
from screw_module_ros.identification.trials import (
    Cancelled,
    MotionTrial,
    NotPossible,
    TorqueTrial,
)
from screw_module_ros.operator.client import RobotError
from screw_module_ros.settings import Setting

RATE, PERIOD_NS = 200.0, 5_000_000
FIRST = 2**32 - 30  # the tick numbers start again within each of these tests
SPEED = 0.02


def stamp(tick: float) -> int:
    return round((FIRST + tick) * PERIOD_NS)


def topic(ticks, late_ns=None, **values):
    """Return the fields of a topic's messages, as `recording.decoded.columns` does."""
    ticks = np.array(ticks, int)
    late = np.zeros(len(ticks), int) if late_ns is None else late_ns
    return {
        "sequence": ((FIRST + ticks) % 2**32).astype(np.uint32),
        "monotonic_ns": (FIRST + ticks) * PERIOD_NS + late,
        **{name: np.broadcast_to(value, len(ticks)) for name, value in values.items()},
    }


def forces(ticks, status=0):
    """Return force samples with fz = tick and tz = -tick."""
    t = np.array(ticks, float)
    nothing = dict.fromkeys(("fx", "fy", "tx", "ty"), 0.0)
    return topic(ticks, fz=t, tz=-t, status=status, **nothing)


def bag(ticks, force_ticks=None, commands=(), late_ns=None, force=None) -> Recorded:
    """Return a handle that moves at SPEED."""
    late = np.zeros(len(ticks)) if late_ns is None else late_ns
    at = 0.1 + SPEED * (np.array(ticks) / RATE + late * 1e-9)
    return joined({
        graph.ENCODER: topic(ticks, late_ns, position=at, velocity=SPEED),
        graph.FORCE: force or forces(ticks if force_ticks is None else force_ticks),
        graph.FORCE_COMMAND: topic([tick for tick, _ in commands],
                                   force=[newtons for _, newtons in commands]),
    }, RATE)  # fmt: skip


def window(begin, end) -> Window:
    return Window(stamp(begin), stamp(end))


BEFORE, AFTER = window(0, 11), window(189, 200)  # mean ticks 5 and 194
ALL = range(200)
MOVED = 0.1 + SPEED * np.arange(20, 120) / RATE


def without(*lost):
    return [tick for tick in ALL if tick not in lost]


class TestSamples:
    @pytest.mark.parametrize(
        ("ticks", "force_ticks"),
        [
            (ALL, ALL),
            (without(40, 50, 51), without(60)),
            (sorted([*ALL, 40, 41]), ALL),  # what comes twice counts once
            ([*range(12), *range(20, 120), *range(180, 200)], ALL),  # lost outside of the trial
        ],
    )
    def test_are_joined_by_tick_without_the_line_between_the_zeros(self, ticks, force_ticks):
        """Also beyond the number that starts again. The readings of the force are that line."""
        samples = bag(ticks, force_ticks).samples(20, 100, BEFORE, AFTER)
        np.testing.assert_allclose(samples.position, MOVED)
        np.testing.assert_allclose(samples.velocity, SPEED)
        np.testing.assert_allclose(samples.time, np.arange(100) / RATE)
        np.testing.assert_allclose([samples.force, samples.torque], 0.0, atol=1e-9)
        assert np.isnan(samples.current).all() and not samples.command.any()

    def test_keep_what_is_beyond_that_line(self):
        offset = forces(ALL)
        offset["fz"] = offset["fz"] + np.where(np.arange(200) % 189 < 20, 0.0, 3.0)
        samples = bag(ALL, force=offset).samples(20, 100, BEFORE, AFTER)
        np.testing.assert_allclose(samples.force, 3.0, atol=1e-9)

    def test_that_are_late_do_not_make_the_handle_tremble(self):
        late = np.random.default_rng(1).integers(0, 2_000_000, 200)
        samples = bag(ALL, late_ns=late).samples(20, 100, BEFORE, AFTER)
        np.testing.assert_allclose(np.diff(samples.position), SPEED / RATE, rtol=1e-6)

    @pytest.mark.parametrize(
        ("ticks", "force_ticks", "before", "said"),
        [
            # At an end of the trial too: half a sine, or a frictionless half of the screw.
            ([*range(60), *range(80, 200)], ALL, BEFORE, "encoder: .* with a gap of 105 ms"),
            (ALL, [t for t in ALL if t % 10 != 3 or t > 150], BEFORE,
             "force sensor: 10.0 % of the samples"),
            (ALL, [*range(100), *range(189, 200)], BEFORE, "force sensor: .*gap of 105 ms"),
            (ALL, [*range(11), *range(41, 200)], BEFORE, "force sensor: .*gap of 110 ms"),
            (ALL, ALL, window(300, 400), "of the unloaded handle"),
            ([], range(9), BEFORE, "encoder: not one"),
            (range(9), [], BEFORE, "force sensor: not one"),
        ],
    )  # fmt: skip
    def test_that_are_missing_are_refused(self, ticks, force_ticks, before, said):
        with pytest.raises(SamplesLost, match=said):
            bag(list(ticks), list(force_ticks)).samples(20, 100, before, AFTER)

    def test_with_one_long_gap_are_refused_however_few_are_lost(self):
        found = bag([*range(60), *range(80, 2000)])
        with pytest.raises(SamplesLost, match="encoder: 1.1 % of the samples .* gap of 105 ms"):
            found.samples(20, 1900, BEFORE, window(1989, 2000))

    def test_with_a_fault_of_the_sensor_are_lost(self):
        bad = np.where((np.arange(200) >= 50) & (np.arange(200) < 90), 1 << 6, 0)
        with pytest.raises(SamplesLost, match="force sensor: 40.0 %"):
            bag(ALL, force=forces(ALL, bad)).samples(20, 100, BEFORE, AFTER)

    def test_have_each_command_until_the_next(self):
        found = bag(ALL, commands=[(23, 5.0), (26, -2.0)])
        samples = found.samples(20, 10, BEFORE, AFTER, lambda force: 2.0 * force)
        np.testing.assert_array_equal(samples.command, [0, 0, 0, 10, 10, 10, -4, -4, -4, -4])

    def test_begin_at_a_time(self):
        assert bag(ALL).tick_at(stamp(40)) == 40
        assert bag(ALL).tick_at(stamp(40) + 1_000_000) == 41


@pytest.mark.parametrize("lost", [0, 1, 3])
def test_the_first_tick_of_a_sine_is_found_though_its_commands_are_lost(lost):
    sine = Excitation(1, 0.3, 10.0, 40)
    commands = [
        (50 + tick, torque_to_force(sine.torque(tick, RATE)))
        for tick in range(40) if not 1 <= tick <= lost
    ]  # fmt: skip
    found = bag(ALL, commands=[(30, 7.0), (31, 0.0), *commands])
    assert live.first_tick(found, stamp(45), sine) == 50


def test_a_sine_that_was_never_commanded_is_an_error():
    with pytest.raises(RobotError, match="did not start"):
        live.first_tick(bag(ALL), stamp(45), Excitation(1, 0.3, 10.0, 40))


def test_the_stage_begins_where_the_nut_moves():
    ticks = np.arange(200)
    found = joined({
        graph.ENCODER: topic(ticks, position=0.1 + 1e-4 * np.maximum(0, ticks - 60), velocity=0.0),
        graph.FORCE: forces(ticks), graph.FORCE_COMMAND: {},
    }, RATE)  # fmt: skip
    assert live.first_moved(found, stamp(20)) == 60


class TestRefusals:
    @pytest.mark.parametrize(
        ("trial", "said"),
        [
            (TorqueTrial(1.0, 0.5, 1.0), "continuous torque of 0.42 Nm"),
            (TorqueTrial(100.0, 0.1, 1.0), "a sine of 100 Hz needs more than 200"),
            (TorqueTrial(1.0, 0.1, 1.0, rate=2000.0), "wants 2000 samples per second"),
        ],
    )
    def test_a_sine_that_cannot_be_played(self, trial, said):
        with pytest.raises(NotPossible, match=said):
            live.excitation_of(trial, RATE)

    @pytest.mark.parametrize(
        ("check", "parameters", "said"),
        [
            (live.common_rate, {"rate": 1000.0, "use_sim_time": True},
             "encoder runs with use_sim_time true"),
            (lambda robot: live.check_screw(robot, Screw()), {"lead": 0.025},
             "amplifier runs with a lead of 25 mm, encoder with 19.05 mm"),
        ],
    )  # fmt: skip
    def test_sensors_with_another_clock_or_screw(self, check, parameters, said):
        robot = SimpleNamespace(clock=WallClock(), parameters=lambda node, names: parameters)
        with pytest.raises(NotPossible, match=said):
            check(robot)

    def test_a_handle_elsewhere_than_the_encoder_shows_names_home_and_lead(self):
        robot = SimpleNamespace(newest=lambda kind: kind(position=0.205))
        live.check_height(robot, 0.2045, Screw())
        with pytest.raises(NotPossible, match="home the encoder.* lead is not the 12.7 mm"):
            live.check_height(robot, 0.2, Screw(0.0127))

    @pytest.mark.parametrize(
        ("simulated", "change", "said"),
        [
            (True, {"preloaded": True}, "without backlash.*preloaded: false"),
            (True, {"side_force": 1.0}, "`make reproduce`.*side_force: 0.0"),
            (True, {"tremor": 1e-3}, "`make reproduce`.*side_force: 0.0"),
            (True, {"changed": 1}, "`make reproduce`.*side_force: 0.0"),
            (False, {"way": 0.05}, "needs the simulated rig"),
            (False, {"released_after": 3.0}, "needs the simulated rig"),
        ],
    )
    def test_what_this_bench_lacks(self, simulated, change, said):
        """The graph ran such a trial as if nothing had been asked for."""
        trial = MotionTrial(FORCE_FEEDBACK, VerticalSettings())._replace(**change)
        with pytest.raises(NotPossible, match=said):
            made(simulated=simulated).record(trial, lambda share: None)


def test_an_enabled_drive_is_refused_with_the_whole_command():
    robot = SimpleNamespace(
        node=SimpleNamespace(get_namespace=lambda: "/left"),
        met=lambda condition, patience: condition(),
        state=lambda kind: kind(enabled=True),
        newest=lambda kind: kind(enabled=True),
    )
    with pytest.raises(NotPossible) as refused:
        live.check_disabled(robot)
    words = shlex.split(str(refused.value).partition("disable it: ")[2])
    assert words == [
        "ros2", "service", "call", "/left/amplifier/enable", "std_srvs/srv/SetBool", "{data: false}"
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("state", "said"),
    [(None, "the amplifier is silent; boom"), (AmplifierState(reason="drive"), "off: drive")],
)
def test_a_trial_ends_when_its_amplifier_has_ended(state, said):
    """A trial went on to its end after the amplifier was killed: silence counted as torque."""
    robot = SimpleNamespace(
        state=lambda kind: state if kind is AmplifierState else None,
        newest=lambda kind: state,
        met=lambda condition, patience: condition(),
        complaints_text=lambda: "; boom",
    )
    with pytest.raises(RobotError, match=said):
        live.check_acting(robot)


class Rigid(NamedTuple):
    """Settings of a law of others; what has no Setting is no parameter."""

    gain: Annotated[float, Setting("of the hand's force", "", 0.0, 10.0)] = 1.0
    bare: float = 2.0


RIGID = Law("rigid", {100: Variant("RIGID", ("gain",))}, Rigid)


class StillRobot:
    """A robot on which every request succeeds at once; done: what was asked of it."""

    def __init__(self, laws=("",)):
        self.laws = list(laws)
        self.clock, self.done = ManualClock(10**9), []
        self.watch = lambda: None

    def parameters(self, node, names):
        own = {"lead": 0.01905, "rate": 1000.0, "use_sim_time": True, "module_serial": "ARM-0007",
               "laws": self.laws, "rigid.gain": 3.0}
        return {name: own[name] for name in names if name in own}

    def enable(self, on=True):
        self.done.append("torque on" if on else "torque off")


def made(simulated=True, robot=None, **fixture) -> LiveStand:
    """Return a stand on a robot that stands still; its requests are those of the lease."""
    robot = robot or StillRobot()
    fixture = SimpleNamespace(simulated=simulated, **fixture)
    stand = LiveStand(robot, robot.done.append, fixture, None, lambda text: None, [])
    stand.__enter__()
    return stand


def test_a_law_runs_with_the_controller_s_parameters_and_the_defaults_of_what_is_none():
    stand = made(robot=StillRobot([f"{__name__}:RIGID"]))
    assert stand.law_settings == {"rigid": Rigid(gain=3.0, bare=2.0)}


@pytest.mark.parametrize("where", ["_until", "hand_moves"])
@pytest.mark.parametrize("error", [Cancelled("cancelled"), RobotError("the encoder is silent")])
def test_the_torque_goes_off_before_the_hand_comes_to_rest(error, where):
    """It stayed on for more than a second after a cancellation, until the hand was at rest."""

    def failing(*_) -> None:
        raise error

    robot = StillRobot()
    hand = {"hand_moves": lambda trial: None}
    stand = made(robot=robot, **{**hand, **({where: failing} if where in hand else {})},
                 hand_rests=lambda centre: robot.done.append("hand at rest"))  # fmt: skip
    stand._torque_on = True
    if where not in hand:
        stand._until = failing
    with pytest.raises(type(error)):
        stand._moved(MotionTrial(FORCE_FEEDBACK, VerticalSettings()), lambda share: None)
    assert robot.done == ["torque off", "hand at rest"]


def test_the_lease_is_renewed_in_every_wait_also_while_cancelling_is_ignored():
    robot = StillRobot()
    stand = made(robot=robot)
    stand._ask(Excitation(1, 0.3, 2.0, 100))
    for _ in range(20):
        robot.clock.sleep(0.02)
        with stand._unhurried("what"):
            robot.watch()
    assert len(robot.done) == 5, "each 0.1 s, and at once"
    assert {request.id for request in robot.done} == {robot.done[0].id}
    stand._ask(Excitation())
    assert robot.done[-1].id != robot.done[0].id and robot.done[-1].ticks == 0


def test_what_cannot_be_restored_is_told():
    stand = made()
    with stand._unhurried("amplifier not disabled"):
        raise RobotError("amplifier did not switch off")
    assert stand.left == ["amplifier not disabled: amplifier did not switch off"]
