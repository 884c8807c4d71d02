# SPDX-License-Identifier: Apache-2.0
"""Simulated torque drive (CiA 402): state machine, cyclic synchronous torque, profile torque.

Target 6071 and actual 6077 are per mille of 6076 [mNm]; 6078 is per mille of 6075 [mA]. In some
makes both are other objects in a unit of their own, in a torque mode of their own. The drive is the
robot's last guard: when the master's heartbeat or the RPDO's deadline is missed, it reacts as
object 6007 requires.
"""

from __future__ import annotations

from collections.abc import Callable
from ctypes import c_int32
from functools import partial
from typing import NamedTuple

from screw_module_ros.profiles import ALWAYS, ANY_DRIVE, READY, Profile, key_of
from screw_module_ros.rig import cia402
from screw_module_ros.rig.canopen_device import INITIALISING, OPERATIONAL, STOPPED, CanopenDevice
from screw_module_ros.rig.faults import DRIVE
from screw_module_ros.rig.link import Link
from screw_module_ros.rig.object_dictionary import INVALID_VALUE, READ_ONLY, require
from screw_module_ros.rig.physics import Axis, Physics

PROFILE_TORQUE, CYCLIC_SYNCHRONOUS_TORQUE = 4, 10
TORQUE_MODES = (PROFILE_TORQUE, CYCLIC_SYNCHRONOUS_TORQUE)
NMT_LOST = 0x8100
UNDERVOLTAGE = 0x3220

_ABORT_FAULT, _ABORT_DISABLE, _ABORT_QUICK_STOP = 1, 2, 3
_HALT = 0x0100
_STEEPEST = 0x7FFFFFFF
_LARGEST_I16 = 32767
_STANDSTILL_COUNTS, _STANDSTILL_POLLS = 2, 10
_S = _LONGEST_STOP_NS = 1_000_000_000
_MODES = 0x0208  # object 6502: profile torque and cyclic synchronous torque


class DriveRating(NamedTuple):
    """Ratings of one simulated drive.

    node_id: CANopen node id. rated_torque: object 6076 [Nm]; rated_current: object 6075 [A].
    max_torque: object 6072 [per mille of rated]. counts_per_turn: object 608F.
    """

    node_id: int
    rated_torque: float
    rated_current: float
    max_torque: int
    counts_per_turn: int


class SimulatedDrive(CanopenDevice):
    """One drive with its motor.

    name: in faults; link: its cable; axis: its motor; physics: the world's time.
    """

    FAULTS = DRIVE
    over_current = over_temperature = any_fault = digital_inputs = 0
    torque_off = motor_open = warning = refuse_enable = mode_lost = False
    refuse_torque_limit = micro_rating = False
    stuck_torque: float | None = None
    frozen_position: int | None = None
    modes: int | None = None

    def __init__(
        self,
        name: str,
        link: Link,
        settings: DriveRating,
        axis: Axis,
        physics: Physics,
        profile: Profile = ANY_DRIVE,
    ):
        super().__init__(name, link, settings.node_id, "drive.eds", profile)
        declared = profile.objects["6502"].value if "6502" in profile.objects else None
        self._own_modes = _MODES if declared is None else declared
        own = self.traits.mode
        self._torque_modes = (own,) if own else TORQUE_MODES
        self._gives = not own
        self._counts = self.traits.parameters.get("rated_command", 1000)
        self.settings = settings
        self.axis = axis
        self.machine = cia402.StateMachine(lambda index: self.node.optional(index, 0, 0))
        self._shift = 0
        self._physics = physics
        self._ramped_ns = self._stop_ns = 0
        self._still = self._last_position = 0
        self._wire_objects()
        self.restarted()

    # Objects.

    def statusword(self) -> int:
        """Return object 6041."""
        word = cia402.STATUS_BITS[self.machine.state] | cia402.REMOTE
        if not self.voltage_lost:
            word |= cia402.VOLTAGE_ENABLED
        if self.warning:
            word |= cia402.WARNING
        if self.machine.driving:
            if abs(self._wanted()) > self._limit:
                word |= cia402.INTERNAL_LIMIT
            if self._mode == CYCLIC_SYNCHRONOUS_TORQUE:
                word |= cia402.FOLLOWS_COMMAND
            elif self._demand == self._wanted():
                word |= cia402.TARGET_REACHED
        return word

    def position(self) -> int:
        """Return object 6064, wrapped to 32 bits."""
        if self.frozen_position is not None:
            return self.frozen_position
        return c_int32(self.axis.position() + self._shift).value

    def torque(self) -> int:
        """Return the torque that is given, object 6077 [unit of the command]."""
        per_mille = round(self.axis.torque() * self._per_newton_metre)
        return max(-_LARGEST_I16, min(_LARGEST_I16, per_mille))

    @property
    def voltage_lost(self) -> bool:
        """Return whether the power stage has no supply."""
        codes = (self.over_current, self.over_temperature, self.any_fault)
        return self.torque_off or UNDERVOLTAGE in codes

    @property
    def causes(self) -> list[int]:
        """The error codes of faults whose cause lasts."""
        codes = (self.over_current, self.over_temperature, self.any_fault)
        return [*filter(None, codes)]

    # What CiA 301 calls back.

    def written(self, now_ns: int) -> None:
        """Act on a controlword, a target or a setting."""
        self._physics.advance(now_ns)
        causes = self.causes
        may_switch_on = not self.torque_off and UNDERVOLTAGE not in causes
        self.machine.control(self._controlword, not causes, may_switch_on)
        if self.error_code:
            self._check_fault_gone()
        if self.traits.mode:
            self._gives = self._chosen()
        if self.refuse_enable and self.machine.state == cia402.ENABLED:
            self.machine.state = cia402.SWITCHED_ON
        self._act(now_ns)

    def connection_lost(self, code: int) -> None:
        """Report the loss and react as 6007 requires."""
        super().connection_lost(code)
        option = self.node.optional(0x6007, 0, 0)
        if option == _ABORT_FAULT:
            self.fail(code)
        elif option == _ABORT_DISABLE:
            self.machine.disable_voltage()
        elif option == _ABORT_QUICK_STOP:
            self.machine.quick_stop()
        self._act(self.now_ns)

    def connection_back(self, code: int) -> None:
        """Report the return of the master, unless the resulting fault is still latched."""
        if self.error_code != code:
            super().connection_back(code)

    def state_changed(self, old: int, new: int) -> None:
        """Treat NMT stop and resets in mid-run as a lost connection."""
        if old == OPERATIONAL and new in (STOPPED, INITIALISING):
            self.connection_lost(NMT_LOST)
        elif new == OPERATIONAL:
            self.connection_back(NMT_LOST)

    def restarted(self) -> None:
        """Start with this drive's own ratings, no command, motor released."""
        settings, node = self.settings, self.node
        node.put(0x6075, 0, round(settings.rated_current * 1000.0))
        node.put(0x6072, 0, settings.max_torque)
        node.put(0x608F, 1, settings.counts_per_turn)
        self._controlword = self._target = self._torque_offset = self._mode = 0
        self._demand = 0.0
        self.error_code = 0
        self._rate(round(settings.rated_torque / self.traits.torque_unit))
        self._read_limits()
        self.machine.boot()
        if self.causes:
            self.fail(self.causes[0])
        self._act(self.now_ns)

    def poll(self, now_ns: int) -> None:
        """Run the timers, the torque ramp and the wait for standstill."""
        super().poll(now_ns)
        if self.machine.after_stop is not None:
            self._watch_stop(now_ns)
        elif self._mode == PROFILE_TORQUE:
            self._act(now_ns)

    def fail(self, code: int) -> None:
        """Enter fault with an error code (object 603F); 605E sets the reaction."""
        if self.machine.state not in (cia402.FAULT, cia402.FAULT_REACTION):
            self.error_code = code
        self.errors.report(code)
        self.machine.fault()
        self._act(self.now_ns)

    # Faults.

    def refresh(self) -> None:
        """Update the motor after a fault has begun or ended."""
        if self.torque_off:
            self.machine.disable_voltage()
        self._act(self.now_ns)

    def release(self, _size: float) -> None:
        """Drop to switch on disabled."""
        self.machine.disable_voltage()
        self.refresh()

    def leave_bus(self, size: float) -> None:
        """Lose the bus and, with it, the master."""
        super().leave_bus(size)
        self.connection_lost(NMT_LOST)

    def freeze(self, _size: float) -> None:
        """Report the present position from here on."""
        self.frozen_position = self.position()

    def jump(self, counts: float) -> None:
        """Move the reported position."""
        self._shift += round(counts)

    # Inside.

    def _wire_objects(self) -> None:
        node = self.node
        node.checks.append(self._check_write)
        node.sources.update(
            {
                (0x603F, 0): partial(getattr, self, "error_code"),
                (0x6040, 0): partial(getattr, self, "_controlword"),
                (0x6041, 0): self.statusword,
                (0x6060, 0): partial(getattr, self, "_mode"),
                (0x6061, 0): self._shown_mode(),
                (0x6064, 0): self.position,
                key_of(self.traits.command): self._shown_target,
                (0x6074, 0): lambda: round(self._demand),
                (0x6076, 0): self._shown_rating,
                (0x6077, 0): self.torque,
                (0x6078, 0): self.torque,
                key_of(self.traits.actual): self.torque,
                (0x6079, 0): lambda: 0 if self.voltage_lost else 48_000,
                (0x60B2, 0): partial(getattr, self, "_torque_offset"),
                (0x60FD, 0): partial(getattr, self, "digital_inputs"),
                (0x6502, 0): lambda: self._own_modes if self.modes is None else self.modes,
            }
        )
        commands = {0x6040: "_controlword", 0x60B2: "_torque_offset"}
        for index, attribute in commands.items():
            node.sinks[index, 0] = partial(setattr, self, attribute)
        node.sinks[key_of(self.traits.command)] = self._aim
        node.sinks[0x6060, 0] = self._set_mode
        node.sinks[0x6076, 0] = self._rate
        for key in ((0x6087, 0), key_of(self.traits.limit_object or "6072")):
            node.sinks[key] = lambda _value: self._read_limits()

    def _aim(self, target: int) -> None:
        """Take a target that the object's range allows; another one changes nothing."""
        target >>= 16 if self.traits.upper_half else 0
        if abs(target) <= self.traits.largest_target:
            self._target = target

    def _shown_target(self) -> int:
        return self._target << (16 if self.traits.upper_half else 0)

    def _shown_mode(self) -> Callable[[], int]:
        """Return what tells object 6061: in each state, or in some only."""
        shown = self.traits.mode_shown
        if shown == ALWAYS:
            return lambda: 0 if self.mode_lost else self._mode
        told = range(cia402.READY if shown == READY else cia402.ENABLED, cia402.ENABLED + 1)
        return lambda: self._mode if self.machine.state in told and not self.mode_lost else 0

    def _shown_rating(self) -> int:
        return round(self.settings.rated_torque * 1e6) if self.micro_rating else self._rated

    def _rate(self, rated: int) -> None:
        self._rated = rated
        self._newton_metres = max(1, rated) * self.traits.torque_unit * (1.0 / self._counts)
        self._per_newton_metre = 1.0 / self._newton_metres

    def _read_limits(self) -> None:
        node, traits = self.node, self.traits
        if traits.limit_object:
            present = node.value(*key_of(traits.limit_object))
            if traits.limit_base:
                base = node.value(*key_of(traits.limit_base))
                present = round(1000 * present / max(1, base))
            elif traits.limit_below:
                present = traits.limit_below - present
            self._limit = min(_LARGEST_I16, present)
        else:
            per_mille = node.optional(0x6072, 0, _LARGEST_I16)
            self._limit = min(_LARGEST_I16, per_mille * self._counts // 1000)
        self._slope = node.optional(0x6087, 0, _STEEPEST)

    def _supported(self, mode: int) -> bool:
        if mode < 0:
            return mode == self.traits.mode
        return mode == 0 or (mode > 0 and bool(self.node.value(0x6502) >> mode - 1 & 1))

    def _check_write(self, index: int, _subindex: int, value: int) -> None:
        require(index != 0x6060 or self._supported(value), INVALID_VALUE)
        require(index != 0x6072 or not self.refuse_torque_limit, READ_ONLY)

    def _set_mode(self, value: int) -> None:
        if self._supported(value):
            self._mode = value

    def _check_fault_gone(self) -> None:
        if self.machine.state == cia402.SWITCH_ON_DISABLED:
            self.error_code = 0
            self.errors.resolve_all()

    def _wanted(self) -> int:
        if self._mode == PROFILE_TORQUE:
            return 0 if self._controlword & _HALT else self._target
        return self._target + self._torque_offset if self._mode in self._torque_modes else 0

    def _chosen(self) -> bool:
        """Return whether bits and source are those with which a maker's own mode gives torque."""
        source, bits = self.traits.source_object, self.traits.mode_bits
        chosen = not source or self.node.value(*key_of(source)) == 1
        return chosen and self._controlword & bits == bits

    def _act(self, now_ns: int) -> None:
        """Set the motor according to state, mode and target."""
        machine = self.machine
        driving = machine.driving and self._mode in self._torque_modes and self._gives
        elapsed, self._ramped_ns = now_ns - self._ramped_ns, now_ns
        if driving:
            goal = float(max(-self._limit, min(self._limit, self._wanted())))
            if self._mode == PROFILE_TORQUE:
                step = self._slope * elapsed / _S
                goal = max(self._demand - step, min(self._demand + step, goal))
            self._demand = goal
        else:
            self._demand = 0.0
        torque = self._demand * self._newton_metres
        if self.stuck_torque is not None:
            torque = self.stuck_torque * 1e-3 * self.settings.rated_torque
        if self.motor_open:
            driving = False
        self.axis.drive(torque if driving else 0.0, driving, machine.braking)
        if machine.after_stop is None:
            self._stop_ns = 0

    def _watch_stop(self, now_ns: int) -> None:
        """End a stop when the motor has stood still for a while, or took too long."""
        position = self.axis.position()
        moved, self._last_position = abs(position - self._last_position), position
        if not self._stop_ns:
            self._stop_ns, self._still = now_ns, 0
        self._still = self._still + 1 if moved <= _STANDSTILL_COUNTS else 0
        if self._still >= _STANDSTILL_POLLS or now_ns - self._stop_ns > _LONGEST_STOP_NS:
            self.machine.standstill()
            self._act(now_ns)
