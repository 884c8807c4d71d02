# SPDX-License-Identifier: Apache-2.0
"""Settings of the simulated rig, from a YAML file (`params/plant.yaml`), perturbed by a seed."""

from __future__ import annotations

import math
import random
from functools import cache
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from ..resources import resource_path
from ..settings import Setting, read, shown
from ..settings_file import load, read_file
from .amplifier import Amplifier, amplifier_step_settings
from .friction import Friction, FrictionMap
from .instruments import Transducer
from .module import Vertical
from .patient import HumanArm
from .planar import Planar, resting_plane
from .sensor import Sensor

DEFAULT_FILE = "params/plant.yaml"
PATIENTS_FILE = "params/patients.yaml"
_SUPPORT = (5e6, 4e7)
"""Range of the axial support's stiffness that is drawn [N/m]. Ours: assumed, not in the thesis."""
_STRUCTURE_STIFFNESS = 5e4, 1e6  # [N/m] ours: no real plane's was found
_STRUCTURE_DAMPING_RATIO = 0.01, 0.04  # ours: of a bolted frame on ball bearings


class Start(NamedTuple):
    """Positions and counts at power-on."""

    position: Annotated[float, Setting("nut and handle from the bottom of travel", "m", 0.0, 2.0)]
    x: Annotated[float, Setting("handle from the workspace centre", "m", -1.0, 1.0)]
    y: Annotated[float, Setting("handle from the workspace centre", "m", -1.0, 1.0)]
    upside_down: Annotated[bool, Setting("the module hangs upside down")]
    locked: Annotated[bool, Setting("the lock pin is in")]
    encoder_offset: Annotated[int, Setting("count at z = 0", "counts", -(2**31), 2**31)]
    shoulder_offset: Annotated[int, Setting("count at angle 0", "counts", -(2**31), 2**31)]
    elbow_offset: Annotated[int, Setting("count at angle 0", "counts", -(2**31), 2**31)]
    counts_per_turn: Annotated[int, Setting("motor encoder", "counts", 4, 10_000_000)]
    joint_resolution: Annotated[float, Setting("joint encoders", "rad/count", 1e-7, 0.1)]


class WorldSettings(NamedTuple):
    """The rig: one section of the plant file each. substep: of the integration [s]."""

    vertical: Vertical
    friction: Friction
    amplifier: Amplifier
    transducer: Transducer
    planar: Planar
    arm: HumanArm
    sensor: Sensor
    start: Start
    substep: Annotated[float, Setting("step of the integration", "s", 1e-6, 2e-4)]

    def flaw(self) -> str:
        """Return which values are not consistent, empty if all are."""
        start, planar, vertical = self.start, self.planar, self.vertical
        if start.position > vertical.travel:
            return (
                f"start.position = {start.position:g} m lies above vertical.travel = "
                f"{vertical.travel:g} m"
            )
        for low, high in (("shoulder_low", "shoulder_high"), ("between_low", "between_high")):
            if getattr(planar, low) >= getattr(planar, high):
                return f"planar.{low} must lie below planar.{high}"
        if planar.between_low < 0.0 < planar.between_high:
            return (
                f"planar.between_low = {planar.between_low:g}, planar.between_high = "
                f"{planar.between_high:g} rad: between them the arm stretches and its elbow "
                "changes sides; both must have one sign"
            )
        try:
            resting = resting_plane(planar, start.x, start.y)
            amplifier_step_settings(self.amplifier, self.substep)
        except ValueError as error:
            return str(error)
        between = resting.elbow - resting.shoulder
        if not (
            planar.shoulder_low < resting.shoulder < planar.shoulder_high
            and planar.between_low < between < planar.between_high
        ):
            return (
                f"start.x = {start.x:g}, start.y = {start.y:g} m: there, with planar.elbow = "
                f"{planar.elbow}, the shoulder stands at {resting.shoulder:.2f} rad and the elbow "
                f"{between:.2f} rad from it, beyond the stops planar.shoulder_*, planar.between_*"
            )
        return ""


def load_world(path: str | Path | None = None, perturb_seed: int | None = None) -> WorldSettings:
    """Read the rig from a plant file; None = the one installed with the package.

    perturb_seed: draws another rig around the file's values (`perturbed`), None = as in the file.
    Raises SettingError naming the file and the key that is wrong.
    """
    file = Path(path) if path else Path(resource_path(DEFAULT_FILE))
    settings = read_file(file, WorldSettings)
    return settings if perturb_seed is None else perturbed(settings, perturb_seed)


@cache
def patients() -> dict[str, HumanArm]:
    """Return the arms of the simulated patients by name."""
    content = load(resource_path(PATIENTS_FILE))
    return {name: read(HumanArm, arm, name) for name, arm in content.items()}


def arm_of(patient: str) -> HumanArm:
    """Return the arm of a patient. Raises ValueError with the known ones where he is not."""
    if patient not in patients():
        known = ", ".join(patients())
        raise ValueError(f"patient = {shown(patient)}: one of {known} is wanted")
    return patients()[patient]


def perturbed(settings: WorldSettings, seed: int) -> WorldSettings:
    """Return another rig of the same build, drawn around `settings`; the same for the same seed.

    It changes friction (level, ripples, phases, slopes, shape of the trend, stiction, Stribeck,
    bristles, load, slip, warm-up), masses and with them gravity, the motor constant, dead zone and
    delay of the amplifier, play, contact, film, guide and the screw's axial support, noise and
    filter of the transducer. How large the differences of two modules are is ours; the thesis says
    only that its friction holds for one prototype until it is taken apart (5.1.1). The
    axial support and the structure of the plane have ranges of their own, whatever the file says.
    """
    draw = random.Random(f"plant {seed}")

    def about(value: float, spread: float) -> float:
        return _about(draw, value, spread)

    def map_about(settled: FrictionMap) -> FrictionMap:
        ripple = math.exp(draw.uniform(-0.4, 0.4))
        rotation: Any = tuple(ripple * number for number in settled.rotation)  # as many as before
        return settled._replace(
            rotation=rotation,
            slope=about(settled.slope, 0.3),
            intercept=about(settled.intercept, 0.1),
            low_scale=about(settled.low_scale, 0.1),
        )

    friction = settings.friction
    friction = friction._replace(
        against=map_about(friction.against),
        along=map_about(friction.along),
        scale=about(friction.scale, 0.3),
        phase=friction.phase + draw.uniform(-math.pi, math.pi),
        roller_amplitude=about(friction.roller_amplitude, 0.4),
        stiction=1.0 + about(friction.stiction - 1.0, 0.5),
        stribeck=about(friction.stribeck, 0.4),
    )
    vertical = settings.vertical
    vertical = vertical._replace(
        turning_mass=about(vertical.turning_mass, 0.15),
        moving_mass=about(vertical.moving_mass, 0.15),
        play=about(vertical.play, 0.4),
    )
    amplifier = settings.amplifier
    amplifier = amplifier._replace(
        dead_zone=about(amplifier.dead_zone, 0.3),
        torque_constant=about(amplifier.torque_constant, 0.03),
    )
    structure = random.Random(f"plant, structure of the plane, {seed}")
    planar = settings.planar._replace(
        structure_stiffness=_between(structure, *_STRUCTURE_STIFFNESS),
        structure_damping_ratio=_between(structure, *_STRUCTURE_DAMPING_RATIO),
    )
    # Separate random streams, so that seeds still draw the earlier values.
    return _less_known(
        settings._replace(
            friction=friction, vertical=vertical, amplifier=amplifier, planar=planar
        ),
        random.Random(f"plant, what nobody measures, {seed}"),
    )


def _about(draw: random.Random, value: float, spread: float) -> float:
    return value * math.exp(draw.uniform(-spread, spread))


def _between(draw: random.Random, low: float, high: float) -> float:
    return math.exp(draw.uniform(math.log(low), math.log(high)))


def _less_known(settings: WorldSettings, draw: random.Random) -> WorldSettings:
    """Return the rig with changed values that neither thesis nor data sheet gives."""
    f, v = settings.friction, settings.vertical
    friction = f._replace(
        against=_bent(f.against, draw),
        along=_bent(f.along, draw),
        stribeck_speed=_about(draw, f.stribeck_speed, 0.5),
        stiffness=_about(draw, f.stiffness, 0.7),
        damping=_about(draw, f.damping, 0.7),
        load_gain=_about(draw, f.load_gain, 0.7),
        load_time=_about(draw, f.load_time, 0.7),
        wave=draw.uniform(0.2, 0.8),
        wave_length=draw.uniform(0.03, 0.09),
        wave_phase=draw.uniform(-math.pi, math.pi),
        roller_phase=draw.uniform(-math.pi, math.pi),
        roller_slip=draw.uniform(0.0, 3.0),
        cold=draw.uniform(0.0, 0.15),
        cold_way=draw.uniform(2.0, 20.0),
    )
    vertical = v._replace(
        contact_stiffness=_about(draw, v.contact_stiffness, 1.0),
        contact_damping=_about(draw, v.contact_damping, 0.5),
        film_damping=_about(draw, v.film_damping, 0.5),
        rail_friction=draw.uniform(0.1, 0.8),
        rail_stiffness=_about(draw, v.rail_stiffness, 0.7),
    )
    amplifier = settings.amplifier._replace(delay=_about(draw, settings.amplifier.delay, 0.2))
    sensor = settings.sensor._replace(
        force_noise=_about(draw, settings.sensor.force_noise, 0.7),
        bandwidth=draw.uniform(300.0, 2000.0),
    )
    # Drawn last, so that seeds still draw the earlier values.
    vertical = vertical._replace(
        support_stiffness=_between(draw, *_SUPPORT),
        support_damping_ratio=_about(draw, v.support_damping_ratio, 1.0),
    )
    return settings._replace(
        friction=friction, vertical=vertical, amplifier=amplifier, sensor=sensor
    )


def _bent(branch: FrictionMap, draw: random.Random) -> FrictionMap:
    """Return a map whose trend is tilted and bent by up to 1.2 N at the ends of the screw."""
    tilt, bend = draw.uniform(-1.2, 1.2), draw.uniform(-1.2, 1.2)
    length = 355.0  # [mm] of the map
    added = (4.0 * bend / length**2, (2.0 * tilt - 4.0 * bend) / length, bend / 3.0 * 2.0 - tilt)
    trend: Any = tuple(  # as many as before
        old + more for old, more in zip(branch.trend, (0.0,) * 5 + added, strict=True)
    )
    return branch._replace(trend=trend)


def changed_later(settings: WorldSettings, seed: int) -> WorldSettings:
    """Return the rig some time after its calibration; the same for the same seed.

    Wear and grease have changed level of friction and play, rollers have slipped to another phase,
    the handle is heavier or lighter, the transducer has another zero. The calibration is outdated.
    """
    draw = random.Random(f"plant, later, {seed}")
    f, v, s = settings.friction, settings.vertical, settings.sensor
    return settings._replace(
        friction=f._replace(
            scale=_about(draw, f.scale, 0.2),
            roller_phase=draw.uniform(-math.pi, math.pi),
            phase=f.phase + draw.uniform(-0.3, 0.3),
        ),
        vertical=v._replace(
            moving_mass=v.moving_mass + draw.uniform(-0.1, 0.3),
            play=_about(draw, v.play, 0.2),
        ),
        sensor=s._replace(force_bias=_about(draw, s.force_bias, 0.5)),
    )
