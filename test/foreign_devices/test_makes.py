# SPDX-License-Identifier: Apache-2.0
"""Each profile of `params/devices` against its make as public files and manuals have it.

The rig and the drivers read one profile, so a number that was misread is wrong on both and looks
right. Here the objects are from the sources (`makes.py`).
"""

from __future__ import annotations

import pytest
from canopen.objectdictionary import ODVariable
from far_end import DURAND, LOCAL_NODE
from makes import MAKES, dictionary

from screw_module_ros import profiles
from screw_module_ros.trials.one_thread import OneThreadRobot

pytestmark = pytest.mark.timeout(180)

KINDS = {name: profiles.load(name).kind for name in profiles.NAMES}
DRIVES = [name for name, kind in KINDS.items() if kind == profiles.DRIVE]
ENCODERS = [name for name, kind in KINDS.items() if kind == profiles.ENCODER]
NODE = 5
# What the operator has to say of a make: what does in place of a guard, how it is commanded.
SAID = {
    "ingenia": {
        "waived": "command_deadline, lost_connection, quick_stop_reaction, fault_reaction",
        "allow_no_heartbeat": True,
    },
    # Commanded by a current: that at the rated torque, in the drive's own unit.
    "epos2": {"rated_command": 2625.0},
    "ipos": {"rated_command": 4300.0},
    "kinco": {"rated_command": 167.0},
    "baumer_linear": {"counts_per_turn": 19_050},  # steps of 1 um
}
# What the drivers write or read beside the process data.
NEEDED = (0x1016, 0x1017, 0x6007, 0x603F, 0x605A, 0x605C, 0x605E, 0x6060, 0x6061, 0x6072, 0x6076,
          0x6087, 0x60B2, 0x6502)  # fmt: skip
NEEDED_ENTRIES = ((0x1400, 5), (0x1801, 5))
RATED = 0.42
# Profile, what is misread in it, and what the drive then lacks.
MISREAD = [
    ("epos4", "3001:02", "3001:03", "torque_limit"),
    ("epos4", "3001:01", "3001:04", "torque_limit"),
    ("elmo_gold", "2F75", "2F57", "command_deadline"),
    ("elmo_gold", "1006", "1060", "command_deadline"),
]


def test_each_make_of_a_canopen_device_is_here():
    assert {*DRIVES, *ENCODERS} <= set(MAKES)


def named(profile, index: int, subindex: int | None) -> bool:
    """Return whether a profile says that an object, or an entry of one, is absent."""
    for key in (f"{index:04X}", f"{index:04X}:{subindex or 0:02X}"):
        trait = profile.objects.get(key)
        if trait is not None and trait.absent:
            return True
    return False


@pytest.mark.parametrize("name", DRIVES)
def test_what_the_drivers_need_and_a_make_lacks_its_profile_says(name):
    profile = profiles.load(name)
    needed = [key for key in MAKES[name].absent if key[0] in NEEDED or key in NEEDED_ENTRIES]
    assert [key for key in needed if not named(profile, *key)] == []


def entry(objects, key: str) -> ODVariable | None:
    """Return an object or an entry of one; None for what is not there."""
    index, subindex = profiles.key_of(key)
    found = objects.indices.get(index)
    if found is None or isinstance(found, ODVariable):
        return found
    return found.subindices.get(subindex)


@pytest.mark.parametrize("name", [*DRIVES, *ENCODERS])
def test_what_its_profile_says_of_its_objects_is_what_the_sources_say(name):
    objects = dictionary(name, NODE)
    for key, trait in profiles.load(name).objects.items():
        found = entry(objects, key)
        assert (found is None) == trait.absent, key
        if found is not None:
            assert not trait.read_only or found.access_type in ("ro", "const"), key
            assert trait.mappable == (found.index not in MAKES[name].unmappable), key
            if trait.value is not None:
                assert found.default == trait.value + (NODE if trait.per_node else 0), key
            if trait.size:
                assert len(found) == 8 * trait.size, key


@pytest.mark.parametrize("name", [*DRIVES, *ENCODERS])
def test_the_driver_recognizes_it(near, device, name):
    device(LOCAL_NODE, name)
    maker = near.drive if name in DRIVES else near.encoder
    driver = maker(name, **SAID.get(name, {}))
    driver.configure()
    rows = driver.likely_makes(len(profiles.NAMES)).splitlines()[1:]
    (own,) = [row for row in rows if row.split()[0] == name]
    assert own.split()[1:] == ["fits"]


@pytest.mark.parametrize("name", DRIVES)
def test_a_drive_gives_torque_when_enabled_and_none_when_not(near, device, name):
    far = device(LOCAL_NODE, name)
    drive = near.drive(name, max_torque=2.0 * RATED, **SAID.get(name, {}))
    near.enabled(drive)
    near.run(drive, lambda: drive.reading.torque == pytest.approx(0.1, abs=1e-3), "gives torque",
             torque=0.1)  # fmt: skip
    drive.request_disable()
    near.run(drive, lambda: far.application.state != "operation enabled", "is off", torque=0.1)
    near.run(drive, lambda: drive.reading.torque == 0.0, "gives none", torque=0.1)
    assert drive.fault == ""


@pytest.mark.parametrize(
    ("name", "objects"),
    [
        # 200 % of the nominal current of 5 A; 10 ms and 5 s of the commands' period.
        ("epos4", {(0x3001, 2): 10_000}),
        ("elmo_gold", {(0x1006, 0): 10_000, (0x2F75, 0): 500}),
    ],
)
def test_what_stands_in_for_a_guard_is_written_where_the_maker_has_it(near, device, name, objects):
    far = device(LOCAL_NODE, name)
    drive = near.drive(name, max_torque=2.0 * RATED)
    drive.configure()
    assert drive.unguarded == ()
    assert {key: far.get(*key) for key in objects} == objects


@pytest.mark.parametrize("name", DRIVES)
def test_only_the_command_that_is_guarded_is_taken(near, device, name):
    """Three more RPDOs are there: each is off, or has no entries left."""
    far = device(LOCAL_NODE, name)
    near.drive(name, **SAID.get(name, {})).configure()
    for number in range(1, 4):
        off = far.get(0x1400 + number, 1) >> 31
        assert off or far.get(0x1600 + number, 0) == 0


@pytest.mark.parametrize("name", ENCODERS)
@pytest.mark.parametrize("stack", [LOCAL_NODE, DURAND])
def test_an_encoder_gives_its_positions(near, device, stack, name):
    far = device(stack, name)
    encoder = near.encoder(name, **SAID.get(name, {}))
    encoder.configure()
    encoder.start()
    far.do(lambda: setattr(far.application, "speed", 7))
    assert [near.sample(encoder).count for _ in range(10)] == [7 * n for n in range(1, 11)]


@pytest.mark.long
@pytest.mark.parametrize(("name", "right", "wrong", "lacking"), MISREAD)
def test_a_misread_number_passes_on_the_rig_and_not_here(
    near, device, tmp_path, name, right, wrong, lacking
):
    text = (profiles.resource_path(f"params/devices/{name}.yaml")).read_text(encoding="utf-8")
    file = tmp_path / f"{name}.yaml"
    file.write_text(text.replace(f'"{right}"', f'"{wrong}"'), encoding="utf-8")
    bench = OneThreadRobot(1, None, str(file))
    try:
        bench.ready()
        assert bench.drive.unguarded == ()
        assert bench.enable() == ""
    finally:
        bench.close()
    device(LOCAL_NODE, name)
    drive = near.drive(str(file), max_torque=2.0 * RATED)
    drive.configure()
    assert [each.guard for each in drive.unguarded] == [lacking]
    assert wrong.partition(":")[0] in drive.guards_refusal()
