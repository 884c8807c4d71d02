# SPDX-License-Identifier: Apache-2.0
"""Device profiles: what is known of one make of drive, encoder or force sensor, as data.

A file `params/devices/NAME.yaml` has two halves. `drive` and `encoder` say what the drivers do
otherwise than with a device of the standard; the drivers read them. `objects` and the fields of the
same name in `SimulatedTraits` say how such a device differs from the standard; the simulated rig
reads them, and `closest` recognises a device by them. Object keys are written as manuals write
them: `6072`, or `1400:05` for a sub-index, in hexadecimal.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from . import plugins
from .resources import ResourceError, resource_path
from .settings import Setting, SettingError
from .settings_file import read_file

FORMAT = "screw_module_ros/device"
DRIVE, ENCODER, FORCE_SENSOR = "drive", "encoder", "force_sensor"
GENERIC_402, GENERIC_406, NETCANOEM = "generic_402", "generic_406", "ati_netcanoem"
NAMES = (
    GENERIC_402, "epos4", "epos2", "elmo_gold", "elmo_simpliq", "ingenia", "ipos", "kinco",
    GENERIC_406, "sick_ahm36", "baumer_rotary", "baumer_linear",
    NETCANOEM, "ati_net",
)  # fmt: skip
"""The packaged profiles."""

DRIVE_HEARTBEAT, MASTER_HEARTBEAT = "drive_heartbeat", "master_heartbeat"
COMMAND_DEADLINE, LOST_CONNECTION = "command_deadline", "lost_connection"
QUICK_STOP_REACTION, FAULT_REACTION = "quick_stop_reaction", "fault_reaction"
TORQUE_LIMIT = "torque_limit"
GUARDS = {
    DRIVE_HEARTBEAT: "heartbeat of its own 1017",
    MASTER_HEARTBEAT: "watch over our heartbeat 1016",
    COMMAND_DEADLINE: "command deadline 1400:05",
    LOST_CONNECTION: "fault on lost connection 6007",
    QUICK_STOP_REACTION: "quick stop reaction 605A",
    FAULT_REACTION: "fault reaction 605E",
    TORQUE_LIMIT: "torque limit 6072",
}
"""What makes a drive drop its torque by itself: name -> text for messages."""

NODES = {DRIVE: ("amplifier", "manus"), ENCODER: ("encoder",), FORCE_SENSOR: ("force_sensor",)}
"""Nodes with the drivers of a kind of device."""

LITERAL, PERIOD_US, DEADLINE_PERIODS, LIMIT = "literal", "period_us", "deadline_periods", "limit"
LIMIT_COMMAND, LIMIT_BELOW = "limit_command", "limit_below"
QUANTITIES = (LITERAL, PERIOD_US, DEADLINE_PERIODS, LIMIT, LIMIT_COMMAND, LIMIT_BELOW)
ALWAYS, READY, ENABLED = "always", "ready", "enabled"
"""States in which a drive shows its mode (6061): all, from ready to switch on on, enabled alone."""
COMMAND_OBJECT, ACTUAL_OBJECT, RATING_OBJECT = "6071", "6077", "6076"
_STATE_MACHINE_BITS = 0x008F
_LARGEST = 0xFFFFFFFF
_YAML = (".yaml", ".yml")


class WrittenObject(NamedTuple):
    """One object that is written and read back.

    quantity: `literal` = value; `period_us` = period of the commands [us]; `deadline_periods` = the
    command's time limit in such periods; `limit` = the largest torque over the rated one, times
    object `base`; `limit_command` = the largest torque in the unit of the command; `limit_below` =
    value less that.
    """

    object: str
    size: Annotated[int, Setting("length of the object", "byte", choices=(1, 2, 4))]
    quantity: Annotated[str, Setting("what to write", choices=QUANTITIES)] = LITERAL
    value: Annotated[int, Setting("the literal value", "", -_LARGEST, _LARGEST)] = 0
    base: str = ""


class Substitute(NamedTuple):
    """What stands in for a guard that this make lacks.

    text: for messages. relies_on: guards that must be in force for it. A text alone holds no torque
    back, and only a command deadline does what watching our heartbeat does: see `flaw`.
    """

    guard: Annotated[str, Setting("the guard that is missing", choices=tuple(GUARDS))]
    text: str
    objects: tuple[WrittenObject, ...] = ()
    relies_on: Annotated[
        tuple[str, ...], Setting("the guards that have to hold", choices=tuple(GUARDS))
    ] = ()

    def flaw(self) -> str:
        """Return why this does not replace its guard, empty if it may."""
        own = f"{self.guard}: "
        if not (self.objects or self.relies_on):
            return (
                own + "a text alone holds no torque back: name the `objects` that are written and "
                "read back, or under `relies_on` the guards of the drive that have to hold"
            )
        deadlines = [each for each in self.objects if each.quantity == DEADLINE_PERIODS]
        if self.guard == MASTER_HEARTBEAT and not (deadlines or COMMAND_DEADLINE in self.relies_on):
            return (
                own + "only a deadline for commands replaces watching our heartbeat: name one in "
                f"`objects`, with the quantity {DEADLINE_PERIODS}, or rely on {COMMAND_DEADLINE}"
            )
        return ""


class DriveProfile(NamedTuple):
    """What the driver does with this make of CiA 402 drive.

    command, actual: objects of the torque that is wanted and given, in one and the same unit: per
    mille of the rated torque in the standard, a current or a torque in some makes. rating: object
    with the rated torque; empty where a drive has none, and the parameter `rated_torque` alone says
    it: then `rated_command` is what the command is at that torque. Torque and current must be
    proportional there.
    """

    rated_torque_unit: Annotated[
        float, Setting("unit of object 6076, 0 = mNm or micro-Nm, whichever fits", "Nm", 0.0, 1.0)
    ] = 0.0
    rating: Annotated[
        str, Setting("object of the rated torque, empty = none", choices=(RATING_OBJECT, ""))
    ] = RATING_OBJECT
    rated_command: Annotated[
        int, Setting("command at the rated torque where `rating` is empty; 0 = it depends on the "
                     "motor, the parameter of this name says it", "", 0, 32767)
    ] = 1000
    command: Annotated[str, Setting("object of the torque command")] = COMMAND_OBJECT
    command_size: Annotated[
        int, Setting("length of the command; of 4 the upper half counts", "byte", choices=(2, 4))
    ] = 2
    actual: Annotated[str, Setting("object of the torque that is given, 2 byte")] = ACTUAL_OBJECT
    modes: Annotated[
        tuple[int, ...], Setting("torque modes (6060), best first; below 0 those of the maker", "",
                                 -128, 127)
    ] = (10, 4)
    mode_objects: tuple[WrittenObject, ...] = ()
    mode_bits: Annotated[
        int, Setting("bits of the controlword that the mode wants while enabled", "", 0, 0xFFFF)
    ] = 0
    mode_shown: Annotated[
        str, Setting("from which state on 6061 shows the mode", choices=(ALWAYS, READY, ENABLED))
    ] = ALWAYS
    slow_status: Annotated[
        tuple[str, ...],
        Setting("objects in TPDO2; the others are read by SDO", choices=("603F", "6061", "60FD")),
    ] = ("603F", "6061", "60FD")
    slow_status_timer: Annotated[
        bool, Setting("TPDO2 has an event timer (1801:05); else it follows SYNC")
    ] = True
    largest_target: Annotated[
        int, Setting("largest command, in its unit", "", 1, 32767)
    ] = 32767
    heartbeat_timeout: Annotated[
        float, Setting("largest 1016 for this make, where it stands in for a guard", "s", 0.01,
                       10.0)
    ] = 10.0
    substitutes: tuple[Substitute, ...] = ()

    def flaw(self) -> str:
        """Return what does not fit together."""
        if not self.modes:
            return "modes = (): a torque mode is wanted"
        for mode in self.modes:
            if mode not in (4, 10) and mode >= 0:
                return f"modes: {mode} is no torque mode: 4, 10, or a maker's own below 0"
        if self.mode_bits & _STATE_MACHINE_BITS:
            return (
                f"mode_bits = 0x{self.mode_bits:X}: bits 0 to 3 and 7 belong to the state machine"
            )
        if self.rating and self.command != COMMAND_OBJECT:
            return (
                f"command = {self.command!r}: only {COMMAND_OBJECT} is per mille of object "
                f"{self.rating}; for another, rating: '' and rated_command are wanted"
            )
        return ""


class EncoderProfile(NamedTuple):
    """What the driver does with this make of CiA 406 encoder.

    Makers disagree about 6000. With `scaling` off nothing is written there, and the device has to
    count `counts_per_turn` by itself.
    """

    scaling: Annotated[
        bool, Setting("write 6000 (bit 0 direction, bit 2 scaling), 6001 and 6002")
    ] = False
    scaling_bit: Annotated[
        int, Setting("bit of 6000 that shows scaling, -1 = there is none", "", -1, 31)
    ] = 2
    pdo: Annotated[int, Setting("number of the TPDO for the position", "", 1, 4)] = 1
    linear: Annotated[
        bool, Setting("counts steps of a length: 6501 is their size [nm], not counts per turn")
    ] = False


NETCANOEM_PROTOCOL, NET_PROTOCOL = "netcanoem", "net"


class ForceSensorProfile(NamedTuple):
    """Protocol of the force sensor.

    protocol: `netcanoem`, `net`, or one whose driver another package brings
    (`devices.force_sensors`). settings: of such a driver's own.
    """

    protocol: str = NETCANOEM_PROTOCOL
    settings: dict[str, Any] = {}


class ObjectTrait(NamedTuple):
    """How one object of a make differs from that of the standard.

    size: above 0, the object is the maker's own [byte]. value: default, None = the standard's;
    per_node: the node id is added to it. signed: of a maker's own object.
    """

    absent: bool = False
    read_only: bool = False
    mappable: bool = True
    size: Annotated[int, Setting("of a maker's own object", "byte", choices=(0, 1, 2, 4))] = 0
    value: int | None = None
    per_node: bool = False
    signed: bool = False


class SimulatedTraits(NamedTuple):
    """How a simulated device of this make behaves, beyond its objects.

    torque_unit: of object 6076 [Nm]. command, actual: objects of the torque, the command in the
    upper half of 32 bit if `upper_half`. mode, mode_bits: in which alone it gives torque, 0 = those
    of CiA 402; source_object: has to be 1 for it. mode_shown: state from which 6061 shows the mode.
    limit_object, limit_base: torque limit as a share of another object, or in the command's unit
    without a base; `limit_below` less it if that is not 0. cycle_object [us], deadline_object
    [cycles]: its own deadline for commands. transmission_types: of PDOs, empty = those of CiA 301.
    reversed_bit, scaling_bit: of 6000. parameters: of the driver's node, which it needs with the
    simulated device.
    """

    torque_unit: Annotated[float, Setting("of object 6076", "Nm", 1e-9, 1.0)] = 1e-3
    largest_target: Annotated[int, Setting("largest command", "", 1, 32767)] = 32767
    command: str = COMMAND_OBJECT
    actual: str = ACTUAL_OBJECT
    upper_half: bool = False
    mode: Annotated[int, Setting("maker's own torque mode", "", -128, 0)] = 0
    mode_bits: Annotated[int, Setting("of the controlword", "", 0, 0xFFFF)] = 0
    source_object: str = ""
    mode_shown: Annotated[
        str, Setting("state from which 6061 is true", choices=(ALWAYS, READY, ENABLED))
    ] = ALWAYS
    limit_object: str = ""
    limit_base: str = ""
    limit_below: Annotated[int, Setting("value without a limit", "", 0, 32767)] = 0
    cycle_object: str = ""
    deadline_object: str = ""
    transmission_types: tuple[int, ...] = ()
    reversed_bit: Annotated[int, Setting("bit of 6000, -1 = none", "", -1, 31)] = 0
    scaling_bit: Annotated[int, Setting("bit of 6000, -1 = none", "", -1, 31)] = 2
    parameters: dict[str, Any] = {}


class Profile(NamedTuple):
    """One file of params/devices. tried: against what. sources: where its values come from."""

    kind: Annotated[str, Setting("kind of device", choices=(DRIVE, ENCODER, FORCE_SENSOR))]
    make: str
    tried: str
    sources: tuple[str, ...]
    notes: tuple[str, ...] = ()
    vendor_id: Annotated[int, Setting("object 1018:01, 0 = any", "", 0, _LARGEST)] = 0
    product_code: Annotated[int, Setting("object 1018:02, 0 = any", "", 0, _LARGEST)] = 0
    drive: DriveProfile = DriveProfile()
    encoder: EncoderProfile = EncoderProfile()
    force_sensor: ForceSensorProfile = ForceSensorProfile()
    objects: dict[str, ObjectTrait] = {}
    simulated: SimulatedTraits = SimulatedTraits()

    def flaw(self) -> str:
        """Return an object key that no manual would write."""
        drive = self.drive
        parts = [part for each in drive.substitutes for part in each.objects]
        parts += drive.mode_objects
        written = [key for part in parts for key in (part.object, part.base)]
        written += [drive.command, drive.actual]
        for key in (*self.objects, *filter(None, written)):
            try:
                key_of(key)
            except ValueError:
                return f"objects: {key!r}: an index like '6072' or '1400:05' is wanted"
        return ""


ANY_DRIVE = Profile(DRIVE, "CiA 402", "", ())
ANY_ENCODER = Profile(ENCODER, "CiA 406", "", (), encoder=EncoderProfile(scaling=True))
"""What the drivers expect of a device of the standard."""


def key_of(text: str) -> tuple[int, int]:
    """Return index and sub-index of `6072` or `1400:05`. Raises ValueError."""
    index, _, subindex = text.partition(":")
    return int(index, 16), int(subindex or "0", 16)


def load(name: str, kind: str = "") -> Profile:
    """Return a packaged profile, or one of a YAML file of yours.

    name: as in `NAMES`, a path that ends with .yaml, or `package:NAME` for the file NAME.yaml in
    the folder of a package or module. kind: wanted, empty for any. Raises SettingError naming the
    file, or the names that there are.
    """
    path = Path(name)
    package, colon, own = name.partition(":")
    if colon and path.suffix not in _YAML:
        path = plugins.beside(package, f"{own}.yaml")
    elif path.suffix not in _YAML:
        try:
            path = resource_path(f"params/devices/{name}.yaml")
        except ResourceError:
            raise SettingError(
                f"profile = {name!r}: there is no such device profile; there are "
                f"{', '.join(NAMES)}, the path of a .yaml file of yours, or package:NAME"
            ) from None
    found = read_file(path, Profile, FORMAT)
    if kind and found.kind != kind:
        raise SettingError(f"profile = {name!r} is of a {found.kind}; one of a {kind} is wanted")
    return found


def by_kind(devices: str) -> dict[str, str]:
    """Return the profiles of a list like `epos4,sick_ahm36`: kind of device -> name.

    Raises SettingError for one that does not exist, or for two of a kind.
    """
    found: dict[str, str] = {}
    for name in filter(None, (part.strip() for part in devices.split(","))):
        kind = load(name).kind
        if kind in found:
            raise SettingError(f"devices: {found[kind]} and {name} are both of a {kind}")
        found[kind] = name
    return found


class Likeness(NamedTuple):
    """How well a profile fits a device: traits that agree, and those that do not."""

    name: str
    agreeing: int
    differing: tuple[str, ...]


def closest(kind: str, vendor_id: int, has: Callable[[int, int], bool]) -> list[Likeness]:
    """Return the packaged profiles of a kind, the most similar first.

    vendor_id: object 1018:01 of the device. has(index, subindex): whether it has an object; asked
    once for each that distinguishes two profiles.
    """
    profiles = {name: load(name) for name in NAMES}
    profiles = {name: each for name, each in profiles.items() if each.kind == kind}
    keys = sorted({key for each in profiles.values() for key in each.objects})
    own = {key for each in profiles.values() for key, trait in each.objects.items() if trait.size}
    there = {key: has(*key_of(key)) for key in keys}
    return sorted(
        (_likeness(name, each, there, own, vendor_id) for name, each in profiles.items()),
        key=lambda found: found.agreeing,
        reverse=True,
    )


def _likeness(
    name: str, profile: Profile, there: dict[str, bool], own: set[str], vendor_id: int
) -> Likeness:
    """Compare one profile with the objects that are there; own: objects of one maker only."""
    differing = []
    for key, found in there.items():
        trait = profile.objects.get(key)
        wanted = not trait.absent if trait else key not in own
        if found != wanted:
            differing.append(f"{key} {'is there' if found else 'is absent'}")
    agreeing = len(there) - len(differing)
    if profile.vendor_id and profile.vendor_id == vendor_id:
        agreeing += len(there)  # the maker tells more than any object
    elif profile.vendor_id:
        differing.append(f"vendor 0x{vendor_id:X} in place of 0x{profile.vendor_id:X}")
    return Likeness(name, agreeing, tuple(differing))
