# SPDX-License-Identifier: Apache-2.0
"""The laws, bit for bit: a scripted input in, the stored digest of every output out.

A law is rewritten without a change of a single bit, or its digest changes and the commit says why.
Those of the vertical laws are their versions, `control/laws/versions.yaml`: with `--write` a source
that was changed is noted there, and the version stays; other bits make another version.

The inputs are made by sums and products alone, which are the same everywhere. The laws also use
`exp`, `pow`, `tan` and others, whose last bit may differ between mathematics libraries; where those
differ the digests say nothing, and the tests are skipped.

The compiled twins of the laws get the same inputs, and keep the same memory.
"""

from __future__ import annotations

import functools
import hashlib
import math
import random
import struct

import pytest
import yaml

from screw_module_ros.calibration import version
from screw_module_ros.calibration.module import thesis_friction
from screw_module_ros.calibration.version import FILE, Known, known_laws, law_version, source_of
from screw_module_ros.compiled import compiled, packed
from screw_module_ros.control.envelope import enveloped, initial_state
from screw_module_ros.control.excitation import (
    Excitation,
    Excited,
    as_numbers,
    excitation_step,
    from_numbers,
)
from screw_module_ros.control.law import Law
from screw_module_ros.control.laws import LAWS, own_of
from screw_module_ros.control.laws.plane_impedance import PLANE_IMPEDANCE
from screw_module_ros.control.laws.thesis import THESIS, Own
from screw_module_ros.control.limits import CommandLimits, TorqueLimits, limit_speed, soft_stop
from screw_module_ros.control.linearization import IDENTITY, default_linearization
from screw_module_ros.control.minimum_jerk import pace, way
from screw_module_ros.control.modes import EXCITATION, OFF
from screw_module_ros.control.planar import PlanarInput
from screw_module_ros.control.planar_settings import PlanarSettings
from screw_module_ros.control.plane_envelope import enveloped as enveloped_plane
from screw_module_ros.control.plane_envelope import initial_state as initial_plane
from screw_module_ros.control.setpoint import Range, SetPoint, follow
from screw_module_ros.control.slot import Slot, SlotInput, SlotLimits, half_width_at, slot_step
from screw_module_ros.control.slot import initial_state as initial_slot
from screw_module_ros.control.torque_chain import (
    COLD,
    TorqueChain,
    commanded,
    followed,
    largest_command,
    on_the_wire,
)
from screw_module_ros.control.vertical import VerticalInput
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.geometry import inverse
from screw_module_ros.settings import plain

MODEL = thesis_friction()
vertical_step = enveloped(THESIS)
planar_step = enveloped_plane(PLANE_IMPEDANCE)
SHIPPED = {law.name: law for law in LAWS}
HEAD = """\
# Versions of this package's laws: `make test ARGS="test/control/test_law_bits.py --write"`.
# runs: digests of long runs, bit for bit; source: digest of what the law's step reaches; formerly:
# versions that software with the same runs has given the law.
"""
TICKS = 6000
VERTICAL_LAW = VerticalSettings(damping=10.0, observer_inertia=0.7)
ANY_MODE, ANY = -2, "any"  # a run through all modes
RUNS = [(law.name, mode) for law in LAWS for mode in (ANY_MODE, OFF, *law.variants)]
LIBRARY = "3a929bd8f178edc3"
PLANE = {
    0.0: "c922181172027b9d",
    9.0: "de7b38ec48cb658d",
}
ODD = (math.nan, math.inf, -math.inf, 1e300)


def digest(numbers) -> str:
    """Return the first 16 hexadecimal digits of the SHA-256 of numbers, as IEEE doubles."""
    data = b"".join(struct.pack("<d", number) for number in numbers)
    return hashlib.sha256(data).hexdigest()[:16]


def library() -> str:
    """Return a digest of the mathematics library's results where the laws use it."""
    found = []
    for k in range(1, 3000):
        x = k / 3000.0
        found += [math.exp(-7.0 * x), math.tan(0.8 * x), (200.0 * x) ** 0.15, math.sin(9.0 * x)]
        found += [math.cos(9.0 * x), math.hypot(x, 1.0 - x), math.acos(x), math.atan2(x, 0.3)]
    return digest(found)


same_library = pytest.mark.skipif(
    library() != LIBRARY, reason="another mathematics library: its last bits differ"
)


def wave(phase: float) -> float:
    """Return a periodic function of a phase [turns], -1 to 1, made of parabolas."""
    u = 2.0 * (phase - math.floor(phase)) - 1.0
    return 4.0 * u * (1.0 - abs(u))


def sometimes(chance: random.Random, one_in: int) -> bool:
    """Return True once in so many calls, at random."""
    return chance.randrange(one_in) == 0


def vertical_inputs(mode: int, law_run: Law = THESIS):
    """Yield law, input and time step of a run: motion, rest, jolts, slots, odd input."""
    chance = random.Random(f"vertical {mode}")
    law, used = VERTICAL_LAW, mode
    size, frequency, press = 0.1, 0.2, 10.0
    strongest = 40.0 if mode == ANY_MODE else 60.0
    position = 0.18
    for tick in range(TICKS):
        if sometimes(chance, 300):
            size, frequency = chance.choice(((0.1, 0.2), (0.02, 1.0), (1e-4, 4.0), (0.19, 0.5)))
            press = chance.choice((0.3, 3.0, 15.0, strongest))
        if sometimes(chance, 400):
            law = law._replace(
                stiffness=chance.uniform(0.0, 600.0), force_gain=chance.uniform(0.0, 12.0),
                gravity=chance.uniform(5.0, 12.0), observer_friction=chance.choice((0.0, 0.7)),
                damping=chance.uniform(-10.0, 40.0),
            )  # fmt: skip
        if sometimes(chance, 300):
            if mode == ANY_MODE:
                used = chance.randint(-1, max(EXCITATION, *law_run.variants))
            else:
                used = chance.choice((mode, used, OFF))
        dt = chance.choice((0.0005, 0.002, 0.05)) if sometimes(chance, 100) else 0.001
        moved = 0.18 + size * wave(frequency * tick * 0.001)
        velocity, position = (moved - position) / 0.001, moved
        slot = (0.0, 0.5, 1.0)[tick // 500 % 3] if tick // 1500 % 2 else 0.0
        inp = VerticalInput(
            used,
            round(position * 1e6) / 1e6,
            max(-1.5, min(1.5, velocity)),
            press * wave((0.3, 9.3)[tick // 2000 % 2] * tick * 0.001) + chance.uniform(-0.2, 0.2),
            math.nan if sometimes(chance, 150) else 0.20,
            chance.choice((0.1, -0.3, math.nan)) if sometimes(chance, 3) else 0.1,
            not sometimes(chance, 1500),
            4.0 * slot,
            slot,
        )
        if sometimes(chance, 700):
            inp = inp._replace(**{chance.choice(inp._fields[1:4]): chance.choice(ODD)})
        yield law, inp, dt
    if mode == ANY_MODE:
        yield from driven_inputs(max(law_run.variants))


def driven_inputs(mode: int):
    """Yield an oscillation of 4 Hz, hardly faster than a hand, that the robot seems to drive."""
    position = 0.18
    for tick in range(3000):
        phase = 0.004 * tick
        moved = 0.18 + 0.01 * wave(phase)
        velocity, position = (moved - position) / 0.001, moved
        force = -5.0 * wave(phase + 0.25)  # against the velocity
        yield VERTICAL_LAW, VerticalInput(mode, moved, velocity, force, 0.18, 0.0, True), 0.001


@functools.cache
def vertical_run(name: str, mode: int) -> str:
    """Return the digest of all outputs of a run of a law, by its name."""
    run = SHIPPED[name]
    step = enveloped(run)
    state, shown = initial_state(VERTICAL_LAW, run, own_of(run, VERTICAL_LAW, MODEL)), []
    for law, inp, dt in vertical_inputs(mode, run):
        output = step(law, own_of(run, law, MODEL), state, inp, dt)
        shown += [
            output.force, output.impedance, output.gravity, output.friction,
            output.feedback + output.carried, output.saturated, output.desired_position,
            output.desired_velocity, output.share,
        ]  # fmt: skip
    return digest(shown)


def planar_inputs(force_gain: float):
    """Yield law, input and time step of a run in the plane."""
    chance = random.Random(f"plane {force_gain}")
    law = PlanarSettings(force_gain=force_gain)
    size, frequency = 0.1, 0.2
    shoulder = elbow = 0.0
    for tick in range(TICKS):
        if sometimes(chance, 300):
            size, frequency = chance.choice(((0.1, 0.3), (0.02, 4.0), (1e-4, 9.0), (0.24, 0.4)))
        if sometimes(chance, 500):
            law = law._replace(
                stiffness=chance.uniform(0.0, 2000.0), damping=chance.uniform(0.0, 100.0)
            )
        dt = chance.choice((0.0005, 0.001, 0.05)) if sometimes(chance, 100) else 0.002
        phase = frequency * tick * 0.002
        a, b = inverse(size * wave(phase), 0.8 * size * wave(phase + 0.3))
        speeds = (a - shoulder) / 0.002, (b - elbow) / 0.002
        shoulder, elbow = a, b
        slot = (0.0, 0.5, 1.0)[tick // 500 % 3] if tick // 1500 % 2 else 0.0
        inp = PlanarInput(
            shoulder,
            elbow,
            *(max(-5.0, min(5.0, speed)) for speed in speeds),
            math.nan if sometimes(chance, 100) else 0.05,
            -0.3 if sometimes(chance, 50) else -0.04,
            chance.choice((0.1, -0.6, math.nan)) if sometimes(chance, 3) else 0.0,
            0.05,
            not sometimes(chance, 1500),
            4.0 * slot,
            -2.0 * slot,
            slot,
            math.nan if sometimes(chance, 200) else 15.0 * wave(0.0031 * tick),
            (4.0, 40.0)[tick // 700 % 2] * wave((0.3, 0.03)[tick // 2000 % 2] * tick),
        )
        if sometimes(chance, 700):
            inp = inp._replace(**{chance.choice(inp._fields[:4]): chance.choice(ODD)})
        elif sometimes(chance, 500):
            inp = inp._replace(elbow=inp.shoulder + chance.choice((0.0, 0.01, math.pi)))
        yield law, inp, dt


def planar_run(force_gain: float) -> str:
    """Return the digest of all outputs of a run in the plane."""
    begun = PlanarSettings(force_gain=force_gain)
    state, shown = initial_plane(begun, PLANE_IMPEDANCE, begun), []
    for law, inp, dt in planar_inputs(force_gain):
        shown += planar_step(law, law, state, inp, dt)
    return digest(shown)


def slot_run() -> str:
    """Return the digest of slots of all kinds: renewed, replaced, reopened, without a length."""
    chance = random.Random("slot")
    limits, state, shown = SlotLimits(), initial_slot(), []
    slot, since = Slot(), -1.0
    for tick in range(TICKS):
        if sometimes(chance, 200):
            slot = Slot(
                *(chance.choice((-0.1, 0.0, 0.0005, 0.12)) for _ in range(4)),
                duration=chance.choice((0.1, 0.5, 1.4)),
                back_stiffness=chance.choice((0.0, 100.0, 790.0)),
                side_stiffness=chance.choice((50.0, 2000.0)), damping=chance.choice((5.0, 90.0)),
                growth=chance.choice((0.0, 20.0, 400.0)),
            )  # fmt: skip
        if sometimes(chance, 150):
            since = chance.choice((-1.0, 0.0, slot.duration, 3.0))
        since = since + 0.002 if since >= 0.0 else since
        if sometimes(chance, 400):
            limits = SlotLimits(force=chance.uniform(0.0, 65.0), stiffness=chance.uniform(0, 900))
        dt = chance.choice((0.0, -0.002, 0.02, 0.05)) if sometimes(chance, 100) else 0.002
        inp = SlotInput(
            0.15 * wave(tick * 0.0007), 0.03 * wave(tick * 0.0031), 0.3 * wave(tick * 0.002),
            0.2 * wave(tick * 0.003), not sometimes(chance, 30), slot, since,
        )  # fmt: skip
        if sometimes(chance, 300):
            inp = inp._replace(**{chance.choice(SlotInput._fields[:4]): chance.choice(ODD)})
        if sometimes(chance, 300):
            name = chance.choice(Slot._fields)
            inp = inp._replace(slot=slot._replace(**{name: chance.choice((*ODD, -0.5))}))
        output, state = slot_step(limits, state, inp, dt)
        shown += [*output, state.since, state.wall_weight, half_width_at(state.slot, state.since)]
    return digest(shown)


def chain_run() -> str:
    """Return the digest of the torque chain: limits, heat, map, wire and largest command."""
    chance, shown, heat, last = random.Random("chain"), [], COLD, 0.0
    chain = TorqueChain(linearization=default_linearization())
    for tick in range(TICKS):
        if sometimes(chance, 500):
            chain = TorqueChain(
                CommandLimits(chance.uniform(0.0, 150.0), chance.uniform(0.0, 150.0)),
                TorqueLimits(chance.uniform(0.05, 0.42), chance.uniform(0.05, 0.84), 0.7),
                linearization=chance.choice((IDENTITY, default_linearization(0.04, 0.03))),
            )
        force = 140.0 * wave(tick * 0.0043) if not sometimes(chance, 50) else 0.0
        dt = chance.choice((1e-6, 0.005, 0.1, 2.0)) if sometimes(chance, 50) else 0.001
        last = followed(chain, last, force, dt)
        made, heat = commanded(chain, heat, last, min(1.0, tick * 0.001), dt)
        wire = on_the_wire(chain, made.command)
        shown += [last, heat, *made, largest_command(chain), wire]
    return digest(shown)


def parts_run() -> str:
    """Return the digest of the set point, of the soft stops and of the speed's limit."""
    chance, shown, setpoint = random.Random("parts"), [], SetPoint(0.1)
    allowed = Range(0.0, 0.36, 0.4, 5.0)
    for tick in range(TICKS):
        asked = chance.choice((0.2 + 0.2 * wave(tick * 0.001), 0.3, math.nan, -1.0))
        promised = chance.choice((0.1, 0.1, 0.2, -0.4, 3.0, 0.0, math.nan))
        for _ in range(chance.choice((1, 1, 20, 100))):
            follow(allowed, setpoint, asked, promised, 0.001)
        shown += [setpoint.position, setpoint.velocity, setpoint.owed]
        force, place = 50.0 * wave(tick * 0.0117), 0.2 * (1.0 + wave(tick * 0.0013))
        shown.append(soft_stop(force, place, 0.01, 0.36, 0.02, 2000.0))
        shown.append(limit_speed(force, wave(tick * 0.0171), 0.6, 0.2, 50.0))
        shown += [way(place * 4.0 - 0.3), pace(place * 4.0 - 0.3)]
    return digest(shown)


def excitation_run() -> str:
    """Return the digest of sines, interrupted and ended, at the edges of what is accepted."""
    chance, shown, memory = random.Random("excitation"), [], Excited()
    wanted, sequence = Excitation(), 2**32 - 500
    for tick in range(TICKS):
        if sometimes(chance, 40):
            wanted = Excitation(
                chance.choice((wanted.id, tick)),
                chance.choice((0.0, 0.2, 0.42, 0.4201, -0.1, math.nan)),
                chance.choice((0.0, 10.0, 499.9, 500.0, -1.0)), chance.choice((0, 10, 90)),
                chance.choice((None, IDENTITY, default_linearization(0.04, 0.03))),
            )  # fmt: skip
        sequence += chance.choice((1, 1, 1, 1, 2, 5))
        moved = chance.choice((0.0, 0.0, 0.001, -0.001, 0.0011, -0.0011, math.nan))
        place = memory.height + moved if sometimes(chance, 9) else memory.height
        force, wrong = excitation_step(
            wanted, memory, sequence & 0xFFFFFFFF, place, 1000.0, not sometimes(chance, 60)
        )
        refused = wanted.refusal(1000.0)
        shown += [force, bool(wrong), bool(refused), 0.0 if refused else wanted.peak]
        shown += [memory.id, -1 if memory.first is None else memory.first]
        if wanted.linearization:
            numbers = as_numbers(wanted.linearization)
            assert from_numbers(numbers) == wanted.linearization
            shown += numbers
    return digest(shown)


PARTS = {
    excitation_run: "3bad2a67e38c69f2",
    slot_run: "bc2a79b1da27e586",
    chain_run: "332d5bf342944c58",
    parts_run: "ee51c28755d1ada5",
}


@same_library
@pytest.mark.parametrize("run", PARTS, ids=lambda run: run.__name__)
def test_parts_of_the_laws(run):
    assert run() == PARTS[run]


def key_of(mode: int) -> str:
    """Return the key of a run."""
    return ANY if mode == ANY_MODE else str(mode)


def renewed(name: str, before: Known | None) -> Known:
    """Return what is known of a law now; one with the same runs keeps its version."""
    runs = {key_of(mode): vertical_run(name, mode) for other, mode in RUNS if other == name}
    same = before is not None and before.runs == runs
    return Known(runs, source_of(SHIPPED[name]), before.formerly if before and same else ())


@same_library
def test_the_sources_of_the_laws_are_those_whose_runs_are_known(request):
    """A law that was only rewritten keeps its version: with --write its source is noted here."""
    before = known_laws()
    found = {name: renewed(name, before.get(name)) for name in SHIPPED}
    if request.config.getoption("--write"):
        text = yaml.safe_dump({"laws": plain(found)}, sort_keys=False)
        FILE.write_text(HEAD + text, encoding="utf-8")
        known_laws.cache_clear()
        law_version.cache_clear()
    assert {name: known.source for name, known in known_laws().items()} == {
        name: known.source for name, known in found.items()
    }, "the law's source is another: if the runs are equal, renew this with --write"


@same_library
@pytest.mark.parametrize(("name", "mode"), RUNS)
def test_vertical_law(name, mode):
    assert vertical_run(name, mode) == known_laws()[name].runs[key_of(mode)]


def test_a_source_alone_changes_no_version_and_other_bits_do():
    """What is renewed keeps the version of equal runs, and no former one of others."""
    known = known_laws()["thesis"]
    again = renewed("thesis", known._replace(source="0123456789ab"))
    assert (again.behaviour, again.formerly) == (known.behaviour, known.formerly)
    other = renewed("thesis", known._replace(runs=known.runs | {"3": "0123456789abcdef"}))
    assert other.behaviour == known.behaviour and other.formerly == ()
    assert known._replace(runs=known.runs | {"3": "0123456789abcdef"}).behaviour != known.behaviour


@pytest.fixture
def other_source(monkeypatch):
    """Have the runs be those of another source than the law's."""
    patched = known_laws()["thesis"]._replace(source="0123456789ab")
    monkeypatch.setattr(version, "known_laws", lambda: {"thesis": patched})
    law_version.cache_clear()
    yield patched
    law_version.cache_clear()


def test_a_law_with_the_source_of_its_runs_is_known_by_the_runs():
    assert law_version(THESIS) == known_laws()["thesis"].behaviour != source_of(THESIS)


def test_a_law_that_was_changed_and_not_run_is_known_by_its_source(other_source):
    """A patched robot is told from the one whose limits were found."""
    assert law_version(THESIS) == source_of(THESIS)
    for former in {other_source.behaviour, *other_source.formerly} - {source_of(THESIS)}:
        assert not version.fits(former, THESIS)


@same_library
@pytest.mark.parametrize("force_gain", PLANE)
def test_planar_law(force_gain):
    assert planar_run(force_gain) == PLANE[force_gain]


def vertical_twin(p, own, packed_state, inp, dt):
    return vertical_step(p, own, packed_state[0], inp, dt)


def planar_twin(p, packed_state, inp, dt):
    return planar_step(p, p, packed_state[0], inp, dt)


@pytest.mark.long
def test_compiled_vertical_law():
    plain = initial_state(VERTICAL_LAW, THESIS, Own(VERTICAL_LAW, MODEL))
    twin, fast = packed(plain), compiled(vertical_twin)
    for law, inp, dt in vertical_inputs(ANY_MODE):
        expected = vertical_step(law, Own(law, MODEL), plain, inp, dt)
        assert fast(law, Own(law, MODEL), twin, inp, dt) == pytest.approx(
            expected, abs=1e-9, nan_ok=True
        )


@pytest.mark.long
def test_compiled_planar_law():
    begun = PlanarSettings()
    plain, limited_apart = initial_plane(begun, PLANE_IMPEDANCE, begun), 0
    twin, fast = packed(plain), compiled(planar_twin)
    for law, inp, dt in planar_inputs(9.0):
        expected, found = planar_step(law, law, plain, inp, dt), fast(law, twin, inp, dt)
        limited_apart += found.saturated != expected.saturated
        same_limit = found._replace(saturated=expected.saturated)
        assert same_limit == pytest.approx(expected, abs=1e-9, nan_ok=True)
    assert limited_apart <= 1, "at the very limit rounding decides whether it counts as limited"
