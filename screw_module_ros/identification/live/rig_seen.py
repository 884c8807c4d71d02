# SPDX-License-Identifier: Apache-2.0
"""Detects on the bus whether the module is the simulated one.

If it is, no operator must confirm that hands are away and the stage is mounted. A node with the
name `sim_rig` proves nothing: it can also run beside a real robot.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from screw_module_ros.can_io.bus import SIMULATED_INTERFACES, BusSettings, open_bus, within
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
    """Return whether the simulated encoder answers.

    In simulated time: the rig's process on this machine has answered on a bus; a driver on real
    hardware refuses simulated time. By wall clock: positions arrive on `bus`, which must be the bus
    of the node `encoder`, and a simulated one: no hardware and no other machine has that.
    """
    if robot.clock.simulated:
        page = robot.clock.page
        return any(pid == page.conductor and sent > 0 for pid, sent in page.buses())
    if bus.interface not in SIMULATED_INTERFACES:
        return False
    wanted = {
        "can.interface": bus.interface,
        "can.channel": bus.channel,
        "node_id": device.encoder_node_id,
    }
    try:
        answer = parameters(robot, "encoder", wanted)
    except RobotError:  # the experiment says what is missing
        return False
    return answer == wanted and _hears(
        within(bus, robot.node.get_namespace()), _TPDO1 + device.encoder_node_id
    )


def _hears(settings: BusSettings, identifier: int) -> bool:
    """Return whether frames of an identifier arrive repeatedly."""
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
