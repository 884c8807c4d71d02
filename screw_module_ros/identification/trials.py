# SPDX-License-Identifier: Apache-2.0
"""Trials (one excitation of the module each), their samples, and the interface of a stand.

An experiment is a list of trials and a fit. A trial is data, so the same excitation runs on the
live graph and on the simulated module in process; a stand (`SimulatedStand`, or the live one of the
node `characterize`) turns it into samples. A stand says what it `offers`;
`require` refuses a trial that needs more, with the way out.

Every stand measures the zero of the transducer before and after a trial, without load on handle or
rotor, and subtracts the straight line between the two, so that drift does not appear as friction.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np

from ..control.friction import FrictionModel
from ..control.law import Law
from ..control.linearization import Linearization
from ..control.planar_settings import PlanarSettings
from ..control.vertical_settings import VerticalSettings
from ..geometry import Screw
from ..plant.patient import RIGID, ArmForce, HandPath, resting

DIRECTIONS = (("up", 1.0), ("down", -1.0))
"""Name and sign of both directions along the screw."""
WAY_S = 1.0  # time in which a hand goes to where the trial wants it

TORQUE, ANALYSER, STAGE, MOTION, PLANE = "torque", "analyser", "stage", "motion", "plane"
RELEASE, ONLY_IN_PROCESS, PRELOADED, TRUTH = "release", "only_in_process", "preloaded", "truth"
WAYS_OUT = {
    TORQUE: "a sine of torque on the locked rotor is not offered by this stand: mount the rotor's "
    "lock, or run this experiment with `make reproduce`",
    ANALYSER: "this trial needs a signal analyser on the servo amplifier, which the graph does not "
    "have: run the experiment in process",
    STAGE: "this stand has no positioning stage: run this experiment with `make reproduce`",
    MOTION: "no hand moves the handle on this stand: run this experiment with `make reproduce`",
    PLANE: "trials of the plane are only there in process: run this experiment with "
    "`make reproduce`",
    ONLY_IN_PROCESS: "a hand that presses sideways or trembles and a rig that changed are only "
    "there in process: run this experiment with `make reproduce`, or choose other cases and "
    "states, with side_force: 0.0",
    PRELOADED: "a nut without backlash is only there in process: leave it out with the goal's "
    "settings '{preloaded: false}', or run this experiment with `make reproduce`",
    RELEASE: "a hand that holds off the centre or lets go needs the simulated rig: choose cases in "
    "which the hand moves",
}
"""What a trial may need of a stand, and the way out where the stand lacks it. A stand that offers
TRUTH is a simulated module: it has the attributes `world` and `loop`, and true samples."""

OnProgress = Callable[[float], None]
"""Called with the share of a trial that is done, 0 to 1; may raise `Cancelled`."""


class Cancelled(Exception):
    """The experiment was cancelled; the stand has switched the torque off."""


class NotPossible(RuntimeError):
    """The stand cannot do this trial; the message names the missing condition and the way out."""


class TorqueTrial(NamedTuple):
    """Rotor locked to ground through the transducer: one sine of motor torque (thesis 4.1).

    frequency [Hz]; amplitude: of the commanded torque [Nm]; duration: of the sine [s];
    linearization: compensates the amplifier's dead zone, None = no compensation; rate: samples per
    second [1/s], 0 = the bench's own.
    """

    frequency: float
    amplitude: float
    duration: float
    linearization: Linearization | None = None
    rate: float = 0.0


class AnalyzerTrial(NamedTuple):
    """A signal analyser on the servo amplifier alone (thesis 4.1.2): one sine of its swept sine.

    frequency [Hz]; amplitude: of the command [A]; duration [s]; rate: the instrument's [1/s].
    """

    frequency: float
    amplitude: float
    duration: float
    rate: float = 256_000.0


class StageTrial(NamedTuple):
    """The positioning stage drives the handle at constant speed, no motor torque (thesis 5.2.3).

    speed: signed, up the screw positive [m/s]; start, end: heights on the screw [m];
    upside_down: the module hangs upside down (z stays positive up the screw); back: after a rest
    the stage returns to the start at the same speed, without the handle being unloaded in between.
    The samples are then those of both ways, one after the other, of one length, each from where the
    stage begins to move.
    """

    speed: float
    start: float
    end: float
    upside_down: bool = False
    back: bool = False

    @property
    def ways(self) -> tuple[tuple[float, float], ...]:
        """Signed speed [m/s] and end [m] of each way."""
        out = (self.speed, self.end)
        return (out, (-self.speed, self.start)) if self.back else (out,)


class Arm(NamedTuple):
    """The hand at the handle: mass [kg], stiffness [N/m], damping [Ns/m] (thesis 6.4.3)."""

    mass: float = 3.0
    stiffness: float = 300.0
    damping: float = 5.0


HEAVY, FIRM = Arm(30.0, 300.0, 30.0), Arm(0.5, 4000.0, 150.0)
"""An arm of 30 kg; a hand that follows every sine."""


class MotionTrial(NamedTuple):
    """The hand moves the handle up and down while the vertical law runs (thesis 5.3, chapter 6).

    mode: constant of `control.modes`; settings: of the law; friction, linearization: None = the
    thesis's; arm; centre, amplitude [m], omega [rad/s]: of the virtual hand's sine, which is also
    where the spring's set point stays (centre); duration [s], after the handle has come to rest at
    the centre; preloaded: with a nut that has no backlash, as thesis 6.4.3 suggests.

    way: distance of the sine's middle from the centre, reached within a second [m]; side_force:
    amplitude of the hand's sideways force, at 2 rad/s [N]; tremor: of the hand [m]; released_after:
    time at which the hand lets go [s]; changed: seed of the rig's change since its calibration
    (`plant.settings.changed_later`), 0 = no change. side_force, tremor, changed and `preloaded`
    need the stand in process, way and released_after a simulated module.
    """

    mode: int
    settings: VerticalSettings
    friction: FrictionModel | None = None
    linearization: Linearization | None = None
    arm: Arm = Arm()
    centre: float = 0.18
    amplitude: float = 0.15
    omega: float = 0.8
    duration: float = 18.0
    preloaded: bool = False
    way: float = 0.0
    side_force: float = 0.0
    tremor: float = 0.0
    released_after: float = math.inf
    changed: int = 0


class HandTrial(NamedTuple):
    """A `MotionTrial` whose hand moves otherwise, has a soft grip, or changes the mode; in process.

    motion: the trial, whose amplitude, way and tremor do not count; before: path of the virtual
    hand in the 3 s in which the spring fades in, then path: that of the trial; grip: of the hand;
    switched_after: time at which the mode becomes then_mode [s]; weight: that hangs on the handle,
    support: asked for it, up positive [N].
    """

    motion: MotionTrial
    before: HandPath
    path: HandPath
    grip: ArmForce = RIGID
    switched_after: float = math.inf
    then_mode: int = 0
    weight: float = 0.0
    support: float = 0.0

    @property
    def duration(self) -> float:
        """Of the samples [s]."""
        return self.motion.duration


class Part(NamedTuple):
    """A part of a `CarryTrial`.

    seconds: that it lasts; path: of the virtual hand, from the part's begin on; support: asked for,
    up positive [N]; there: the hand is on the handle; powered: the drive is enabled; braked: else
    it shorts the motor.
    """

    seconds: float
    path: HandPath
    support: float
    there: bool = True
    powered: bool = True
    braked: bool = False


class CarryTrial(NamedTuple):
    """An arm hangs on the handle, and the robot carries it with its support; in process only.

    motion: mode, law, arm and centre, of which alone count; weight: that hangs on the handle [N];
    parts: one after the other, the first after 3 s in which the support comes; grip: of the hand.
    """

    motion: MotionTrial
    weight: float
    parts: tuple[Part, ...]
    grip: ArmForce = RIGID

    @property
    def duration(self) -> float:
        """Of the samples [s]."""
        return sum(part.seconds for part in self.parts)


class PlaneLoop(NamedTuple):
    """The sampled loop of the plane, as the node `manus` has it on the graph.

    rate: samples per second [1/s]; delay: from a sample to its torque [s]; force_age: of the newest
    force sample at a tick [s]; cutoff: of the velocity filter [Hz].
    """

    rate: float = 500.0
    delay: float = 0.0007
    force_age: float = 0.001
    cutoff: float = 30.0


SWEPT = 0.008, 0.48
"""Ends of a sweep of the plane, as shares of the rate."""


class PlanarTrial(NamedTuple):
    """The hand moves the handle in the plane while the planar law runs; in process only.

    settings: of the law; arm; direction: of the motion, from +x counter-clockwise [rad]; path: of
    the virtual hand in this direction; centre: x, y where the set point stays and the path has its
    zero [m]; duration: of the samples, after 1.5 s at the path's start; first: from when their
    error counts; released_after: time at which the hand lets go [s]; grip: of the hand; loop: of
    the plane; structure_stiffness: between joints and module [N/m], 0 = the rig's own; tone: of the
    patient's flexors [Ns/m]; sweep: amplitude of a force that the motors add at the handle, from
    SWEPT[0] to SWEPT[1] of the rate in the trial, along `pushed` [N], [rad]. Its samples have two
    columns, x and y from the centre, in place of position, velocity and force, which is as the law
    sees it; command: that force [N].
    """

    settings: PlanarSettings
    arm: Arm = Arm()
    direction: float = 0.0
    path: HandPath = resting(0.0)
    duration: float = 8.0
    first: float = 0.0
    released_after: float = math.inf
    centre: tuple[float, float] = (0.0, 0.0)
    grip: ArmForce = RIGID
    loop: PlaneLoop = PlaneLoop()
    structure_stiffness: float = 0.0
    tone: float = 0.0
    sweep: float = 0.0
    pushed: float = 0.0


Trial = (
    TorqueTrial | AnalyzerTrial | StageTrial | MotionTrial | HandTrial | CarryTrial | PlanarTrial
)
AnyTrial = TypeVar("AnyTrial", bound=Trial)


class Samples(NamedTuple):
    """Measured samples: float arrays of one length, evenly spaced in time.

    time: since the start of the excitation [s]; position: of the nut, by the encoder [m]; velocity:
    backward difference through the 30 Hz filter [m/s]; force: along z, of the patient or stage on
    the robot, zero subtracted [N]; torque: about z [Nm]; command: torque command to the amplifier
    for this sample [Nm] ([A] for the analyser), NaN in a motion on the live graph; current: of the
    motor [A], NaN if not measured; for a TorqueTrial the output of the current sensor of thesis C.2
    [V].

    True values, None on the live graph: handle [m], handle_velocity [m/s], true_force: of the
    patient on the robot [N]. share: remaining force gain after the chatter guard, 0 to 1; on the
    live graph its value at the end. support: in use, of a `CarryTrial` [N].
    """

    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    force: np.ndarray
    torque: np.ndarray
    command: np.ndarray
    current: np.ndarray
    handle: np.ndarray | None = None
    handle_velocity: np.ndarray | None = None
    true_force: np.ndarray | None = None
    share: np.ndarray = np.ones(1)
    support: np.ndarray = np.zeros(1)

    @property
    def felt(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Position [m], velocity [m/s] and force [N] at the handle: true, else by the sensors."""
        if self.handle is None or self.handle_velocity is None or self.true_force is None:
            return self.position, self.velocity, self.force
        return self.handle, self.handle_velocity, self.true_force


class Stand(Protocol):
    """Interface of a stand. rate: samples per second [1/s]; name: for reports, another one for
    another module; serial: the module's number as its controller has it, empty if unknown; offers:
    what trials may need, of `WAYS_OUT` and TRUTH; screw: for which encoder and amplifier are set;
    laws: of this package and of others; law_settings: of laws of others, by the laws' names, where
    they are not the defaults."""

    rate: float
    name: str
    serial: str
    offers: frozenset[str]
    screw: Screw
    laws: tuple[Law, ...]
    law_settings: Mapping[str, Any]

    def record(self, trial: Trial, on_progress: OnProgress) -> Samples:
        """Do a trial. Raises Cancelled, NotPossible; afterwards the torque is zero."""

    def zero(self) -> tuple[float, float, float, float, float, float]:
        """Return the transducer's reading without load: forces [N], torques [Nm], x to z."""


def duration_of(trial: Trial) -> float:
    """Return how long a trial's samples last [s]."""
    if isinstance(trial, StageTrial):
        return len(trial.ways) * abs(trial.end - trial.start) / abs(trial.speed)
    return trial.duration


_NEEDS = {
    TorqueTrial: TORQUE, AnalyzerTrial: ANALYSER, StageTrial: STAGE, PlanarTrial: PLANE,
    HandTrial: ONLY_IN_PROCESS, CarryTrial: ONLY_IN_PROCESS, MotionTrial: MOTION,
}  # fmt: skip


def require(trial: Trial, stand: Stand) -> None:
    """Raise NotPossible with the way out if the stand lacks what a trial needs."""
    needs = {_NEEDS[type(trial)]: True}
    if isinstance(trial, MotionTrial):
        needs |= {
            ONLY_IN_PROCESS: bool(trial.side_force or trial.tremor or trial.changed),
            PRELOADED: trial.preloaded,
            RELEASE: bool(trial.way) or math.isfinite(trial.released_after),
        }
    for need, way_out in WAYS_OUT.items():
        if needs.get(need) and need not in stand.offers:
            raise NotPossible(way_out)
