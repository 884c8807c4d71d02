# SPDX-License-Identifier: Apache-2.0
"""A scripted run of the whole robot, judged bit for bit by digests of its samples.

Drivers, loops, laws and rig run as in the nodes. A rewrite that changes the last bit of one sample,
the tick of one reaction or one reason shows here, with the first phase that differs. Who changes a
law or a limit on purpose prints the new digests (`python test/loop/test_scripted_run.py`) and says
in the commit what changed.
"""

from __future__ import annotations

import hashlib
import math
import struct

import pytest
from bench import Bench

from screw_module_ros.plant.world import ArmSettings

pytestmark = pytest.mark.long

_STROKE = ArmSettings(kind="active", amplitude=(0.05, 0.04, 0.08), omega=(3.0, 2.0, 4.0))
DIGESTS = {
    "0 ready": "5012ec17e2394f4c",
    "1 enabled": "99876de54d95e56a",
    "2 mode 1": "2812bed009af74e2",
    "3 mode 2": "5100644cfb53b875",
    "4 mode 3": "88d892c0eca21ed7",
    "5 mode 4": "9d724ad7200940bb",
    "6 mode 5": "a2a1e1479b72d919",
    "7 mode 0": "050728716c9e5328",
    "8 mode 3": "3e1df72962e8a5ba",
    "9 encoder frozen": "16ed21e449196b94",
    "10 recovered": "428e18cd12564dce",
    "11 not permitted": "8b465812e5a95c1a",
}


def scripted_run():
    """Yield the name and the digest of each phase."""
    bench = Bench(seed=3)
    try:
        for number, (name, phase) in enumerate(_phases(bench)):
            begin = len(bench.rows)
            phase()
            yield f"{number} {name}", _digest(bench, begin)
    finally:
        bench.close()


def _phases(bench: Bench):
    yield "ready", bench.ready
    yield "enabled", lambda: _enabled(bench)
    bench.world.set_arm(_STROKE)
    bench.setpoint = (0.22, 0.05)
    bench.planar_setpoint = (0.06, -0.05, 0.02, 0.0)
    for mode in (1, 2, 3, 4, 5, 0, 3):
        yield f"mode {mode}", lambda mode=mode: _moved(bench, mode)
    bench.rig.inject("encoder", "freeze", 0.0, 0.0, bench.now_ns)
    yield "encoder frozen", lambda: bench.seconds(0.3)
    bench.rig.inject("encoder", "clear", 0.0, 0.0, bench.now_ns)
    yield "recovered", lambda: _recovered(bench)
    bench.permitted = False
    yield "not permitted", lambda: bench.seconds(0.2)


def _enabled(bench: Bench) -> None:
    bench.controller.mode = 1
    bench.planar_setpoint = (0.0, 0.0, 0.0, 0.0)
    begin = len(bench.rows)
    assert bench.enable() == ""
    _until(bench, begin + 200)
    assert bench.enable_plane() == ""
    _until(bench, begin + 600)


def _moved(bench: Bench, mode: int) -> None:
    bench.controller.mode = mode
    bench.seconds(0.5)


def _recovered(bench: Bench) -> None:
    begin = len(bench.rows)
    bench.encoder.clear_fault()
    assert bench.clear_fault() == ""
    bench.controller.reset(bench.now_ns)
    _until(bench, begin + 400)


def _until(bench: Bench, ticks: int) -> None:
    """Go on until this many ticks in all, however soon a service has answered."""
    assert len(bench.rows) <= ticks
    bench.ticks(ticks - len(bench.rows))


def _digest(bench: Bench, begin: int) -> str:
    digest = hashlib.sha256()
    for row in bench.rows[begin:]:
        numbers = (0.0 if math.isnan(each) else each for each in row[:-1])
        digest.update(struct.pack("<6d", *numbers) + row.reason.encode())
    digest.update(struct.pack("<2d", *bench.plane.written))
    return digest.hexdigest()[:16]


def test_every_phase_is_the_same_bit_for_bit():
    assert dict(scripted_run()) == DIGESTS


if __name__ == "__main__":
    for phase, value in scripted_run():
        print(f'    "{phase}": "{value}",')
