# SPDX-License-Identifier: Apache-2.0
"""Configures a CiA 402 drive for torque and sets the guards with which it stops on its own.

The drive is the last guard. It must drop the torque when our heartbeat (1016) or our commands
(1400:05) stop, with the configured reaction (6007, 605A, 605E). It must never give more torque than
our largest command (6072), even if another master writes a target. The driver reads each of these
objects back. It returns the guards that a drive refuses; such a drive is not enabled.
"""

from __future__ import annotations

import contextlib
from typing import NamedTuple

from . import pdo
from .drive_settings import (
    COAST,
    DriveSettings,
    command_pdo,
    milliseconds,
    own_limit,
    slow_status_pdo,
    status_pdo,
)
from .errors import NotConfigured, Refused, WrongDevice
from .node import CanopenNode

PROFILE = 402

CYCLIC_TORQUE_MODE, PROFILE_TORQUE_MODE = 10, 4
#: Mode of operation and its bit in object 6502, best mode first.
_TORQUE_MODES = ((9, CYCLIC_TORQUE_MODE), (3, PROFILE_TORQUE_MODE))
#: Time that a drive may need to show a mode that was set.
_MODE_WITHIN_S = 0.25

_MILLI, _MICRO = 1e-3, 1e-6
#: Largest relative difference between object 6076 and the parameter for the same motor.
_RATING_TOLERANCE = 0.01

_FAULT_ON_LOST_CONNECTION = 1
_DISABLE_AND_COAST = 0
_RAMP_DOWN = 1
_QUICK_STOP_RAMP = 2
_STEEPEST_SLOPE = 0x7FFFFFFF


# The guards, as messages name them.
DRIVE_HEARTBEAT = "its own heartbeat 1017"
MASTER_HEARTBEAT = "watching our heartbeat 1016"
COMMAND_DEADLINE = "command deadline 1400:05"
LOST_CONNECTION = "fault on lost connection 6007"
QUICK_STOP_REACTION = "quick stop reaction 605A"
FAULT_REACTION = "fault reaction 605E"
TORQUE_LIMIT = "torque limit 6072"


class MissingGuard(NamedTuple):
    """A guard that the drive refused. guard: one of the constants above; why: its answer."""

    guard: str
    why: str

    def __str__(self) -> str:
        return f"{self.guard} ({self.why})"


class DriveSetup(NamedTuple):
    """Result of the configuration.

    mode: object 6060 in use. rated_torque: torque of 1000 per mille [Nm]. unguarded: guards that
    the drive refused, empty without any. warnings: harmless refusals. inputs: it has digital ones.
    """

    mode: int
    rated_torque: float
    unguarded: tuple[MissingGuard, ...] = ()
    warnings: tuple[str, ...] = ()
    inputs: bool = True


def configure(node: CanopenNode, settings: DriveSettings) -> DriveSetup:
    """Configure the drive as the settings describe, without NMT start.

    Raises NotAnswering, WrongDevice, Refused, NotConfigured.
    """
    sdo = node.sdo
    node.pre_operational()
    node.identify(PROFILE, settings.vendor_id, settings.product_code)
    _switch_off(node)
    rated = rated_torque(sdo.unsigned(0x6076), settings.rated_torque, node.label)
    mode, warnings = _select_mode(node)
    if mode == CYCLIC_TORQUE_MODE:
        _clear_offset(node)
    command = command_pdo(settings)
    reported = (status_pdo(settings), slow_status_pdo(settings))
    pdo.disable_unused(sdo, (command, *reported))
    pdo.configure(sdo, reported[0])
    inputs = True
    try:
        pdo.configure(sdo, reported[1])
    except (Refused, NotConfigured):  # 60FD is optional
        inputs = False
        pdo.configure(sdo, slow_status_pdo(settings, inputs))
    no_deadline = pdo.configure(sdo, command, timer_optional=True)
    unguarded = [MissingGuard(COMMAND_DEADLINE, no_deadline)] if no_deadline else []
    unguarded += _guards(node, settings, rated)
    warnings += _stop_ramps(node, settings)
    node.end_configuration()
    return DriveSetup(mode, rated, tuple(unguarded), tuple(warnings), inputs)


def _switch_off(node: CanopenNode) -> None:
    """Set zero torque, then voltage off: an earlier program may have left the drive enabled."""
    for index in (0x6071, 0x6040):
        try:
            node.sdo.write(index, 0, 0, 2)
        except Refused:
            continue  # the drive accepts these by PDO only; the first command sends the same


def rated_torque(raw: int, expected: float, label: str) -> float:
    """Return object 6076 in Nm: mNm in the standard, micro-Nm on some drives.

    raw: value of the object. expected: the parameter [Nm]. Raises WrongDevice if neither fits.
    """
    for unit in (_MILLI, _MICRO):
        if abs(raw * unit - expected) <= _RATING_TOLERANCE * expected:
            return raw * unit
    raise WrongDevice(
        f"{label} says a rated torque (6076) of {raw}, which is {raw * _MILLI:g} Nm if in mNm; the "
        f"parameter rated_torque is {expected:g} Nm: correct whichever is wrong, or every torque "
        "will be"
    )


def _select_mode(node: CanopenNode) -> tuple[int, list[str]]:
    sdo = node.sdo
    supported = sdo.unsigned(0x6502)
    mode = next((mode for bit, mode in _TORQUE_MODES if supported >> bit & 1), 0)
    if not mode:
        raise WrongDevice(
            f"{node.label} has neither cyclic synchronous torque nor profile torque mode "
            f"(6502 = 0x{supported:X})"
        )
    sdo.write(0x6060, 0, mode, 1)
    if not node.port.wait_for(lambda: sdo.signed(0x6061) == mode, _MODE_WITHIN_S):
        shown = sdo.signed(0x6061)
        raise NotConfigured(f"{node.label}: mode {mode} was asked for (6060), 6061 shows {shown}")
    if mode == CYCLIC_TORQUE_MODE:
        return mode, []
    # Profile torque ramps towards its target; with the steepest ramp it acts like cyclic torque.
    return mode, _optional(node, 0x6087, _STEEPEST_SLOPE, 4, "torque slope")


def _clear_offset(node: CanopenNode) -> None:
    """Clear the torque offset, which cyclic torque mode adds to each target: a target of zero from
    us would be no zero torque if an earlier program has left one. Drives need not have it.
    """
    try:
        node.sdo.set(0x60B2, 0, 0, 2)
    except Refused:
        with contextlib.suppress(Refused):
            if offset := node.sdo.signed(0x60B2):
                raise NotConfigured(
                    f"{node.label} adds {offset} per mille to each torque (object 60B2) and does "
                    "not let it be cleared"
                ) from None


def _guards(node: CanopenNode, settings: DriveSettings, rated: float) -> list[MissingGuard]:
    """Set the guards; return those that the drive refused. rated: torque [Nm]."""
    consumer = settings.master_id << 16 | milliseconds(settings.heartbeat_timeout)
    stop = _DISABLE_AND_COAST if settings.stop_reaction == COAST else _QUICK_STOP_RAMP
    guards = (
        (0x1017, 0, milliseconds(settings.drive_heartbeat), 2, DRIVE_HEARTBEAT),
        (0x1016, 1, consumer, 4, MASTER_HEARTBEAT),
        (0x6007, 0, _FAULT_ON_LOST_CONNECTION, 2, LOST_CONNECTION),
        (0x605A, 0, stop, 2, QUICK_STOP_REACTION),
        (0x605E, 0, stop, 2, FAULT_REACTION),
        (0x6072, 0, own_limit(settings.max_torque, rated), 2, TORQUE_LIMIT),
    )
    refused = []
    for index, subindex, value, size, guard in guards:
        try:
            node.sdo.set(index, subindex, value, size)
        except (Refused, NotConfigured) as error:
            refused.append(MissingGuard(guard, str(error)))
    return refused


def _stop_ramps(node: CanopenNode, settings: DriveSettings) -> list[str]:
    """Set the same reaction for normal disabling (605B, 605C); both objects are optional."""
    option = _DISABLE_AND_COAST if settings.stop_reaction == COAST else _RAMP_DOWN
    return [
        *_optional(node, 0x605B, option, 2, "shutdown reaction"),
        *_optional(node, 0x605C, option, 2, "disable reaction"),
    ]


def _optional(node: CanopenNode, index: int, value: int, size: int, what: str) -> list[str]:
    try:
        node.sdo.set(index, 0, value, size)
    except Refused as error:
        return [] if error.absent else [f"{what} not set: {error}"]
    except NotConfigured as error:
        return [f"{what} not set: {error}"]
    return []


def disarm(node: CanopenNode) -> None:
    """Switch the guards off for a clean exit: first the command deadline, then the heartbeat.

    Raises NotAnswering, Refused, NotConfigured.
    """
    try:
        node.sdo.set(0x1400, 5, 0, 2)
    except Refused as error:
        if not error.absent:
            raise
    try:
        node.sdo.set(0x1016, 1, 0, 4)
    except Refused as error:
        if not error.absent:
            raise
