# SPDX-License-Identifier: Apache-2.0
"""Whether the module to be moved is the simulated one, found out on its bus.

If it is, no operator has to confirm that hands are away and the stage is mounted. A node that calls
itself `sim_rig` proves nothing: anybody can start one beside a real robot.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from screw_module_ros.can_io.bus import SIMULATED_INTERFACES, BusSettings, open_bus
from screw_module_ros.clock import WallClock
from screw_module_ros.devices.errors import BusError
from screw_module_ros.operator.client import RobotError
from screw_module_ros.operator.robot import Robot
from screw_module_ros.settings import Setting

from .graph import parameters

_TPDO1 = 0x180  # CiA 301: its COB-ID is this and the node id
_LOOK_NS = 500_000_000
_ENOUGH = 20
_RECEIVE_S = 0.05


class RigBusSettings(NamedTuple):
    """Which device on the bus `can` shows that the rig is simulated."""

    encoder_node_id: Annotated[int, Setting("CANopen node id of the encoder", "", 1, 127)] = 2


def sees_rig(robot: Robot, bus: BusSettings, device: RigBusSettings) -> bool:
    """Return whether the simulated encoder is seen to answer.

    In simulated time: the process that moves it, on this machine, has answered on a bus, and a
    driver on real hardware refuses simulated time. By wall clock: positions come on `bus`, which
    must be the one that `encoder` works on and one that no hardware is on and no other machine
    reaches.
    """
    if robot.clock.simulated:
        page = robot.clock.page
        return any(
            pid == page.conductor and sent > 0
            for pid, sent in zip(page.line_pid, page.line_sent, strict=True)
            if pid
        )
    if bus.interface not in SIMULATED_INTERFACES:
        return False
    wanted = {
        "can.interface": bus.interface,
        "can.channel": bus.channel,
        "can.port": bus.port,
        "node_id": device.encoder_node_id,
    }
    try:
        answer = parameters(robot, "encoder", wanted)
    except RobotError:  # the experiment says what is missing
        return False
    return answer == wanted and _hears(bus, _TPDO1 + device.encoder_node_id)


def _hears(settings: BusSettings, identifier: int) -> bool:
    """Listen whether frames of an identifier come again and again."""
    try:
        bus = open_bus(settings._replace(sync_producer=False))
    except BusError:
        return False
    clock, count = WallClock(), 0
    end_ns = clock.now_ns() + _LOOK_NS
    try:
        while count < _ENOUGH and clock.now_ns() < end_ns:
            frame = bus.recv(_RECEIVE_S)
            count += frame is not None and frame.arbitration_id == identifier
    finally:
        bus.shutdown()
    return count >= _ENOUGH
