# SPDX-License-Identifier: Apache-2.0
"""What `conversations.txt` cannot say: boot-up, broken frames, makes with objects of their own."""

import can
import pytest

from screw_module_ros.resources import resource_path
from screw_module_ros.rig.build import RigSettings


def test_boot_up_comes_once_and_before_anything_else(make_bench):
    bench = make_bench("encoder", booted=False)
    bench.now_ns = 0  # where simulated time begins
    assert bench.run(0) == [(0x702, "00")]
    assert bench.run(5) == []


def test_a_broken_sdo_request_is_survived(encoder):
    node = encoder.rig.devices["encoder"].node
    assert encoder.ask(0x602, "40 00 10") == []
    assert encoder.ask(0x602, "00 00 00 00 00 00 00 00") == []  # a segment of nothing
    assert node.malformed == 2
    assert encoder.read(2, "1000:00") == "96010200"


def test_frames_of_other_kinds_are_ignored(encoder):
    remote = can.Message(arbitration_id=0x182, is_remote_frame=True, is_extended_id=False)
    extended = can.Message(arbitration_id=0x602, data=bytes(8), is_extended_id=True)
    for frame in (remote, extended):
        encoder.bus.send(frame)
    assert encoder.run(0) == []
    assert encoder.rig.counters["ignored"] == 2


@pytest.fixture
def make_of(make_bench, tmp_path):
    """Return a maker of drives that differ from the standard in these objects (YAML)."""
    def make(objects: str):
        file = tmp_path / "make.yaml"
        standard = resource_path("params/devices/generic_402.yaml").read_text()
        file.write_text(f"{standard}objects: {{{objects}}}")
        return make_bench("drive", settings=RigSettings(drive_profile=str(file)))

    return make


def test_a_make_may_have_objects_of_its_own(make_of):
    drive = make_of(
        '"2000": {size: 1, value: 7}, "2001": {size: 2, value: 0x1234, read_only: true}, '
        '"2002:01": {size: 4, value: 5, per_node: true}, "2003": {size: 2}, "6087": {absent: true}'
    )
    assert [drive.read(1, key) for key in ("2000:00", "2001:00", "2002:01")] == [
        "07", "3412", "06000000"
    ]  # fmt: skip
    assert drive.write(1, "2001:00", "0000") == "06010002"
    assert drive.read(1, "2003:00") == "060a0023"  # nothing was ever stored there
    assert drive.read(1, "6087:00") == "06020000"


def test_a_make_may_have_its_deadline_from_power_on(make_of):
    drive = make_of('"1400:05": {value: 20}')
    drive.silence(1)
    drive.start(1)
    assert drive.run(100) == []  # a frame arms it
    assert drive.ask(0x201, "06 00") == []
    assert drive.run(19) == []
    assert drive.run(1) == [(0x081, "50 82 11 00 00 00 00 00")]
    drive.send(0x201, "06 00")
    drive.ask(0x000, "81 01")
    assert drive.run(30) == [(0x701, "00")]  # and a reset disarms it
    drive.silence(1)
    drive.start(1)
    assert drive.run(100) == []
