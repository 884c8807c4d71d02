# SPDX-License-Identifier: Apache-2.0
"""The parts of the live bench that need no graph: joining samples, the torque source, feedback."""

from __future__ import annotations

import math
import shlex
from types import SimpleNamespace

import numpy as np
import pytest
from screw_module_msgs.action import RunExperiment
from screw_module_msgs.msg import AmplifierState

from screw_module_ros.clock import ManualClock, WallClock
from screw_module_ros.control import modes
from screw_module_ros.control.linearization import default_linearization
from screw_module_ros.control.modes import FORCE_FEEDBACK
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.geometry import force_to_torque
from screw_module_ros.identification.live import experiment as live_session
from screw_module_ros.identification.live import trials as live_trials
from screw_module_ros.identification.live.feedback import Feedback
from screw_module_ros.identification.live.motion import Motion, check_possible
from screw_module_ros.identification.live.samples import (
    Recording,
    SamplesLost,
    Zero,
    evenly,
    samples_of,
    zero_of,
)
from screw_module_ros.identification.live.takeover import check_disabled
from screw_module_ros.identification.live.torque_source import Sine, TorqueSource
from screw_module_ros.identification.trials import (
    Cancelled,
    MotionTrial,
    NotPossible,
    TorqueTrial,
)
from screw_module_ros.operator.client import RobotError
from screw_module_ros.safety.checks import WatchSettings

RATE, PERIOD_NS = 200.0, 5_000_000
FIRST = 2**32 - 30  # the tick numbers start again within each of these tests
SPEED = 0.02


def stamp(tick: int, late_ns: int = 0) -> int:
    return (FIRST + tick) * PERIOD_NS + late_ns


def encoder(tick: int, position: float = 0.2, velocity: float = 0.0, late_ns: int = 0):
    return SimpleNamespace(
        sequence=(FIRST + tick) % 2**32,
        monotonic_ns=stamp(tick, late_ns),
        position=position,
        velocity=velocity,
        homed=True,
    )


def force(tick: int, fz: float = 0.0, tz: float = 0.0):
    return SimpleNamespace(
        sequence=(FIRST + tick) % 2**32, monotonic_ns=stamp(tick), status=0,
        fx=0.0, fy=0.0, fz=fz, tx=0.0, ty=0.0, tz=tz,
    )  # fmt: skip


def recorded(ticks, force_ticks=None, late_ns=lambda tick: 0) -> Recording:
    """Return a handle that moves at SPEED, with fz = tick and tz = -tick."""
    recording = Recording(1000)
    for tick in ticks:
        late = late_ns(tick)
        at = 0.1 + SPEED * (tick / RATE + late * 1e-9)
        recording.note_encoder(encoder(tick, at, SPEED, late))
    for tick in force_ticks if force_ticks is not None else ticks:
        recording.note_force(force(tick, float(tick), -float(tick)))
    return recording


class TestEvenly:
    def test_joins_by_tick_beyond_the_number_that_starts_again(self):
        track = evenly(recorded(range(100), range(7, 95)), RATE)
        assert len(track.force) == 88
        np.testing.assert_allclose(track.force, np.arange(7, 95))
        np.testing.assert_allclose(track.torque, -np.arange(7, 95))
        np.testing.assert_allclose(track.position, 0.1 + SPEED * np.arange(7, 95) / RATE)
        assert track.begin == (FIRST + 7) % 2**32
        assert track.begin_ns == pytest.approx(stamp(7))
        assert track.row_of((FIRST + 40) % 2**32) == 33
        assert track.row_at(stamp(40), RATE) == 33

    def test_bridges_lost_ticks(self):
        lost = {20, 50, 51}
        kept = [tick for tick in range(100) if tick not in lost]
        track = evenly(recorded(kept, [t for t in range(100) if t != 30]), RATE)
        np.testing.assert_allclose(track.position, 0.1 + SPEED * np.arange(100) / RATE)
        np.testing.assert_allclose(track.force, np.arange(100))

    def test_late_samples_do_not_make_the_handle_tremble(self):
        rng = np.random.default_rng(1)
        late = rng.integers(0, 2_000_000, 100)
        track = evenly(recorded(range(100), late_ns=lambda tick: int(late[tick])), RATE)
        np.testing.assert_allclose(np.diff(track.position[1:-1]), SPEED / RATE, rtol=1e-6)

    def test_refuses_a_long_gap(self):
        with pytest.raises(SamplesLost, match="encoder: .* with a gap of 105 ms"):
            evenly(recorded([*range(200), *range(220, 800)]), RATE)

    def test_refuses_many_losses(self):
        with pytest.raises(SamplesLost, match="force sensor: 10.* % of the samples"):
            evenly(recorded(range(200), [t for t in range(200) if t % 10 != 3]), RATE)

    def test_refuses_a_sensor_that_ends_before_the_trial(self):
        """A frictionless half of the screw, or a sine of half a period, came of it."""
        with pytest.raises(SamplesLost, match="force sensor: no good sample in 500 ms"):
            evenly(recorded(range(200), range(100)), RATE)

    def test_lost_encoder_samples_are_no_fault_of_the_force_sensor(self):
        """A trial goes on for a tick more with each, until it has its encoder samples."""
        recording, tick = Recording(1000), 0
        while not recording.full:
            recording.note_force(force(tick))
            if tick % 40:
                recording.note_encoder(encoder(tick))
            tick += 1
        assert len(evenly(recording, RATE).force) == pytest.approx(1000 * 40 / 39, abs=2)

    def test_a_sample_with_a_fault_of_the_sensor_is_lost(self):
        recording = recorded(range(200), range(100))
        for tick in range(100, 200):
            recording.note_force(SimpleNamespace(**{**vars(force(tick, 1e3)), "status": 1 << 6}))
        with pytest.raises(SamplesLost, match="force sensor: no good sample in 500 ms"):
            evenly(recording, RATE)

    def test_says_that_nothing_came(self):
        with pytest.raises(SamplesLost, match="force sensor: not one"):
            evenly(recorded(range(9), []), RATE)

    def test_commands_stay_until_the_next(self):
        recording = recorded(range(10))
        for tick, newtons in ((3, 5.0), (6, -2.0)):
            command = SimpleNamespace(**vars(encoder(tick)), force=newtons)
            recording.note_command(command)
        np.testing.assert_array_equal(
            evenly(recording, RATE).command, [0, 0, 0, 5, 5, 5, -2, -2, -2, -2]
        )

    def test_takes_the_line_between_the_zeros_off(self):
        track = evenly(recorded(range(100)), RATE)
        slope = 2.0
        before, after = (
            Zero(stamp(tick), (0.0, 0.0, slope * tick, 0.0, 0.0, -tick)) for tick in (-40, 160)
        )
        samples = samples_of(track, RATE, before, after)
        np.testing.assert_allclose(samples.force, -np.arange(100), atol=1e-9)
        np.testing.assert_allclose(samples.torque, 0.0, atol=1e-9)
        np.testing.assert_allclose(samples.time, np.arange(100) / RATE)
        assert np.isnan(samples.current).all()

    def test_zero_is_the_mean_in_the_middle(self):
        zero = zero_of(recorded(range(11)))
        assert zero.at_ns == stamp(5)
        assert zero.wrench == (0.0, 0.0, 5.0, 0.0, 0.0, -5.0)


class TestTorqueSource:
    @pytest.fixture
    def source(self):
        return TorqueSource(WatchSettings(), PERIOD_NS)

    def play(self, source, ticks, position=lambda tick: 0.2, forces=lambda tick: True):
        answers = []
        for tick in ticks:
            now = stamp(tick, 1000)
            if forces(tick):
                source.on_force(force(tick), now)
            answers.append(source.on_encoder(encoder(tick, position(tick)), now).force)
        return force_to_torque(np.array(answers))

    def test_plays_the_sine_and_stops(self, source):
        marks = []
        self.play(source, range(10))
        source.begin(Sine(0.3, 10.0, 40, RATE), marks.append)
        torque = self.play(source, range(10, 60))
        expected = 0.3 * np.sin(2.0 * np.pi * 10.0 * np.arange(40) / RATE)
        np.testing.assert_allclose(torque, [*expected, *[0.0] * 10], atol=1e-12)
        assert marks == [(FIRST + 10) % 2**32]
        assert not source.busy
        assert not source.fault

    def test_linearized(self, source):
        self.play(source, range(3))
        sine = Sine(0.3, 10.0, 40, RATE, default_linearization())
        source.begin(sine, lambda tick: None)
        torque = self.play(source, range(3, 43))
        assert torque.max() == pytest.approx(sine.peak) == pytest.approx(0.325)

    def test_a_rotor_that_turns_ends_it(self, source):
        self.play(source, range(3))
        source.begin(Sine(0.3, 1.0, 400, RATE), lambda tick: None)
        torque = self.play(source, range(3, 60), lambda tick: 0.2 + 5e-5 * (tick - 3))
        assert "not locked" in source.fault
        assert np.abs(torque[1:20]).min() > 0.0
        assert not torque[22:].any()
        assert source.out == 0.0

    def test_a_silent_force_sensor_ends_it(self, source):
        self.play(source, range(3))
        source.begin(Sine(0.3, 1.0, 400, RATE), lambda tick: None)
        torque = self.play(source, range(3, 60), forces=lambda tick: tick < 20)
        assert source.fault.startswith("force sensor: no sample")
        assert torque[10] != 0.0
        assert not torque[-30:].any()

    def test_a_silent_encoder_asks_for_a_zero_once(self, source):
        self.play(source, range(3))
        source.begin(Sine(0.3, 1.0, 400, RATE), lambda tick: None)
        self.play(source, range(3, 20))
        assert not source.idle(stamp(20))
        assert source.idle(stamp(40)).force == 0.0
        assert source.fault.startswith("encoder: no sample")
        assert not source.idle(stamp(41))

    def test_halted_it_is_zero_with_the_next_sample(self, source):
        self.play(source, range(3))
        source.begin(Sine(0.3, 1.0, 400, RATE), lambda tick: None)
        self.play(source, range(3, 20))
        source.halt()
        assert not self.play(source, range(20, 30)).any()
        assert not source.fault


class TestRefusals:
    session = SimpleNamespace(rate=RATE)

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
            live_trials._sine(self.session, trial)


    def test_sensors_with_another_clock(self, monkeypatch):
        given = {"rate": 1000.0, "use_sim_time": True}
        monkeypatch.setattr(live_session, "parameters", lambda *asked: given)
        with pytest.raises(NotPossible, match="encoder runs with use_sim_time true"):
            live_session.common_rate(SimpleNamespace(clock=WallClock()))

    def test_a_screw_with_another_lead(self, monkeypatch):
        """The amplifier gave 0.55 Nm where 0.42 Nm were asked for and reported."""
        monkeypatch.setattr(live_session, "parameters", lambda *asked: {"lead": 0.025})
        with pytest.raises(NotPossible, match="amplifier runs with a lead of 25 mm"):
            live_trials.torque_trial(
                SimpleNamespace(robot=None), None, TorqueTrial(1.0, 0.42, 7.0), None
            )


class TestFeedback:
    @pytest.fixture
    def told(self):
        return []

    @pytest.fixture
    def feedback(self, told):
        self.clock = ManualClock(100_000_000_000)
        goal = SimpleNamespace(
            publish_feedback=lambda m: told.append((m.progress, m.remaining, m.doing))
        )
        return Feedback(goal, RunExperiment.Feedback, lambda: None, self.clock)

    def test_estimates_from_the_pace_so_far(self, feedback, told):
        feedback.say("stage")
        feedback.progress("map", 0.0, 40.0)
        self.clock.sleep(30.0)
        feedback.progress("map", 10.0, 40.0)
        progress, remaining, doing = told[-1]
        assert (progress, doing) == (0.25, "stage")
        assert remaining == pytest.approx(30.0 * (30.0 + 10.0) / (10.0 + 10.0))

    def test_what_was_kept_from_before_does_not_count(self, feedback, told):
        feedback.progress("map", 20.0, 40.0)
        self.clock.sleep(10.0)
        feedback.progress("map", 25.0, 40.0)
        assert told[-1][1] == pytest.approx(15.0 * (10.0 + 10.0) / (5.0 + 10.0))

    def test_is_not_told_too_often(self, feedback, told):
        for step in range(100):
            self.clock.sleep(0.01)
            feedback.progress("map", step, 100.0)
        assert 4 <= len(told) <= 6

    def test_hears_of_a_cancellation(self, feedback):
        def cancelled():
            raise Cancelled

        feedback._watch = cancelled
        with pytest.raises(Cancelled):
            feedback.progress("map", 0.0, 1.0)

    def test_of_nothing_to_do(self, feedback, told):
        feedback.progress("map", 0.0, 0.0)
        assert told[-1][0] == 1.0
        assert math.isfinite(told[-1][1])


def test_an_enabled_drive_is_refused_with_the_whole_command():
    robot = SimpleNamespace(
        node=SimpleNamespace(get_namespace=lambda: "/left"),
        met=lambda condition, patience: condition(),
        state=lambda kind: kind(enabled=True),
        newest=lambda kind: kind(enabled=True),
    )
    with pytest.raises(NotPossible) as refused:
        check_disabled(robot)
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
        state=lambda kind: state,
        newest=lambda kind: state,
        met=lambda condition, patience: condition(),
        complaints_text=lambda: "; boom",
    )
    with pytest.raises(RobotError, match=said):
        live_session.Experiment.check_enabled(SimpleNamespace(robot=robot))


def test_a_nut_that_the_graph_does_not_have_is_refused():
    """The graph ran the trial with its backlash, and the result said "without backlash"."""

    def check_homed():
        pytest.fail("the trial went on")

    fixture = SimpleNamespace(require=lambda fixture: None, simulated=True)
    experiment = SimpleNamespace(fixture=fixture, robot=None, check_homed=check_homed)
    trial = MotionTrial(FORCE_FEEDBACK, VerticalSettings(), preloaded=True)
    with pytest.raises(NotPossible, match="without backlash.*preloaded: false"):
        Motion(experiment).trial(trial, lambda progress: None)


class TestMotionTrials:
    QUIET = MotionTrial(modes.OBSERVER, VerticalSettings())

    @pytest.mark.parametrize("what", ["side_force", "tremor", "changed"])
    def test_what_only_the_bench_in_process_has_is_refused(self, what):
        with pytest.raises(NotPossible, match="`make reproduce`.*side_force: 0.0"):
            check_possible(self.QUIET._replace(**{what: 1}), simulated=True)

    @pytest.mark.parametrize("change", [{"way": 0.05}, {"released_after": 3.0}])
    def test_the_rig_s_hand_holds_off_the_centre_and_lets_go_a_person_s_does_not(self, change):
        trial = self.QUIET._replace(**change)
        check_possible(trial, simulated=True)
        with pytest.raises(NotPossible, match="needs the simulated rig"):
            check_possible(trial, simulated=False)
