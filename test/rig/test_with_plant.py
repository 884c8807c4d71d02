# SPDX-License-Identifier: Apache-2.0
"""The rig with the plant behind it: frames say what the world does, and it does what they say."""

import pytest

from screw_module_ros.plant.world import World, load_world

RANGE = 20_000 * 4096


@pytest.fixture
def world() -> World:
    return World(load_world(None), seed=1, compile=False)


def signed(payload: str, first: int, last: int) -> int:
    return int.from_bytes(bytes.fromhex(payload)[first:last], "little", signed=True)


def test_torque_moves_the_screw_and_both_counts_follow(make_bench, world):
    bench = make_bench("encoder", "drive", "force_sensor")
    for node in (1, 2):
        bench.silence(node)
    bench.map_pdo(2, 0, ["20000460"], "01", "82010000")
    bench.map_pdo(1, 0, ["20006460", "10007760"], "01", "81010000")
    bench.write(1, "6060:00", "0A")
    for node in (1, 2):
        bench.start(node)
    before = world.encoder_count
    for controlword in ("0600", "0700", "0F00"):
        bench.write(1, "6040:00", controlword)
    bench.write(1, "6071:00", "E803")  # the rated torque
    bench.run(40)
    frames = dict(bench.ask(0x080))
    count = world.encoder_count
    assert count > before + 100  # up is positive
    assert int.from_bytes(bytes.fromhex(frames[0x182]), "little") == count % RANGE
    assert signed(frames[0x181], 0, 4) == count
    assert signed(frames[0x181], 4, 6) == pytest.approx(1000, rel=0.1)
    status = bytes.fromhex(dict(bench.ask(0x120))[0x120])[:2]
    assert status == b"\0\0"


def test_planar_torques_reach_their_joints(make_bench, world):
    bench = make_bench("planar")
    for node, target in ((3, "6400"), (4, "9CFF")):
        bench.write(node, "6060:00", "0A")
        for controlword in ("0600", "0700", "0F00"):
            bench.write(node, "6040:00", controlword)
        bench.write(node, "6071:00", target)
    bench.run(4)
    assert world.planar_torque == pytest.approx((1.0, -1.0), rel=0.05)
    position = int.from_bytes(bytes.fromhex(bench.read(3, "6064:00")), "little", signed=True)
    assert position == world.planar_counts[0]
