# SPDX-License-Identifier: Apache-2.0
"""The live graph as a stand: trials with the running nodes, on the rig or on hardware.

    with LiveStand(robot, publish, fixture, folder, say) as stand:
        result = experiment.run(Lab(stand, folder), settings)

Each trial is one bag of the session recorder, from which its samples are read. Torque and settings
of a trial are on a lease (`ExcitationRequest`): when this process dies, the controller ends the
torque and puts everything back. At the end of each trial, after a cancellation and after an error,
the torque goes off before anything else; `left` lists what could not be restored.
"""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from screw_module_msgs.msg import (
    AmplifierState,
    EncoderSample,
    ExcitationRequest,
    ImpedanceState,
    SafetyState,
)
from screw_module_msgs.srv import SetControlMode

from screw_module_ros.calibration.module import (
    load_friction_model,
    load_linearization,
    load_module_calibration,
    thesis_friction,
)
from screw_module_ros.clock import TimeStandsStill, WallClock
from screw_module_ros.control.excitation import Excitation, as_numbers
from screw_module_ros.control.law import FRICTION, Law
from screw_module_ros.control.laws import LAWS, law_of, loaded, names
from screw_module_ros.control.linearization import default_linearization
from screw_module_ros.control.modes import EXCITATION, OFF
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.geometry import Screw, force_to_torque
from screw_module_ros.identification.trials import (
    MOTION,
    RELEASE,
    STAGE,
    TORQUE,
    MotionTrial,
    NotPossible,
    OnProgress,
    Samples,
    StageTrial,
    TorqueTrial,
    Trial,
    duration_of,
    require,
)
from screw_module_ros.operator.client import RobotError
from screw_module_ros.operator.robot import Robot
from screw_module_ros.settings import SettingError

from .checks import (
    check_acting,
    check_disabled,
    check_height,
    check_homed,
    check_not_stopped,
    check_passive,
    check_screw,
    common_rate,
)
from .fixture import Fixture
from .samples import Recorded, Window, recorded

CONTROLLER, AMPLIFIER = "impedance_controller", "amplifier"
_RENEW_NS = 100_000_000
_ZERO_S, _TAIL_S, _LEAD_S = 0.5, 0.05, 0.1
_SILENT_S, _BEGIN_S, _PERMIT_S, _BACK_S = 2.0, 3.0, 10.0, 3.0
_SPARE_S = 5.0
_POLL_S = 0.05
_CLEAN_UP_S, _HURRIED_S = 40.0, 10.0
_SAG = 0.05  # largest sag of the handle in a hand [m]
_MOVED = 3e-6  # motion of the nut that counts as one [m]
_CALM = 1e-3  # [m/s]
_CALM_S, _SETTLE_S, _REST_LIMIT_S = 0.5, 1.5, 5.0
_WALL = WallClock()  # clock of the process's shutdown, which does not wait by the robot's time

Reader = Callable[[Recorded], Samples]
"""Returns a trial's samples from its bag."""


class LiveStand:
    """A `trials.Stand` on the live graph, for one experiment; one thread calls it.

    left: sentences about what could not be restored; notes: for the result; clock: of the graph.
    """

    def __init__(
        self,
        robot: Robot,
        publish: Callable[[ExcitationRequest], None],
        fixture: Fixture,
        folder: Path,
        say: Callable[[str], None],
        left: list[str],
        hurried: Callable[[], bool] = lambda: False,
    ):
        """Raises NotPossible, RobotError.

        publish: sends a request of the lease; folder: of the bags; say: shows the current step to
        the user; left: gets sentences about what could not be restored; hurried: whether the
        restoration must be quick.
        """
        self.left = left
        self.notes: list[str] = []
        self.clock = robot.clock
        self._robot, self._publish, self._fixture = robot, publish, fixture
        self._folder, self._say, self._hurried = folder, say, hurried
        self._request: ExcitationRequest | None = None
        self._sines = self._due_ns = 0
        self._torque_on = False
        self._allowed = robot.watch
        with self.clock.working():
            self.screw = Screw(robot.parameters("encoder", ("lead",))["lead"])
            self.rate = common_rate(robot)
            own = robot.parameters(CONTROLLER, ("module_serial", "laws"))
            self.serial = own["module_serial"]
            self.laws = laws_of_controller(own.get("laws", ()))
            self.law_settings: Mapping[str, Any] = {
                law.name: self._settings_of(law)
                for law in self.laws if law.settings is not VerticalSettings
            }
        self.offers = frozenset({TORQUE, STAGE, MOTION, *([RELEASE] if fixture.simulated else [])})
        place = "simulated rig" if fixture.simulated else "hardware"
        self.name = f"live graph, {place}, module {self.serial or 'without a serial'}"

    def __enter__(self) -> LiveStand:
        self._robot.watch = self._watch
        return self

    def __exit__(self, *_: object) -> None:
        with self.clock.working(), self._unhurried("handle not restored"):
            self._fixture.put_back()
        self._robot.watch = self._allowed

    def fingerprint(self) -> str:
        """Return the graph's calibrations; parts measured with others are not reused."""
        robot, kinds = self._robot, (AmplifierState, ImpedanceState)
        with self.clock.working():
            robot.met(lambda: all(map(robot.state, kinds)), _SILENT_S)
        states = map(robot.state, kinds)
        return ", ".join(state.calibration if state else "unknown" for state in states)

    def _settings_of(self, law: Law) -> Any:
        """Return the settings with which the controller runs a law of others.

        What is no parameter there keeps its default.
        """
        names = {name: f"{law.name}.{name}" for name in law.settings._fields}
        found = self._robot.parameters(CONTROLLER, tuple(names.values()))
        return law.settings(**{name: found[full] for name, full in names.items() if full in found})

    def record(self, trial: Trial, on_progress: OnProgress) -> Samples:
        """Do a trial. Raises NotPossible, Cancelled, RobotError, BagError, SamplesLost."""
        require(trial, self)
        on_progress(0.0)
        act: dict[type, Callable[..., Reader]] = {
            TorqueTrial: self._torque, StageTrial: self._stage, MotionTrial: self._motion
        }  # fmt: skip
        name = name_of(trial, self.laws)
        bag, reader = self._recorded(name, act[type(trial)], trial, on_progress)
        return reader(recorded(bag, self.rate, self._robot.node.resolve_topic_name))

    def zero(self) -> tuple[float, float, float, float, float, float]:
        """Return the tared transducer's reading without load: forces [N], torques [Nm], x to z."""
        bag, window = self._recorded("zero", self._zeroed)
        found = recorded(bag, self.rate, self._robot.node.resolve_topic_name)
        return tuple(found.zero(window)[1].tolist())

    # Recording -----------------------------------------------------------------------------

    def _recorded(self, name: str, act: Callable[..., Any], *args: Any) -> tuple[Path, Any]:
        """Act while the session recorder records; return the bag and the act's answer.

        The thread takes part in simulated time meanwhile, but not in its computations.
        """
        robot = self._robot
        with self.clock.working():
            begun = robot.start_recording()
            whole = False
            try:
                answer = act(*args)
                robot.pause(_TAIL_S)
                whole = True
            finally:
                with self._unhurried("the recording has not ended"):
                    robot.stop_recording()
                if not whole:
                    shutil.rmtree(begun, ignore_errors=True)
        if not begun.is_dir():
            raise RobotError(f"the session recorder writes on another machine: there is no {begun}")
        self._folder.mkdir(parents=True, exist_ok=True)
        number = sum(1 for _ in self._folder.glob(f"{name}_*")) + 1
        return Path(shutil.move(begun, self._folder / f"{name}_{number}")), answer

    def _zero(self) -> Window:
        """Return a window in which nothing acts on the transducer."""
        begin_ns = self.clock.now_ns()
        self._robot.pause(_ZERO_S)
        return Window(begin_ns, self.clock.now_ns())

    def _unloaded_zero(self) -> Window:
        """The same, with the handle unloaded, as it then stays."""
        self._fixture.unload()
        return self._zero()

    def _zeroed(self) -> Window:
        fixture = self._fixture
        if fixture.mounted() in ("free", "locked_rotor"):
            return self._zero()
        fixture.require(fixture.mounted() or "human_arm")
        check_passive(self._robot)
        window = self._unloaded_zero()
        fixture.reload()
        return window

    def _until(
        self, done: Callable[[], bool], deadline_s: float, look: Callable[[float], None]
    ) -> None:
        """Wait until `done`; `look` gets the seconds since the start.

        Raises RobotError if the encoder is silent or the deadline passes, and errors of `look`.
        """
        robot, begin_ns = self._robot, self.clock.now_ns()
        while not done():
            robot.pause(_POLL_S)
            elapsed = (self.clock.now_ns() - begin_ns) * 1e-9
            look(elapsed)
            if robot.state(EncoderSample) is None:
                raise RobotError(f"the encoder is silent{robot.complaints_text()}")
            if elapsed > deadline_s:
                raise RobotError(f"not done after {deadline_s:.0f} s, given up")

    # The lease -----------------------------------------------------------------------------

    def _watch(self) -> None:
        """Renew the lease, and hear of a cancellation; called in every wait of the client."""
        if self._request is not None and self.clock.now_ns() >= self._due_ns:
            self._renew()
        self._allowed()

    def _renew(self) -> None:
        self._due_ns = self.clock.now_ns() + _RENEW_NS
        self._publish(self._request)

    def _ask(self, sine: Excitation) -> None:
        """Request a sine from now on, or the lease alone."""
        self._sines += 1
        numbers = as_numbers(sine.linearization) if sine.linearization else (0.0,) * 10
        self._request = ExcitationRequest(
            id=(self.clock.now_ns() // 1_000_000 + self._sines) & 0xFFFFFFFF,
            amplitude=sine.amplitude, frequency=sine.frequency, ticks=sine.ticks,
            linearized=sine.linearization is not None, linearization=numbers,
        )  # fmt: skip
        self._renew()

    @contextlib.contextmanager
    def _leased(self) -> Iterator[None]:
        """Have the controller in mode EXCITATION, in which a trial may change its settings.

        Afterwards the torque is off, and the controller as it was found.
        """
        robot = self._robot
        check_disabled(robot)
        check_not_stopped(robot)
        check_screw(robot, self.screw)
        names = (*VerticalSettings._fields, "mode")
        found = robot.parameters(CONTROLLER, names)
        mode, refusals = SetControlMode.Request(mode=EXCITATION), [""]

        def begun() -> bool:
            answer = robot.call(SetControlMode, f"{CONTROLLER}/set_mode", mode)
            refusals.append(answer.message)
            return answer.success

        try:
            self._ask(Excitation())
            if not robot.met(begun, _BEGIN_S):
                raise RobotError(f"{CONTROLLER}/set_mode was refused: {refusals[-1]}")
            yield
        finally:
            self._torque_off()
            self._request = None
            with self._unhurried("controller's settings not restored"):
                robot.wait_until(
                    lambda: robot.parameters(CONTROLLER, names) == found, _BACK_S,
                    f"{CONTROLLER} keeps the trial's",
                )  # fmt: skip

    @contextlib.contextmanager
    def _unhurried(self, what: str) -> Iterator[None]:
        """Ignore cancellation in the block, for the restoration of the graph; limited in time.

        An error goes to `left`: what comes next may still succeed.
        """
        allowed, begun_ns = self._allowed, _WALL.now_ns()

        def in_time() -> None:
            limit_s = _HURRIED_S if self._hurried() else _CLEAN_UP_S
            if (_WALL.now_ns() - begun_ns) * 1e-9 > limit_s:
                raise RobotError(f"the restoration of the graph took longer than {limit_s:g} s")

        self._allowed = in_time
        try:
            yield
        except (RobotError, TimeStandsStill) as error:
            self.left.append(f"{what}: {error}")
        finally:
            self._allowed = allowed

    # Torque --------------------------------------------------------------------------------

    def _enable(self) -> None:
        """Wait for the supervisor's permission and switch the torque on. Raises RobotError."""
        robot = self._robot
        if not robot.met(
            lambda: (state := robot.state(SafetyState)) and state.vertical_permitted, _PERMIT_S
        ):
            state = robot.state(SafetyState)
            why = "; ".join(state.reasons) if state else "the supervisor is silent"
            why = why or ("the lock pin is in" if state.vertical_locked else "no reason given")
            raise RobotError(f"no permission to move: {why}")
        self._torque_on = True
        robot.enable()

    def _torque_off(self) -> None:
        """Disable the amplifier if this stand enabled it."""
        if not self._torque_on:
            return
        if self._request is not None:
            self._ask(Excitation())  # zero with the next sample
        with self._unhurried("amplifier not disabled"):
            self._robot.enable(False)
            self._torque_on = False

    # Trials; each returns what reads its samples ----------------------------------------------

    def _torque(self, trial: TorqueTrial, on_progress: OnProgress) -> Reader:
        """Play a sine of torque on the locked rotor."""
        robot, say = self._robot, self._say
        sine = excitation_of(trial, self.rate)
        self._fixture.require("locked_rotor")
        check_homed(robot)
        own = robot.parameters(AMPLIFIER, ("gate.ramp_time", "rated_torque"))
        say("zero of the transducer")
        before = self._zero()
        with self._leased():
            say("torque on")
            self._enable()
            robot.pause(own["gate.ramp_time"] + 2.0 * _LEAD_S)
            say(f"sine of {trial.amplitude:g} Nm, {trial.frequency:.3g} Hz")
            begin_ns = self.clock.now_ns()
            end_ns = begin_ns + round((trial.duration + _LEAD_S) * 1e9)
            self._ask(sine)

            def look(elapsed: float) -> None:
                check_acting(robot)
                if robot.newest(AmplifierState).saturated:
                    raise RobotError("the amplifier limits the torque: the sine is distorted")
                on_progress(min(elapsed / trial.duration, 1.0))

            self._until(lambda: self.clock.now_ns() >= end_ns, trial.duration + _SPARE_S, look)
        robot.pause(_LEAD_S)
        say("zero of the transducer again")
        after = self._zero()
        rated = own["rated_torque"]

        def commands(force: np.ndarray) -> np.ndarray:
            steps = np.round([force_to_torque(newtons) / rated * 1e3 for newtons in force])
            return steps * rated * 1e-3

        return lambda found: found.samples(
            first_tick(found, begin_ns, sine), sine.ticks, before, after, commands
        )

    def _stage(self, trial: StageTrial, on_progress: OnProgress) -> Reader:
        """Let the stage drive the handle."""
        robot, fixture, say = self._robot, self._fixture, self._say
        fixture.require("stage")
        check_homed(robot)
        check_passive(robot)
        say(f"carrying the handle to {1e3 * trial.start:.1f} mm")
        fixture.stage_at(trial.start, trial.upside_down)
        check_height(robot, trial.start, self.screw)
        say("zero of the transducer, handle unloaded")
        before = self._unloaded_zero()
        fixture.stage_hold()
        share = 1.0 / len(trial.ways)
        seconds, begun = share * duration_of(trial), []
        for number, (speed, end) in enumerate(trial.ways):

            def on_share(part: float, done: float = share * number) -> None:
                on_progress(done + share * part)

            begun.append(self._driven(speed, end, seconds, on_share))
        say("zero of the transducer again")
        after = self._unloaded_zero()
        fixture.stage_hold()
        count = round((seconds + _TAIL_S) * self.rate)

        def read(found: Recorded) -> Samples:
            firsts = [
                found.tick_at(began_ns) if began_ns else first_moved(found, rest_ns)
                for rest_ns, began_ns in begun
            ]
            return in_turn([found.samples(first, count, before, after) for first in firsts])

        return read

    def _driven(
        self, speed: float, end: float, seconds: float, on_progress: OnProgress
    ) -> tuple[float, float | None]:
        """Run the stage one way, of so many seconds; return a time before it, and of its start.

        Both [ns]; the start is None where only the position of the nut is known.
        """
        robot, fixture = self._robot, self._fixture
        self._say(f"stage at {1e3 * speed:+g} mm/s to {1e3 * end:.1f} mm")

        def look(elapsed: float) -> None:
            check_passive(robot)
            check_homed(robot)
            on_progress(min(elapsed / seconds, 1.0))

        rest_ns = self.clock.now_ns()
        try:
            fixture.stage_go(speed, end)
            deadline_s = (1.2 if fixture.simulated else 20.0) * seconds + _SPARE_S
            self._until(lambda: fixture.stage_passed(end), deadline_s, look)
            robot.pause(2.0 * _TAIL_S)
        finally:
            with self._unhurried("stage not stopped"):
                fixture.stage_halt()
        return rest_ns, fixture.stage_began_ns()

    def _motion(self, trial: MotionTrial, on_progress: OnProgress) -> Reader:
        """Let a hand move the handle while the law runs with the trial's settings."""
        robot, fixture, say = self._robot, self._fixture, self._say
        fixture.require("human_arm")
        check_homed(robot)
        check_disabled(robot)
        self._check_calibrations(trial)
        say("zero of the transducer, handle unloaded")
        fixture.unload()
        robot.tare()  # as in process: the laws feel an old zero as a force
        before = self._zero()
        say(f"the hand goes to {1e3 * trial.centre:.0f} mm")
        fixture.hand_at(trial.arm, trial.centre)
        check_height(robot, trial.centre, self.screw, _SAG)
        with self._leased():
            robot.set_parameters(CONTROLLER, {**trial.settings._asdict(), "mode": trial.mode})
            if trial.mode != OFF:
                say("torque on")
                self._enable()
            self._come_to_rest(trial)
            begin_ns = self._moved(trial, on_progress)
            share = robot.newest(ImpedanceState).gain_share
        say("zero of the transducer again")
        after = self._unloaded_zero()
        fixture.reload()
        count = round(trial.duration * self.rate)
        return lambda found: found.samples(
            found.tick_at(begin_ns), count, before, after,
            lambda force: np.full(len(force), np.nan),
        )._replace(share=np.full(count, share))  # fmt: skip

    def _moved(self, trial: MotionTrial, on_progress: OnProgress) -> int:
        """Let the hand move for the trial's duration; return when it began [ns]."""
        robot, fixture, held = self._robot, self._fixture, True

        def look(elapsed: float) -> None:
            nonlocal held
            check_homed(robot)
            if trial.mode != OFF:
                check_acting(robot)
            if held and elapsed >= trial.released_after:
                held = False
                self._say("the hand lets go")
                fixture.hand_lets_go()
            on_progress(min(elapsed / trial.duration, 1.0))

        self._say(f"the hand moves, {names(self.laws)[trial.mode]}")
        try:
            fixture.hand_moves(trial)
            begin_ns = self.clock.now_ns()
            end_ns = begin_ns + round((trial.duration + _TAIL_S) * 1e9)
            self._until(lambda: self.clock.now_ns() >= end_ns, trial.duration + _SPARE_S, look)
        except Exception:  # the torque may be why somebody cancels: off before the hand rests
            self._torque_off()
            raise
        finally:
            with self._unhurried("hand not at rest"):
                fixture.hand_rests(trial.centre)
        return begin_ns

    def _come_to_rest(self, trial: MotionTrial) -> None:
        """Wait until the spring has faded in and the handle is at rest, at most 5 s."""
        robot, calm = self._robot, 0.0
        self._say("waiting until the handle is at rest")
        robot.set_setpoint(z=trial.centre)
        robot.pause(_SETTLE_S)
        end_ns = self.clock.now_ns() + round(_REST_LIMIT_S * 1e9)
        while calm < _CALM_S and self.clock.now_ns() < end_ns:  # a chattering handle never rests
            robot.pause(0.1)
            calm = calm + 0.1 if abs(robot.newest(EncoderSample).velocity) < _CALM else 0.0

    # Calibrations: only the graph's own; a trial with another one is refused ----------------

    def _check_calibrations(self, trial: MotionTrial) -> None:
        robot = self._robot
        kinds: list[tuple[str, str, str, Any, tuple[Callable[..., Any], Callable[[], Any]]]] = [
            ("linearization", "linearization", AMPLIFIER, trial.linearization,
             (load_linearization, default_linearization)),
        ]  # fmt: skip
        law = law_of(trial.mode, self.laws)
        if law is not None and FRICTION in law.variants[trial.mode].uses:
            kinds.append(("friction", "friction model", CONTROLLER, trial.friction,
                          (load_friction_model, thesis_friction)))  # fmt: skip
        for what, text, node, wanted, sources in kinds:
            used, name = calibrated(robot, node, what, *sources)
            if node == AMPLIFIER and not robot.parameters(AMPLIFIER, ("linearize",))["linearize"]:
                used, name = None, "none"
            if wanted not in (None, used):
                raise NotPossible(
                    f"the trial wants another {text} than {node} runs with ({name}): start {node} "
                    f"with it ({what}_file or calibration_file)"
                )
            note = f"The {text} of {node}: {name}."
            if wanted is None and note not in self.notes:
                self.notes.append(note)


# What a trial is made of --------------------------------------------------------------------


def name_of(trial: Trial, laws: tuple[Law, ...] = LAWS) -> str:
    """Return a name for a trial's bag; laws: of the controller."""
    if isinstance(trial, TorqueTrial):
        return f"torque_{trial.frequency:.3g}Hz_{trial.amplitude:g}Nm"
    if isinstance(trial, StageTrial):
        return f"stage_{1e3 * trial.speed:+g}mm_s"
    if isinstance(trial, MotionTrial):
        return f"motion_{names(laws)[trial.mode].lower()}"
    return "other"


def laws_of_controller(paths: Sequence[str]) -> tuple[Law, ...]:
    """Return the laws that the controller runs. Raises NotPossible for one that is not here."""
    try:
        return loaded(paths)
    except SettingError as error:
        raise NotPossible(
            f"{error}: {CONTROLLER} runs it, and characterize must import it too: start both with "
            "the same PYTHONPATH"
        ) from None


def excitation_of(trial: TorqueTrial, rate: float) -> Excitation:
    """Return the sine of a trial. Raises NotPossible if a graph of this rate cannot make it."""
    if trial.rate not in (0.0, rate):
        raise NotPossible(
            f"the trial wants {trial.rate:g} samples per second, the graph ticks at {rate:g}: start"
            f" it with rate:={trial.rate:g} for all vertical nodes"
        )
    ticks = round(trial.duration * rate)
    sine = Excitation(1, trial.amplitude, trial.frequency, ticks, trial.linearization)
    if refused := sine.refusal(rate):
        raise NotPossible(refused)
    return sine


def first_tick(found: Recorded, begin_ns: float, sine: Excitation) -> int:
    """Return the tick with which a sine began, after a time [ns]. Raises RobotError.

    The first commands may be missing in the bag; their sine tells how many.
    """
    ticks, force = found.command.ticks, found.command.values[:, 0]
    acting = np.flatnonzero((ticks >= found.tick_at(begin_ns)) & (force != 0.0))
    if not len(acting):
        raise RobotError("the excitation did not start: no command of it was recorded")
    row = acting[0]
    torque = force_to_torque(force[row])
    missing = min(range(60), key=lambda n: round(abs(sine.torque(n, found.rate) - torque), 9))
    return int(ticks[row]) - missing


def in_turn(ways: Sequence[Samples]) -> Samples:
    """Return the samples of ways of one length one after the other, at even times."""
    first = ways[0]
    columns = {
        name: np.concatenate([getattr(way, name) for way in ways])
        for name in first._fields if getattr(first, name) is not None
    }  # fmt: skip
    columns["time"] = np.arange(len(columns["time"])) * (first.time[1] - first.time[0])
    return first._replace(**columns)


def first_moved(found: Recorded, rest_ns: float) -> int:
    """Return the tick at which the nut begins to move after a time [ns], that tick without any."""
    first = found.tick_at(rest_ns)
    later = found.encoder.ticks >= first
    ticks, position = found.encoder.ticks[later], found.encoder.values[later, 0]
    moved = np.abs(position - position[0]) > _MOVED
    return int(ticks[max(0, int(np.argmax(moved)) - 1)])


def calibrated(
    robot: Robot, node: str, what: str, load: Callable[[str], Any], thesis: Callable[[], Any]
) -> tuple[Any, str]:
    """Return the linearization or the friction model a node runs with, and its name."""
    own = robot.parameters(node, (f"{what}_file", "calibration_file", "module_serial"))
    if file := own.get("calibration_file"):
        return getattr(load_module_calibration(file, own["module_serial"]), what), file
    if file := own[f"{what}_file"]:
        return load(file), file
    return thesis(), "of the thesis"
