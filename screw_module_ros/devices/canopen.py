# SPDX-License-Identifier: Apache-2.0
"""What drives and encoders share as CANopen devices (CiA 301), and our own heartbeat.

A device goes `configure` -> `start` -> cyclic work -> `stop`. Its configuration counts as lost
after a boot-up, after `stop`, and when nobody has read its bus for 2 s. Requests of another SDO
client may have altered it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from typing import Any, ClassVar, NamedTuple

from ..can_io.port import SYNC_ID, Port
from ..profiles import Profile, closest
from . import communication, emcy
from .errors import DeviceError, NotAnswering, NotConfigured, Occupied, Refused, WrongDevice
from .life import Life, Phase, Remedy
from .sdo import Sdo
from .surplus import Beats

#: NMT commands (CiA 301, 7.2.8.3.1): each goes to one node, never to all.
NMT_START, NMT_STOP, NMT_PRE_OPERATIONAL, NMT_RESET_COMMUNICATION = 0x01, 0x02, 0x80, 0x82
#: NMT states in a heartbeat.
BOOT_UP, STOPPED, OPERATIONAL, PRE_OPERATIONAL = 0x00, 0x04, 0x05, 0x7F

_NMT_ID = 0x000
_HEARTBEAT_BASE = 0x700
_EMCY_BASE = 0x080
_TOGGLE_BIT = 0x80
_BOOT_S = 1.0  # time in which a device boots after a reset of its communication
_TWO_ANSWERS = "two answers to one question (SDO)"


class Heartbeat:
    """Heartbeat producer of this process on one bus (CiA 301, 7.2.8.3); drives of a bus share it.

    The loop that writes the torque sends it, never a thread: when the loop hangs, the heartbeat
    must stop, so that the drive detects it. master_id: node id in the identifier. period: [s].
    """

    def __init__(self, port: Port, master_id: int, period: float):
        self.can_id = _HEARTBEAT_BASE + master_id
        self._port = port
        self._period_ns = round(period * 1e9)
        self._due_ns = 0

    def beat(self, now_ns: int) -> None:
        """Send one frame when it is due. now_ns: CLOCK_MONOTONIC [ns]. Raises BusError."""
        if now_ns >= self._due_ns:
            self._due_ns = now_ns + self._period_ns
            self._port.send(self.can_id, bytes([OPERATIONAL]))

    def rest(self) -> None:
        """Restart: the next `beat` sends at once."""
        self._due_ns = 0


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


class CanopenDevice(Life, ABC):
    """One remote node; a driver is a subclass with its CiA profile and the hooks at the end.

    settings: at least node_id, vendor_id, product_code, sdo_timeout and listen. label: name of the
    device in messages, like `vertical drive`. profile: what is known of its model. counters: events
    since the driver was created, by name. remedy: RESET of a device that was silent: of its
    communication. nmt, heartbeat_ns: network state and arrival of the last heartbeat. emergency:
    text of the last emergency, empty after its reset.
    set_back: what an earlier master had left in it and `configure` has set back.
    """

    profile_number: ClassVar[int]

    def __init__(self, port: Port, settings: Any, label: str, profile: Profile):
        super().__init__(port.clock)
        self.settings = settings
        self.profile = profile
        self.label = label
        self.counters: Counter[str] = Counter()
        self.nmt: int | None = None
        self.heartbeat_ns: int | None = None
        self.emergency = ""
        self.set_back: list[str] = []
        self.sdo = Sdo(
            port, settings.node_id, label, settings.sdo_timeout, self._on_foreign_request
        )
        self._port = port
        self._beats = Beats()
        self._identity = Identity(0)
        self._disturbances = (0, 0)
        port.subscribe(_HEARTBEAT_BASE + settings.node_id, self._on_heartbeat)
        port.subscribe(_EMCY_BASE + settings.node_id, self._on_emergency)

    # -- configuration: blocking -----------------------------------------------------------------

    @property
    def identity(self) -> str:
        """Identity that the device reports, for hardware_id."""
        return self._identity.text

    def configure(self) -> None:
        """Find the device and configure it as the settings say; blocking, without NMT start.

        One that was silent, or does not answer, is told first to reset its communication. A bus
        that has failed is opened anew. Raises Occupied, NotAnswering, WrongDevice, Refused,
        NotConfigured, BusError.
        """
        self.become_new()
        self.set_back = []
        self._port.restore()
        self.refuse_others()
        self.sdo.count_anew()
        foreign = self.counters["foreign_sdo"]
        try:
            self._find()
            self.make_safe()
            self.set_back += communication.set_back(
                self.sdo, self.settings.node_id, round(1e6 / self.sync_rate), self.own_objects
            )
            found = self.set_up()
        except DeviceError as error:
            if self.counters["foreign_sdo"] != foreign:  # its answers came unasked, too
                raise self._talked_to() from error
            if self.sdo.doubled:  # which of them refused, or what, nobody can say
                raise WrongDevice(self._twins(_TWO_ANSWERS)) from error
            raise
        self.become_configured()  # before the check, so that nothing is missed between the two
        try:
            self._check_undisturbed()
        except DeviceError:
            self.become_new()
            raise
        self.adopt(found)

    def likely_makes(self, most: int = 3) -> str:
        """Return a table of the profiles that come closest to this device; blocking.

        Raises NotAnswering, BusError.
        """
        found = closest(self.profile.kind, self._identity.vendor_id, self.sdo.has)[:most]
        width = max(len(each.name) for each in found)
        rows = (f"  {each.name:{width}}  {', '.join(each.differing) or 'fits'}" for each in found)
        return f"profiles closest to the {self.label}, and how it differs:\n" + "\n".join(rows)

    def start(self) -> None:
        """NMT start; cyclic work may begin.

        Raises NotConfigured before `configure` and after `stop`, BusError.
        """
        if self.phase is Phase.NEW:
            raise NotConfigured(f"the {self.label} is not configured")
        self.prepare_start()
        self.command_nmt(NMT_START)
        self.sdo.count_anew()
        self._beats = Beats()  # before the loop's thread may arm it
        self.become_running()

    def stop(self) -> None:
        """Send nothing more. The configuration counts as gone: nobody watches any more."""
        self.become_new()

    def command_nmt(self, command: int) -> None:
        """Send an NMT command to this node, and to no other. Raises BusError."""
        self._port.send(_NMT_ID, bytes([command, self.settings.node_id]))

    def listen_for(self, can_ids: dict[int, str]) -> None:
        """Raise Occupied when another master sends one of `can_ids`, or SYNC where that is ours.

        can_ids: text about each identifier for the message.
        """
        heard = self._port.listen(dict.fromkeys(can_ids, bool), self.settings.listen)
        if heard == SYNC_ID:
            raise Occupied(
                f"somebody already sends SYNC on {self._port.name}: a second copy of this node; or "
                "a device that makes SYNC itself (object 1005, bit 30: it ends with that device's "
                "supply); or can.sync_producer should be false here"
            )
        if heard is not None:
            raise Occupied(
                f"somebody already commands the {self.label} on {self._port.name} "
                f"({can_ids[heard]}): is a second copy of this node running?"
            )

    def _find(self) -> None:
        if self.remedy is Remedy.RESET:
            self._restart_communication()
        self.command_nmt(NMT_PRE_OPERATIONAL)
        try:
            self._identify()
        except NotAnswering as error:
            if not self._restart_communication():
                raise NotAnswering(
                    f"{error}. Nor did it restart its communication when told to (NMT): switch its "
                    "supply off and on"
                ) from error
            self.command_nmt(NMT_PRE_OPERATIONAL)
            self._identify()
        self.remedy = Remedy.NOTHING

    def _restart_communication(self) -> bool:
        """Tell the device to reset its communication; return whether it has booted up."""
        before = self.counters["boot_ups"]
        self.command_nmt(NMT_RESET_COMMUNICATION)
        return self._port.wait_for(lambda: self.counters["boot_ups"] > before, _BOOT_S)

    def check_answers(self) -> None:
        """Latch that most of our questions of late had two answers."""
        if self.phase is Phase.RUNNING and self.sdo.doubled:
            self.sdo.count_anew()
            self.doubled(_TWO_ANSWERS)

    def _twins(self, shown: str) -> str:
        """Return what to say of two devices with one node id. shown: by what."""
        return (
            f"more than one device answers as the {self.label} (node id {self.settings.node_id}) "
            f"on {self._port.name}: {shown}; leave one of them on the bus, give it another id, "
            "then clear the fault"
        )

    def _identify(self) -> None:
        """Read the identity and compare it with the settings, where 0 means any."""
        foreign = self.counters["foreign_sdo"]
        parts = [self.sdo.unsigned(0x1000)]
        for subindex in range(1, 5):
            try:
                parts.append(self.sdo.unsigned(0x1018, subindex))
            except Refused:
                parts.append(0)  # only the vendor is mandatory
        # Boot-ups that came before its answers happened before them.
        self._disturbances = foreign, self.counters["boot_ups"]
        self._identity = found = Identity(*parts)
        settings, profile = self.settings, self.profile
        for name, value in (
            ("profile", self.profile_number),
            ("vendor_id", settings.vendor_id or profile.vendor_id),
            ("product_code", settings.product_code or profile.product_code),
        ):
            if value and getattr(found, name) != value:
                raise WrongDevice(
                    f"{self.label}: node id {settings.node_id} on {self._port.name} is another "
                    f"device ({found.text}); {name} {value} (0x{value:X}) is wanted: check the "
                    "node id, the cable and the `profile`"
                )

    def _check_undisturbed(self) -> None:
        foreign, boot_ups = self._disturbances
        if self.counters["foreign_sdo"] != foreign:  # its answers came unasked, too
            raise self._talked_to()
        if self.sdo.doubled:
            raise WrongDevice(self._twins(_TWO_ANSWERS))
        if self.counters["boot_ups"] != boot_ups:
            raise NotConfigured(
                f"{self.label} restarted while it was being configured; check its supply"
            )

    def _talked_to(self) -> Occupied:
        return Occupied(
            f"{self.sdo.foreign_client} talked to the {self.label} while it was being configured: "
            "stop it"
        )

    # -- unsolicited reports of the device, from the thread that pumps the port ------------------

    def _on_heartbeat(self, data: bytes, arrival_ns: int) -> None:
        if not data:
            self._port.counters["malformed"] += 1
            return
        last_ns, self.heartbeat_ns = self.heartbeat_ns, arrival_ns
        if last_ns is not None and self._beats.note(arrival_ns - last_ns):
            self.doubled("two heartbeats a period")
        state = data[0] & ~_TOGGLE_BIT  # of a longer frame the first byte counts
        if state != BOOT_UP:
            self.nmt = state
            return
        self.nmt = PRE_OPERATIONAL
        self.counters["boot_ups"] += 1
        if self.phase is not Phase.NEW:
            self.become_new()
            self.restarted()

    def _on_foreign_request(self) -> None:
        self.counters["foreign_sdo"] += 1
        if self.phase is not Phase.NEW:
            self.altered_by(self.sdo.foreign_client)

    def _on_emergency(self, data: bytes, _arrival_ns: int) -> None:
        emergency = emcy.decode(data)
        if emergency is None:
            self._port.counters["malformed"] += 1
            return
        self.counters["emcy"] += 1
        self.emergency = "" if emergency.is_reset else emergency.text
        if self.emergency:
            self.reported(emergency)

    # -- hooks -----------------------------------------------------------------------------------

    @property
    @abstractmethod
    def sync_rate(self) -> float:
        """SYNCs per second on its bus [Hz]."""

    @property
    def own_objects(self) -> frozenset[tuple[int, int]]:
        """Communication objects that `set_up` writes: index and sub-index."""
        return frozenset()

    @property
    @abstractmethod
    def answer_id(self) -> int:
        """Identifier of the frame with which it answers SYNC."""

    @abstractmethod
    def refuse_others(self) -> None:
        """Raise Occupied when another master works on this bus: see `listen_for`."""

    def make_safe(self) -> None:
        """End what an earlier program may have left going, before anything else is written."""

    @abstractmethod
    def set_up(self) -> Any:
        """Write the objects of an identified device and read them back; return what was found."""

    @abstractmethod
    def adopt(self, found: Any) -> None:
        """Take over what `set_up` returned: the device is configured."""

    @abstractmethod
    def prepare_start(self) -> None:
        """Begin the cyclic work anew, just before NMT start."""

    @abstractmethod
    def restarted(self) -> None:
        """Latch that a configured device has booted up."""

    @abstractmethod
    def altered_by(self, client: str) -> None:
        """Latch that another SDO client talks to a configured device. client: its description."""

    @abstractmethod
    def doubled(self, shown: str) -> None:
        """Latch that more than one device has this node id. shown: by what."""

    @abstractmethod
    def reported(self, emergency: emcy.Emergency) -> None:
        """Process an emergency that is no reset."""
