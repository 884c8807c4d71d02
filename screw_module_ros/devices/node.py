# SPDX-License-Identifier: Apache-2.0
"""Services of every CANopen device: identity, network management, heartbeat, emergencies (CiA 301).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from canopen.nmt import NMT_STATES as NMT_STATES  # for drive_logic
from canopen.nmt import NmtMaster

from ..can_io.port import Port
from . import emcy
from .errors import DeviceError, NotConfigured, Occupied, Refused, WrongDevice
from .sdo import Sdo

BOOT_UP = 0x00
STOPPED = 0x04
OPERATIONAL = 0x05
PRE_OPERATIONAL = 0x7F

_NMT_START = 0x01
_NMT_STOP = 0x02
_NMT_PRE_OPERATIONAL = 0x80
_HEARTBEAT_BASE = 0x700
_EMCY_BASE = 0x080
_TOGGLE_BIT = 0x80
UNWATCHED_NS = 2_000_000_000
"""After this time without a reader of its bus a device may have lost what it was told [ns]."""


class Identity(NamedTuple):
    """Objects 1000 and 1018 of a device; 0 for an entry that it does not have."""

    device_type: int
    vendor_id: int = 0
    product_code: int = 0
    revision: int = 0
    serial: int = 0

    @property
    def profile(self) -> int:
        """Number of the device profile: 402 for drives, 406 for encoders."""
        return self.device_type & 0xFFFF

    @property
    def text(self) -> str:
        """Identity as text, for messages and hardware_id."""
        return (
            f"CiA {self.profile}, vendor 0x{self.vendor_id:X}, product 0x{self.product_code:X}, "
            f"revision 0x{self.revision:X}, serial {self.serial}"
        )


class CanopenNode:
    """One remote node: its identity, its network state, its unsolicited reports.

    label: name of the device in messages, like `vertical drive`. The thread that pumps the port
    calls on_boot_up(), on_emergency(Emergency) and, for each request of another SDO client,
    on_foreign_sdo().
    """

    def __init__(
        self,
        port: Port,
        node_id: int,
        label: str,
        sdo_timeout_s: float,
        on_boot_up: Callable[[], None],
        on_emergency: Callable[[emcy.Emergency], None],
        on_foreign_sdo: Callable[[], None],
    ):
        self.port = port
        self.node_id = node_id
        self.label = label
        self.sdo = Sdo(port, node_id, label, sdo_timeout_s, on_foreign_sdo)
        self.identity = Identity(0)
        self.state: int | None = None
        self.heartbeat_ns: int | None = None
        self.boot_ups = 0
        self.configured = False
        self._foreign_known = self._boot_ups_known = self._configured_ns = 0
        self._on_boot_up = on_boot_up
        self._on_emergency = on_emergency
        self._nmt = NmtMaster(node_id)
        self._nmt.network = port.network
        port.subscribe(_HEARTBEAT_BASE + node_id, self._heartbeat)
        port.subscribe(_EMCY_BASE + node_id, self._emergency)

    def start(self) -> None:
        """Make this node, and no other, OPERATIONAL."""
        self._nmt.send_command(_NMT_START)

    def pre_operational(self) -> None:
        """Make this node, and no other, PRE-OPERATIONAL: its PDOs stop."""
        self._nmt.send_command(_NMT_PRE_OPERATIONAL)

    def stop(self) -> None:
        """Make this node, and no other, STOPPED: it accepts neither PDOs nor SDOs any more."""
        self._nmt.send_command(_NMT_STOP)

    def identify(self, profile: int, vendor_id: int = 0, product_code: int = 0) -> Identity:
        """Read the node's identity and check it against the expected one; 0 = any.

        Raises WrongDevice, NotAnswering.
        """
        sdo = self.sdo
        self._foreign_known = sdo.foreign
        parts = [sdo.unsigned(0x1000)]
        for subindex in range(1, 5):
            try:
                parts.append(sdo.unsigned(0x1018, subindex))
            except Refused:
                parts.append(0)  # only the vendor is mandatory
        self._boot_ups_known = self.boot_ups  # what came before its answers happened before them
        self.identity = found = Identity(*parts)
        wanted = {"profile": profile, "vendor_id": vendor_id, "product_code": product_code}
        for name, value in wanted.items():
            if value and getattr(found, name) != value:
                raise WrongDevice(
                    f"{self.label}: node id {self.node_id} on {self.port.name} is another device "
                    f"({found.text}); {name} {value} (0x{value:X}) is wanted: check the node id "
                    "and the cable"
                )
        return found

    def end_configuration(self) -> None:
        """Count as configured: from here on a restart or another client is a fault.

        Raises NotConfigured when the node has restarted since `identify`, Occupied when somebody
        else has asked it or told it something since then; it is not configured then.
        """
        self._configured_ns = self.port.clock.now_ns()
        self.configured = True  # before the check, so that nothing is missed between the two
        try:
            self._undisturbed()
        except DeviceError:
            self.configured = False
            raise

    def may_start(self, watched: bool) -> bool:
        """Return whether the configuration is still there; watched: the bus is being read.

        Where nobody reads the bus, a boot-up frame may be lost in a full receive buffer.
        """
        age_ns = self.port.clock.now_ns() - self._configured_ns
        return self.configured and (watched or age_ns <= UNWATCHED_NS)

    def _undisturbed(self) -> None:
        if self.sdo.foreign != self._foreign_known:
            raise Occupied(
                f"{self.sdo.foreign_client} talked to the {self.label} while it was being "
                "configured: stop it"
            )
        if self.boot_ups != self._boot_ups_known:
            raise NotConfigured(
                f"{self.label} restarted while it was being configured; check its supply"
            )

    def _heartbeat(self, data: bytes, arrival_ns: int) -> None:
        if len(data) != 1:
            self.port.counters.malformed += 1
            return
        state = data[0] & ~_TOGGLE_BIT
        self.heartbeat_ns = arrival_ns
        if state == BOOT_UP:
            self.boot_ups += 1
            self.state = PRE_OPERATIONAL
            self._on_boot_up()
        else:
            self.state = state

    def _emergency(self, data: bytes, _arrival_ns: int) -> None:
        emergency = emcy.decode(data)
        if emergency is None:
            self.port.counters.malformed += 1
        else:
            self._on_emergency(emergency)
