# SPDX-License-Identifier: Apache-2.0
"""The simulated rig as seen by its drives and sensors: commands in, counts and wrench out.

`World` holds the state of `simulation.advance` and the fixture at the handle. The simulated devices
command it; it reads no clock.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ..compiled import compiled, packed
from ..settings import validated
from .amplifier import bridge_current
from .fixture import NAMES, Fixture, changed_fixture, placed, running
from .module import (
    HUMAN_ARM,
    LOCKED_ROTOR,
    ModuleInput,
    resting_state,
    vertical_params,
)
from .muscles import RESTED
from .patient import (
    ArmSettings,
    HumanArm,
    another_patient,
    arm_force,
    changed_patient,
    moved_patient,
    resting_patient,
)
from .planar import ManusInput
from .plane_plant import MANUS_PLANT, PlanePlant
from .sensor import (
    DRAWS,
    Wrench,
    advanced,
    measured_wrench,
    seeded,
    sensor_params,
    true_wrench,
)
from .settings import WorldSettings, arm_of, load_world
from .simulation import (
    SimulationParams,
    SimulationState,
    advancing,
    numbers_of,
    state_of,
)

__all__ = ["ArmSettings", "Truth", "World", "WorldSettings", "load_world"]


class Truth(NamedTuple):
    """True values, with fields and units of SimTruth.msg."""

    handle_position: float
    handle_velocity: float
    nut_position: float
    nut_velocity: float
    friction: float
    patient_force: float
    motor_torque: float
    hand_target: float
    joint_position: tuple[float, float]
    joint_velocity: tuple[float, float]
    joint_torque: tuple[float, float]
    planar_position: tuple[float, float]
    planar_force: tuple[float, float]
    simulated_time: float
    fixture: str
    locked: bool
    upside_down: bool


class World:
    """The rig: set the commands, `advance`, read counts and wrench.

    vertical_command: current command to the vertical amplifier [A], up positive.
    planar_command: torque commands to shoulder and elbow [Nm].
    vertical_powered, planar_powered: a drive without power coasts, unless it is
    vertical_braked, planar_braked: motor shorted, which brakes.
    All are held until changed and begin at zero and without power.
    """

    def __init__(
        self, settings: WorldSettings, seed: int = 0, compile: bool = True,
        plane: PlanePlant = MANUS_PLANT,
    ):  # fmt: skip
        """Stand the rig at its start position, at rest, in the patient's hand.

        seed: of the noise and of the transducer's zeros; the same seed and commands give the same
        run. compile: False runs the plain functions, slower by a factor of about a hundred. plane:
        the planar arm; one of another package has its default settings. Raises ValueError when
        settings do not fit together, CompileError without numba.
        """
        self.settings = validated(settings)
        self.plane = plane
        self._plane = settings.planar if plane is MANUS_PLANT else plane.settings()
        advance = advancing(plane.step)
        self._advance = compiled(advance) if compile else advance
        self._measure = compiled(measured_wrench) if compile else measured_wrench
        self._prepared = packed if compile else lambda parameters: (parameters,)
        self._plain: Any = np.ndarray.tolist if compile else list
        self.vertical_command = 0.0
        self.planar_command = (0.0, 0.0)
        self.vertical_powered = False
        self.vertical_braked = False
        self.planar_powered = (False, False)
        self.planar_braked = (False, False)
        start = settings.start
        upright = -1.0 if start.upside_down else 1.0
        self._fixture = Fixture(HUMAN_ARM, start.locked, upright, 0.0, start.position, False)
        self._patient = resting_patient(settings.arm, start.x, start.y, start.position)
        self._sensor = sensor_params(settings.sensor, seed)
        self._noise = seeded(seed)
        self._measured: tuple[int, Wrench] = (-1, (0.0,) * 6)
        self._owed_ns = 0  # time that has passed and is not yet integrated
        self._substep_ns = round(settings.substep * 1e9)
        self._state = SimulationState(
            0,
            resting_state(settings.vertical, start.position, upright),
            plane.rest(self._plane, start.x, start.y),
            start.x, start.y, start.position, 0.0, 0.0, 0.0, RESTED,
        )  # fmt: skip
        numbers = numbers_of(self._state)  # of the same state, for `_advance`
        self._numbers: Any = np.array(numbers) if compile else numbers
        self._params = self._built()
        self.advance(0.0)  # compiles now, not in the first tick
        self.wrench()

    def _built(self) -> Any:
        """Return the parameters of the simulation in the form `_advance` takes."""
        s = self.settings
        arm = arm_force(self._patient.arm, self._patient.effort)
        return self._prepared(
            SimulationParams(
                vertical_params(s.vertical, s.friction, s.amplifier, s.transducer, arm, s.substep,
                                s.sensor.bandwidth, s.sensor.hysteresis),
                self.plane.params(self._plane, arm, s.substep),
                *self._patient.paths,
                self._patient.arm,
                self._patient.effort,
            )
        )

    def advance(self, dt: float) -> None:
        """Advance by dt [s], in whole substeps; the remainder is carried over.

        Raises ValueError for a negative dt or a command that is not finite.
        """
        if not 0.0 <= dt < math.inf:
            raise ValueError(f"dt = {dt!r} s: time only goes forward, by finite steps")
        steps, self._owed_ns = divmod(self._owed_ns + round(dt * 1e9), self._substep_ns)
        self._advance(
            self._params, self._numbers, self._vertical_input(), self._planar_input(), steps
        )
        self._state = state_of(self._plain(self._numbers))
        if self._fixture.placing:
            v = self._state.vertical
            if placed(self._fixture, v.handle, v.handle_velocity):
                self._fixture = running(self._fixture, self.settings.vertical.travel, v.handle)

    def _vertical_input(self) -> ModuleInput:
        command = float(self.vertical_command)
        if not math.isfinite(command):
            raise ValueError(f"vertical_command = {command!r} A: a finite number is wanted")
        powered = bool(self.vertical_powered)
        f = self._fixture
        return ModuleInput(
            bridge_current(self.settings.amplifier, command),
            powered,
            bool(self.vertical_braked) and not powered,
            f.acting, f.locked, f.upright, 0.0, 0.0, f.pace, f.target, 0.0, 0.0, 1.0,
        )  # fmt: skip

    def _planar_input(self) -> ManusInput:
        shoulder, elbow = map(float, self.planar_command)
        if not math.isfinite(shoulder + elbow):
            raise ValueError(f"planar_command = {self.planar_command!r} Nm: finite numbers wanted")
        on_1, on_2 = map(bool, self.planar_powered)
        brake_1, brake_2 = map(bool, self.planar_braked)
        return ManusInput(
            shoulder, elbow, on_1, on_2, brake_1 and not on_1, brake_2 and not on_2,
            self._fixture.kind == HUMAN_ARM, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0,
        )  # fmt: skip

    @property
    def simulated_time(self) -> float:
        """Time since the start [s], whole substeps."""
        return self._state.ticks * self.settings.substep

    @property
    def encoder_count(self) -> int:
        """Count of the motor's encoder, unbounded [counts], plus the power-on offset."""
        start, v = self.settings.start, self._state.vertical
        turns = v.nut / self.settings.vertical.lead + v.rotor_angle / (2.0 * math.pi)
        return math.floor(turns * start.counts_per_turn) + start.encoder_offset

    @property
    def planar_counts(self) -> tuple[int, int]:
        """Counts of shoulder and elbow (absolute angles), plus the power-on offsets."""
        start, plane = self.settings.start, self._state.planar
        return (
            math.floor(plane.shoulder / start.joint_resolution) + start.shoulder_offset,
            math.floor(plane.elbow / start.joint_resolution) + start.elbow_offset,
        )

    @property
    def vertical_torque(self) -> float:
        """Torque on the vertical motor's rotor [Nm]."""
        return self._state.vertical.torque

    @property
    def planar_torque(self) -> tuple[float, float]:
        """Motor torques of shoulder and elbow [Nm], brakes included."""
        (on_1, on_2), (brake_1, brake_2) = self.planar_powered, self.planar_braked
        return self.plane.torques(
            self._plane, self._state.planar, brake_1 and not on_1, brake_2 and not on_2
        )

    def wrench(self) -> Wrench:
        """Return the wrench of the patient on the robot in frame `handle` [N, Nm].

        With the transducer's zeros, drift and noise, not quantised. The noise depends on the time
        only, not on the number of calls.
        """
        if self._measured[0] == self._state.ticks:
            return self._measured[1]
        v, plane = self._state.vertical, self._state.planar
        true = true_wrench(
            plane.force_x,
            plane.force_y,
            v.shown_force,
            self.settings.vertical.grip_height,
            self.settings.transducer.stiffness * v.rotor_angle,
        )
        noise = advanced(*self._noise, DRAWS * self._state.ticks)
        wrench, *_ = self._measure(self._sensor, true, self.simulated_time, *noise)
        self._measured = (self._state.ticks, wrench)
        return self._measured[1]

    def truth(self) -> Truth:
        """Return the present true values."""
        state = self._state  # once: another thread may be advancing
        v, plane = state.vertical, state.planar
        return Truth(
            handle_position=v.handle,
            handle_velocity=v.handle_velocity,
            nut_position=v.nut,
            nut_velocity=v.nut_velocity,
            friction=v.friction,
            patient_force=v.patient_force,
            motor_torque=v.torque,
            hand_target=state.z,
            joint_position=(plane.shoulder, plane.elbow),
            joint_velocity=(plane.shoulder_velocity, plane.elbow_velocity),
            joint_torque=self.planar_torque,
            planar_position=self.plane.place(self._plane, plane),
            planar_force=(plane.force_x, plane.force_y),
            simulated_time=state.ticks * self.settings.substep,
            fixture=NAMES[self._fixture.acting],
            locked=self._fixture.locked,
            upside_down=self._fixture.upright < 0.0,
        )

    @property
    def arm(self) -> HumanArm:
        """The patient's arm."""
        return self._patient.arm

    def set_arm(self, arm: ArmSettings) -> None:
        """Change the patient's arm and send the virtual hand on its way; a new patient is rested.

        Raises ValueError naming the invalid field.
        """
        state = self._state
        if arm.patient:
            self._patient = another_patient(self._patient, arm_of(arm.patient), arm)
            self._put(state._replace(muscles=RESTED))
        else:
            hand = *self.plane.place(self._plane, state.planar), state.vertical.handle
            self._patient = changed_patient(self._patient, arm, self.simulated_time, hand)
        self._params = self._built()

    def set_fixture(
        self,
        name: str = "",
        speed: float = 0.0,
        position: float = math.nan,
        upside_down: bool = False,
        locked: bool = False,
    ) -> None:
        """Change the fixture of the handle, as in SetFixture.srv; '' keeps the fixture.

        speed: of the stage, up positive [m/s]; position: the handle first moves there [m], NaN = it
        stays. Raises ValueError naming the impossible value.
        """
        v = self._state.vertical
        self._fixture = changed_fixture(
            self._fixture, self.settings.vertical.travel, v.handle,
            name, float(speed), float(position), upside_down, locked,
        )  # fmt: skip
        if self._fixture.placing and self._fixture.kind == HUMAN_ARM:
            self._patient = moved_patient(self._patient, float(position))
            self._params = self._built()
        if self._fixture.kind != LOCKED_ROTOR and v.rotor_angle != 0.0:  # loose, it untwists
            loose = v._replace(rotor_angle=0.0, rotor_velocity=0.0)
            self._put(self._state._replace(vertical=loose))

    def _put(self, state: SimulationState) -> None:
        """Replace the state."""
        self._state = state
        self._numbers[:] = numbers_of(state)

    def place(self, position: float) -> None:
        """Put nut and handle at a height [m] at rest, at once: for studies in process.

        Raises ValueError outside the travel.
        """
        module = self.settings.vertical
        if not 0.0 <= position <= module.travel:
            raise ValueError(f"position = {position!r} m: 0 to {module.travel:g} m is wanted")
        vertical = resting_state(module, float(position), self._fixture.upright)
        self._put(self._state._replace(vertical=vertical))
        self._fixture = running(self._fixture, module.travel, vertical.handle)
