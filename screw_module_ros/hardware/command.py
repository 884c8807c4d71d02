# SPDX-License-Identifier: Apache-2.0
"""`check_hardware`: look at computer, buses and devices before the first start.

It reads the same parameter file as the nodes. It finds and configures the devices; it never enables
a drive. A bus that somebody uses is only listened to: nodes, whose locks it takes first, or another
master.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import click

from .. import graph, parameter_files
from ..can_io.bus import BusSettings, open_port, where, within
from ..can_io.errors import BusError
from ..can_io.port import Port
from ..clock import Clock, WallClock
from ..control.planar_settings import PlanarSettings
from ..control.support import SupportSettings
from ..control.vertical_settings import VerticalSettings
from ..devices import force_sensors
from ..devices.canopen import CanopenDevice
from ..devices.drive import Drive
from ..devices.drive_settings import JOINTS, SHARED, DriveSettings
from ..devices.encoder import Encoder
from ..devices.encoder_setup import EncoderSettings
from ..devices.force_sensor_settings import ForceSensorSettings
from ..devices.makes import node_parameters
from ..devices.polled import Line
from ..geometry import Screw
from ..locks import AlreadyRunning, lock_device
from ..profiles import DRIVE, ENCODER, GENERIC_402, GENERIC_406, load
from ..resources import resource_path
from ..safety.checks import WatchSettings
from ..settings import SettingError, fields, read
from ..software import software
from . import devices, exchange, machine
from .devices import Bus
from .finding import TO_DO, Finding, table

NODES = ("encoder", "force_sensor", "amplifier", "manus")
CONTROLLER = "impedance_controller"
Values = dict[str, dict[str, Any]]


def values_of(path: str, namespace: str = "") -> Values:
    """Return what a file gives to the controller and each node of `NODES` in a namespace, dotted.

    namespace: with leading /, empty for none. Raises SettingError for a file without a section.
    """
    file = parameter_files.sections(path)
    return {node: parameter_files.values_of(file, f"{namespace}/{node}")
            for node in (*NODES, CONTROLLER)}  # fmt: skip


def sections(
    path: str, namespace: str, values: Values, nodes: Collection[str]
) -> list[Finding]:
    """Return what does not fit together: the sections of a parameter file and the nodes."""
    todo = "see the section's name, and --namespace"
    robot = [node for entry in graph.table() for node in entry.nodes]
    unread = parameter_files.unread_sections(path, [*robot, *graph.BESIDE], namespace)
    without = "write the section /**/{0}:, give --namespace, or leave it out: --without {0}"
    return [
        *(Finding("parameter file", text, todo=todo, known=False) for text in unread),
        *(Finding(f"{node} parameters", f"no section of {path} is for {namespace}/{node}",
                  todo=without.format(node))
          for node in nodes if not values[node]),
    ]  # fmt: skip


def settings(kind: type, values: dict[str, Any], prefix: str = "", **defaults: Any) -> Any:
    """Return the record `kind` from a node's parameters. Raises SettingError."""
    given = {name: values[prefix + name] for name in fields(kind) if prefix + name in values}
    return read(kind, {**defaults, **given}, prefix.rstrip("."))


def _shared(values: dict[str, Any]) -> dict[str, Any]:
    """Return what the parameters of `manus` give to both of its drives."""
    return {name: values[name] for name in ("rate", *SHARED) if name in values}


class DeviceSet:
    """The drivers of a parameter file, on their buses; a bus that cannot be opened is a finding.

    Their locks are ours, as far as nobody has them: `driven` says on which buses somebody has.
    """

    def __init__(
        self, values: Values, nodes: Collection[str], clock: Clock, stack: ExitStack,
        namespace: str = "",
    ):  # fmt: skip
        self.findings: list[Finding] = []
        self.buses: dict[BusSettings, Bus] = {}
        self.devices: dict[str, Any] = {}
        self.driven: dict[str, str] = {}
        self._locked: set[tuple[str, str]] = set()
        self._values, self._nodes, self._clock, self._stack = values, nodes, clock, stack
        self._namespace = namespace
        self._add("encoder", lambda opened, v: Encoder(
            opened(), settings(EncoderSettings, v), settings(Screw, v),
            load(v.get("profile", GENERIC_406), ENCODER)))
        self._add("force_sensor", lambda opened, v: force_sensors.driver(
            settings(ForceSensorSettings, v), opened, clock))
        self._add("amplifier", lambda opened, v: Drive(
            opened(), settings(DriveSettings, v), "vertical drive",
            per_turn=settings(Screw, v).lead, profile=load(v.get("profile", GENERIC_402), DRIVE)))
        for joint, own in JOINTS.items():
            self._add("manus", lambda opened, v, joint=joint, own=own: Drive(
                opened(), settings(DriveSettings, v, f"{joint}.", **own._asdict() | _shared(v)),
                f"{joint} drive", profile=load(v.get("profile", GENERIC_402), DRIVE)), joint)

    def _add(self, node: str, make: Any, name: str = "") -> None:
        if node not in self._nodes:
            return
        values = self._values[node]
        bus = settings(BusSettings, values, "can.", channel=graph.bus_of(node))
        bus = within(bus._replace(sync_producer=True), self._namespace)
        claimed: list[str] = []

        def opened(*claims: str) -> Port:
            claimed.extend(claims)
            return self._open(bus)

        try:
            device = make(opened, values)
        except (BusError, AlreadyRunning) as error:
            self.findings.append(Finding(f"bus {bus.channel}", str(error), "open", "as it says"))
            return
        except SettingError:
            raise
        except BaseException as error:  # the driver may be somebody else's: anything may come out
            self.findings.append(devices.failed_driver(node, error))
            return
        self.devices[name or node] = device
        line = getattr(device, "port", None)
        if line is not None and line is not getattr(self.buses.get(bus), "port", None):
            self._stack.callback(line.close)  # a sensor that is not on CAN
            return
        held = self.buses[bus]
        self.buses[bus] = held._replace(devices=(*held.devices, device))
        self._lock(bus, tuple(claimed) or device.settings.claims)

    def _lock(self, bus: BusSettings, claims: tuple[str, ...]) -> None:
        for claim in claims:
            if (place := (where(bus), claim)) in self._locked:
                continue  # two drives have one master
            try:
                self._stack.callback(lock_device(*place).release)
                self._locked.add(place)
            except AlreadyRunning:
                self.driven.setdefault(bus.channel, f"a node drives {claim}")

    def _open(self, bus: BusSettings) -> Port:
        if bus in self.buses:
            return self.buses[bus].port
        if not any(each.what == bus.channel for each in self.findings):
            self.findings += machine.interface(bus)
        port = open_port(bus, self._clock)
        self._stack.callback(port.close)
        self.buses[bus] = Bus(bus.channel, port, bus.bitrate, ())
        return port

    def port_of(self, device: Any) -> Port | None:
        """Return the port of a device's bus, None for one that is not on CAN."""
        return next((b.port for b in self.buses.values() if device in b.devices), None)


def check(
    values: Values, nodes: Collection[str], clock: Clock, move: float, seconds: float, tell: Any,
    namespace: str = "",
) -> list[Finding]:  # fmt: skip
    """Return all findings. move: time to move the handle [s]; seconds: of sampling [s].
    nodes: those of `NODES` whose devices are there; namespace: of the robot, with leading /.

    tell(text): says what the operator has to do now. Raises SettingError.
    """
    with ExitStack() as stack:
        found = DeviceSet(values, nodes, clock, stack, namespace)
        findings = [*machine.machine(), *found.findings]
        free: list[Any] = []
        for bus in found.buses.values():
            try:
                findings += _looked_at(bus, found.driven.get(bus.name, ""), free)
            except BusError as error:  # what was found up to here is told all the same
                findings.append(Finding(f"bus {bus.name}", str(error), "works", "as it says"))
        there = {}
        for name, device in found.devices.items():
            if device not in free and found.port_of(device) is not None:
                continue
            told = devices.configured(device, name)
            findings += told
            if told[0].todo == "":
                there[name] = device
                if isinstance(device, CanopenDevice):
                    findings.append(_answer(device, name, found.port_of(device)))
        if move and {"encoder", "amplifier"} <= there.keys():
            tell(f"Move the handle UP by about 5 cm and back, for {move:g} s.")
            findings += devices.directions(there["encoder"], there["amplifier"], clock, move)
        parts: dict[str, tuple[Any, Line]] = {
            name: (there[name], found.port_of(there[name]) or there[name].port)
            for name in ("encoder", "force_sensor") if name in there
        }  # fmt: skip
        if seconds and parts:
            tell(f"Let go of the handle: {seconds:g} s of samples.")
            period_ns = round(1e9 / next(iter(parts.values()))[0].settings.rate)
            findings += devices.sampled(parts, clock, period_ns, seconds)
    return findings


def _looked_at(bus: Bus, driven: str, free: list[Any]) -> list[Finding]:
    """Return what is heard on a bus; add its devices to `free` where nobody uses it.

    driven: what a node of ours drives on it. Raises BusError.
    """
    heard = devices.listen(bus)
    findings = devices.traffic(bus, heard)
    if users := ", ".join(filter(None, [driven, heard.used_by])):
        return [*findings, devices.in_use(bus, users)]
    ids = devices.node_ids(bus)
    free += bus.devices
    return [*findings, ids]


def _answer(device: CanopenDevice, name: str, port: Any) -> Finding:
    try:
        return exchange.answer_to_sync(device, name, port)
    except BusError as error:
        return Finding(f"{name} answer to SYNC", str(error), "works", "as it says")


def form(path: Path, values: Values) -> str:
    """Return the form of an acceptance, a page, with the limits that the nodes of a robot read.

    values: of the parameter file `path`; else the defaults of who owns a limit count. Raises
    SettingError.
    """
    law, joint = values[CONTROLLER], JOINTS["shoulder"]._asdict() | _shared(values["manus"])
    return resource_path("params/acceptance.html").read_text(encoding="utf-8").format(
        file=path.name, sha256=hashlib.sha256(path.read_bytes()).hexdigest(), software=software(),
        law=settings(VerticalSettings, law), watch=settings(WatchSettings, law, "watch."),
        support=settings(SupportSettings, law, "support."),
        drive=settings(DriveSettings, values["amplifier"]),
        joint=settings(DriveSettings, values["manus"], "shoulder.", **joint),
        plane=settings(PlanarSettings, values["manus"]),
    )  # fmt: skip


@click.command()
@click.option("--params", type=click.Path(exists=True, dir_okay=False),
              help="Parameter file, in place of the packaged params/hardware.yaml.")
@click.option("--simulation", is_flag=True,
              help="Look at the simulated rig: `bringup --only sim_rig --wall-clock` runs beside.")
@click.option("--devices", "makes", default="", metavar="NAME,...",
              help="Makes of the devices, like epos4,sick_ahm36 (params/devices).")
@click.option("--namespace", default="", help="Of the robot, like /left: its sections of the file.")
@click.option("--without", multiple=True, type=click.Choice(NODES),
              help="Leave the devices of this node out (repeat for more).")
@click.option("--move", default=10.0, help="Seconds in which somebody moves the handle, 0 = none.")
@click.option("--seconds", default=60.0, help="Seconds of samples, 0 = none.")
@click.option("--acceptance", is_flag=True,
              help="Print the form of an acceptance, a page with this robot's limits, and end.")
def command(
    params: str | None, simulation: bool, makes: str, namespace: str, without: tuple[str, ...],
    move: float, seconds: float, acceptance: bool,
) -> None:  # fmt: skip
    """Look at computer, buses and devices before the first start. No drive is ever enabled."""
    packaged = resource_path("params/sim.yaml" if simulation else "params/hardware.yaml")
    path = Path(params) if params else packaged
    try:
        above = parameter_files.above(namespace)
        values = values_of(str(path), above)
        for node, own in node_parameters(makes, simulation).items():
            values[node].update(own)
        if acceptance:
            click.echo(form(path, values))
            return
        click.echo(f"check_hardware with {path.name}: it never enables a drive.\n")
        nodes = [node for node in NODES if node not in without]
        findings = sections(str(path), above, values, nodes)
        findings += check(values, nodes, WallClock(), move, seconds, click.echo, above)
    except SettingError as error:
        raise click.ClickException(str(error)) from error
    click.echo(table(findings))
    todo = sum(each.verdict == TO_DO for each in findings)
    click.echo(f"\n{todo} thing{'s' * (todo != 1)} to do. No drive was enabled.")
    raise SystemExit(1 if todo else 0)
