# SPDX-License-Identifier: Apache-2.0
"""The vertical axis before its ends of travel: law, slot and plant in one compiled loop.

A slot that leads beyond an end reaches the law here as it is: `Guide` would keep it within the
travel. Without braking the handle meets an end with up to 0.9 m/s and 690 N.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pytest
from anything import fixed
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.calibration.module import thesis_friction
from screw_module_ros.compiled import compiled, packed
from screw_module_ros.control.envelope import enveloped, initial_state
from screw_module_ros.control.laws.thesis import THESIS, Own
from screw_module_ros.control.linearization import default_linearization
from screw_module_ros.control.modes import FORCE_FEEDBACK, IMPEDANCE, OBSERVER
from screw_module_ros.control.slot import Slot, SlotInput, SlotLimits, slot_step
from screw_module_ros.control.slot import initial_state as no_slot
from screw_module_ros.control.torque_chain import COLD, TorqueChain, commanded, on_the_wire
from screw_module_ros.control.vertical import VerticalInput
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.filters import VelocityState, lowpass_coefficients, velocity_step
from screw_module_ros.geometry import SCREW, counts_to_height
from screw_module_ros.plant.amplifier import bridge_current
from screw_module_ros.plant.module import HUMAN_ARM, ModuleInput, resting_state, vertical_params
from screw_module_ros.plant.patient import ArmForce
from screw_module_ros.plant.settings import load_world
from screw_module_ros.plant.vertical import vertical_step as module_step

WORLD = load_world()
vertical_step = enveloped(THESIS)
TRAVEL = WORLD.vertical.travel
SUBSTEP = 50e-6
LATE = 5  # substeps until a command acts
PINNED = 0.6  # [s] at first: nothing moves before the law's parts have faded in
RIGID, SOFT = 1e12, 1e7  # [N/m] axial support of the screw
MET = 0.12  # [m/s] at most, at an end, by whatever the robot does
FELT = 110.0  # [N] at most, on a hand that the robot took there
MODES = (IMPEDANCE, FORCE_FEEDBACK, OBSERVER)
ENDS = (TRAVEL, 0.0)
RATES = (500.0, 1000.0, 2000.0)
HAND = ArmForce(3.0, 300.0, 5.0, math.inf, 0.0)
UNBRAKED = {"edge_braking": 1000.0, "edge_damping": 0.0, "force_rate": 1e5}
"""A force that turns round at once needs no way for it."""
SLACK = Slot(side_stiffness=0.0, damping=0.0, half_width=0.0, end_half_width=0.0, growth=0.0)


class Tick(NamedTuple):
    """What one tick gets: mode; setpoint [m], NaN = none; slot, present, since its start [s];
    hand: where the virtual hand is [m]."""

    mode: int
    setpoint: float
    slot: Slot
    present: bool
    since: float
    hand: float


def loop(law, own, memory, limits, plant, amplifier, chain, smooth, module, slotted, script,
         period, record):  # fmt: skip
    """Run a tick for each row of the script: the fields of `Tick` in a row."""
    position = counts_to_height(math.floor(module.nut / SCREW.lead * 20000.0))
    motion = VelocityState(position, 0.0, 0.0)
    heat, current = COLD, 0.0
    for i in range(record.shape[0]):
        row = script[i]
        position = counts_to_height(math.floor(module.nut / SCREW.lead * 20000.0))
        velocity, motion = velocity_step(smooth, motion, position, period)
        slot = Slot(row[2], row[3], row[4], row[5], row[6], row[7], row[8], row[9], row[10],
                    row[11], row[12])  # fmt: skip
        wanted = SlotInput(position, 0.0, velocity, 0.0, row[13] > 0.0, slot, row[14])
        guided, slotted = slot_step(limits[0], slotted, wanted, period)
        inp = VerticalInput(
            int(row[0]), position, velocity, module.shown_force, row[1], 0.0, True,
            guided.force_x, guided.weight, 0.0,
        )  # fmt: skip
        output = vertical_step(law[0], own[0], memory[0], inp, period)
        made, heat = commanded(chain[0], heat, output.force, 1.0, period)
        torque = on_the_wire(chain[0], made.command)
        for step in range(round(period / SUBSTEP)):
            if step == LATE:
                current = bridge_current(amplifier[0], torque / plant[0].torque_constant)
            u = ModuleInput(
                current, True, False, HUMAN_ARM, i * period < PINNED, 1.0, row[15], 0.0, 0.0, 0.0,
                0.0, 0.0, 1.0,
            )  # fmt: skip
            module = module_step(plant[0], module, u)
        record[i, 0], record[i, 1] = module.handle, module.handle_velocity
        record[i, 2], record[i, 3] = module.patient_force, output.force


class Run(NamedTuple):
    """handle: position [m], its velocity [m/s], patient's force, command [N], of each tick."""

    handle: np.ndarray
    velocity: np.ndarray
    patient: np.ndarray
    command: np.ndarray

    @property
    def met(self) -> float:
        """Fastest speed outward at or beyond an end, zero if none was reached [m/s]."""
        outward = np.where(self.handle > 0.5 * TRAVEL, self.velocity, -self.velocity)
        there = outward[(self.handle >= TRAVEL) | (self.handle <= 0.0)]
        return float(max(there.max(), 0.0)) if there.size else 0.0

    @property
    def felt(self) -> float:
        """Largest force between hand and handle within 15 mm of an end [N]."""
        near = (self.handle > TRAVEL - 0.015) | (self.handle < 0.015)
        return float(abs(self.patient[near]).max()) if near.any() else 0.0


def run(ticks, law, arm=HAND, rate=1000.0, support=SOFT, start=0.18) -> Run:
    """Run the ticks from a height [m] at rest; the handle is held by its pin at first."""
    period, own = 1.0 / rate, Own(law, thesis_friction())
    pinned = Tick(IMPEDANCE, math.nan, SLACK, False, 0.0, start)
    ticks = [pinned] * round(PINNED * rate) + ticks
    script = np.array([(*t[:2], *t.slot, t.present, t.since, t.hand) for t in ticks], float)
    record = np.empty((len(ticks), 4))
    module = WORLD.vertical._replace(support_stiffness=support)
    plant = vertical_params(module, WORLD.friction, WORLD.amplifier, WORLD.transducer, arm, SUBSTEP,
                            WORLD.sensor.bandwidth, WORLD.sensor.hysteresis)  # fmt: skip
    compiled(loop)(
        packed(law), packed(own), packed(initial_state(law, THESIS, own)), packed(SlotLimits()),
        packed(plant), packed(WORLD.amplifier),
        packed(TorqueChain(linearization=default_linearization())),
        lowpass_coefficients(30.0, period), resting_state(module, start, 1.0), no_slot(), script,
        period, record,
    )  # fmt: skip
    return Run(*record.T)


def led_beyond(end, mode, rate, seconds=2.0):
    """Return the height of the start [m] and the ticks of a slot that leads 0.24 m beyond an end
    within 0.1 s, 0.1 m before it, by its stiffest wall."""
    outward = 1.0 if end > 0.0 else -1.0
    start = end - 0.11 * outward
    slot = SLACK._replace(start_x=start, target_x=end + 0.24 * outward, duration=0.1,
                          back_stiffness=800.0)  # fmt: skip
    times = [k / rate - 0.25 for k in range(round((seconds + 0.25) * rate))]
    return start, [Tick(mode, math.nan, slot, True, max(t, -1.0), start) for t in times]


def law_of(mode, **changed) -> VerticalSettings:
    """Return the settings of a mode: OBSERVER asks for a damper."""
    return VerticalSettings(damping=20.0 if mode == OBSERVER else 0.0, **changed).validated()


@pytest.mark.parametrize("support", [SOFT, RIGID])
@pytest.mark.parametrize("weight", [0.0, 20.0])
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("end", ENDS)
def test_a_slot_that_leads_beyond_an_end_meets_it_softly(end, mode, rate, weight, support):
    start, ticks = led_beyond(end, mode, rate)
    found = run(ticks, law_of(mode), HAND._replace(weight=weight), rate, support, start)
    assert found.met <= 0.01
    assert found.felt <= 65.0


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("end", ENDS)
def test_before_an_end_the_hand_rests_and_nothing_chatters(end, mode, rate):
    start, ticks = led_beyond(end, mode, rate, 6.0)
    found = run(ticks, law_of(mode), rate=rate, start=start)
    last = round(0.3 * rate)
    assert abs(found.handle[-1] - end) < 0.01, "in the soft stop"
    assert np.ptp(found.handle[-last:]) < 1e-4
    assert np.ptp(found.command[-last:]) < 1.0


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("end", ENDS)
def test_without_braking_the_same_slot_strikes(end, mode):
    """What the test above would find without the guard."""
    start, ticks = led_beyond(end, mode, 1000.0)
    found = run(ticks, law_of(mode, **UNBRAKED), start=start)
    assert found.met > 0.3 and found.felt > 110.0


segments = st.lists(
    st.tuples(
        st.floats(0.1, 1.0),  # [s]
        st.sampled_from(range(1, 6)),
        st.one_of(st.just(math.nan), st.floats(-1.0, 1.4)),
        st.booleans(),
        st.floats(-0.3, 0.7), st.floats(-0.3, 0.7), st.floats(0.1, 1.0),  # start, target, duration
        st.floats(0.0, 2000.0), st.floats(0.0, 2000.0),
    ),
    min_size=3, max_size=8,
)  # fmt: skip


@fixed(40)
@given(
    segments, st.sampled_from(RATES), st.floats(0.1, 0.26), st.floats(0.0, 6.0),
    st.sampled_from((0.0, 60.0, 300.0)), st.sampled_from((0.0, 0.0, 10.0, 20.0)),
    st.floats(0.0, 2000.0), st.floats(6.7, 8.0),
)  # fmt: skip
def test_no_sequence_of_slots_set_points_and_modes_meets_an_end_fast(
    asked, rate, hand, mass, grip, weight, stiffness, support
):
    """The patient does not push: his arm hangs on the handle with up to 20 N, or holds back.

    Who pushes himself is braked with 45 N down and 65 N up, the endpoint's limits, and by the
    friction that the mode leaves: more than that reaches the end, see docs/hazards.md.
    """
    law = VerticalSettings(stiffness=stiffness)
    law = law._replace(damping=law.least_damping)
    ticks = []
    for seconds, mode, setpoint, present, start, target, duration, back, side in asked:
        slot = Slot(start, 0.0, target, 0.0, duration, back, side, 5.0, 0.01, 0.002, 0.0)
        times = [k / rate - 0.2 for k in range(round(seconds * rate))]
        ticks += [Tick(mode, setpoint, slot, present, t, hand) for t in times]
    found = run(ticks, law, ArmForce(mass, grip, 5.0, math.inf, weight), rate, 10.0**support, hand)
    assert found.met <= MET and found.felt <= FELT, f"{found.met:.3f} m/s, {found.felt:.0f} N"


@pytest.mark.parametrize(("mode", "push"), [(IMPEDANCE, 30.0), (FORCE_FEEDBACK, 20.0),
                                            (OBSERVER, 20.0)])  # fmt: skip
@pytest.mark.parametrize("end", ENDS)
def test_a_hand_that_pushes_towards_an_end_is_braked_too(end, mode, push):
    """The spring of its arm ends `push` [N] outward of the soft stop."""
    outward = 1.0 if end > 0.0 else -1.0
    start, law = end - 0.11 * outward, law_of(mode, stiffness=0.0)
    hand = end - 0.01 * outward + outward * push / HAND.stiffness
    ticks = [Tick(mode, math.nan, SLACK, False, 0.0, hand)] * 2000
    assert run(ticks, law, start=start).met <= 0.06
    assert run(ticks, law._replace(**UNBRAKED), start=start).met > 0.4


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("end", ENDS)
def test_leaving_an_end_is_not_braked(end, mode):
    """A slot takes the hand back from the soft stop as fast with braking as without.

    At the bottom the hand gives way by some micrometres before it is taken, and is braked there.
    """
    outward = 1.0 if end > 0.0 else -1.0
    start = end - 0.005 * outward
    slot = SLACK._replace(start_x=start, target_x=0.5 * TRAVEL, duration=0.4, back_stiffness=800.0)
    ticks = [Tick(mode, math.nan, slot, True, k / 1000.0 - 0.25, start) for k in range(500)]
    law = law_of(mode)
    braked, free = (
        run(ticks, each, start=start)
        for each in (law, law._replace(edge_braking=1000.0, edge_damping=0.0))
    )
    assert np.allclose(braked.handle, free.handle, rtol=0.0, atol=1e-4)
    assert abs(braked.handle[-1] - start) > 0.01
