# SPDX-License-Identifier: Apache-2.0
"""The devices on their buses: who answers, guards, directions, counts, noise, latency.

The drivers are those of the nodes. Drives are found and configured, and started for one answer to
SYNC alone (`exchange.py`): a drive without a command stays off, and its guards are not armed.
"""

from __future__ import annotations

import statistics
from collections import Counter
from collections.abc import Callable
from typing import Any, NamedTuple

from .. import plugins
from ..can_io.load import bits_per_second
from ..can_io.port import Port
from ..clock import Clock
from ..devices.canopen import OPERATIONAL, CanopenDevice
from ..devices.drive import Drive
from ..devices.encoder import Encoder
from ..devices.errors import DeviceError, NotAnswering, Occupied
from ..devices.polled import Line
from ..loop.sensor import PolledSensor
from ..loop.vertical import Roles, VerticalLoop, Wires
from ..safety.timing import quantile
from .finding import Finding

MOST_LATE = 0.5
"""Share of the period in which the slowest percent of the answers should have come."""
MOST_NOISE, LEAST_NOISE = 1.0, 1e-6
"""Standard deviation of the force on a handle at rest [N]; none at all means frozen gauges."""
LEAST_MOTION = 0.005
"""Motion of the handle that shows directions [m]."""
_LISTEN_S, _SCAN_S = 1.0, 0.5
_DEVICE_TYPE = bytes((0x40, 0x00, 0x10, 0x00, 0, 0, 0, 0))
_SERIAL = bytes((0x40, 0x18, 0x10, 0x04, 0, 0, 0, 0))
_QUESTIONS = 2
_REQUEST, _RESPONSE, _HEARTBEAT = 0x600, 0x580, 0x700
_USED = (range(1), range(0x100, 0x800))
"""Identifiers that show a master, or what one has started: all but emergencies and those that are
free in CiA 301. Of heartbeats those in OPERATIONAL do, but for our devices'."""
_MOST_NAMED = 5
_UPLOAD = 0x43
_BUSY = 50.0  # foreign frames per second
_SAME = 0.1  # relative difference of two measurements of one motion
_READ_S = 0.05


class Bus(NamedTuple):
    """One bus and those of our devices on it. bitrate [bit/s]."""

    name: str
    port: Port
    bitrate: int
    devices: tuple[Any, ...]

    @property
    def node_ids(self) -> dict[int, int]:
        """Our CANopen devices: node id -> device profile."""
        return {each.settings.node_id: each.profile_number for each in self.devices
                if isinstance(each, CanopenDevice)}  # fmt: skip


class Heard(NamedTuple):
    """What others send while we are silent. rate: [frames/s]; used_by: what only a master, or a
    device that one has started, sends; empty without any.
    """

    rate: float
    used_by: str


def listen(bus: Bus) -> Heard:
    """Listen for a second, without a frame of ours."""
    port = bus.port
    used: Counter[int] = Counter()
    own = {_HEARTBEAT + node for node in bus.node_ids}
    notes = {can_id: _counting(used, can_id)
             for span in _USED for can_id in span if can_id not in own}  # fmt: skip
    for can_id, note in notes.items():
        port.subscribe(can_id, note)
    before, syncs = port.counters.total(), port.counters["foreign_sync"]
    port.wait_for(lambda: False, _LISTEN_S)
    for can_id, note in notes.items():
        port.unsubscribe(can_id, note)
    rate = (port.counters.total() - before) / _LISTEN_S
    names = ["SYNC"] * (port.counters["foreign_sync"] > syncs)
    names += [f"0x{can_id:03X}" for can_id, _ in used.most_common(_MOST_NAMED)]
    more = len(used) - _MOST_NAMED
    return Heard(rate, ", ".join(names) + (f" and {more} more" if more > 0 else ""))


def _counting(counts: Counter[int], can_id: int) -> Callable[[bytes, int], None]:
    heartbeat = can_id - _HEARTBEAT in range(1, 128)

    def note(data: bytes, _arrival_ns: int) -> None:
        if not heartbeat or data[:1] == bytes([OPERATIONAL]):
            counts[can_id] += 1

    return note


def in_use(bus: Bus, by: str) -> Finding:
    """Return that a bus was only listened to. by: who or what uses it."""
    return Finding(
        f"{bus.name} is in use", f"{by}: only listened to, none of its devices was asked or set up",
        "a silent bus", "end the robot or the other master (or switch off and on a device that "
        "sends by itself), then look again",
    )  # fmt: skip


def traffic(bus: Bus, heard: Heard) -> list[Finding]:
    """Return the configured load, and what others send: nobody should, before the robot runs."""
    frames = [frame for device in bus.devices for frame in device.traffic]
    load = bits_per_second(frames) / bus.bitrate
    lower = "" if load < 0.8 else "lower the rate, or give a device a bus of its own"
    seen = heard.rate
    others = "" if seen < _BUSY else (
        "another master or a running robot uses this bus: stop it, or take its devices off"
    )  # fmt: skip
    return [
        Finding(f"{bus.name} load", f"{100 * load:.0f} % of {bus.bitrate} bit/s at the rates "
                "of the parameters", "below 80 %", lower),
        Finding(f"{bus.name} traffic", f"{seen:.0f} frames/s while we are silent",
                f"below {_BUSY:.0f}", others),
    ]  # fmt: skip


def node_ids(bus: Bus) -> Finding:
    """Return who answers for its device type (object 1000), on all node ids, and how many.

    Two devices with one node id answer both, unless at the same instant with the same bits: so
    those that are there are also asked for their serial number (1018:04).
    """
    found: dict[int, int] = {}
    answers: Counter[int] = Counter()

    def note(node: int) -> Callable[[bytes, int], None]:
        def on_answer(data: bytes, _arrival_ns: int) -> None:
            answers[node] += 1
            if len(data) == 8 and data[0] == _UPLOAD and data[1:3] == _DEVICE_TYPE[1:3]:
                found[node] = int.from_bytes(data[4:6], "little")

        return on_answer

    notes = {node: note(node) for node in range(1, 128)}
    for node, callback in notes.items():
        bus.port.subscribe(_RESPONSE + node, callback)
    try:
        for request, nodes in ((_DEVICE_TYPE, notes), (_SERIAL, found)):
            for node in [*nodes]:
                bus.port.send(_REQUEST + node, request)
            bus.port.wait_for(lambda: False, _SCAN_S)
    finally:
        for node, callback in notes.items():
            bus.port.unsubscribe(_RESPONSE + node, callback)
    wanted = bus.node_ids
    missing = sorted(node for node, profile in wanted.items() if found.get(node) != profile)
    twins = sorted(node for node, count in answers.items() if count > _QUESTIONS)
    text = ", ".join(
        f"{node}: CiA {profile}{' (more than one device)' if node in twins else ''}"
        for node, profile in sorted(found.items())
    )
    todo = "" if not missing else (
        f"nobody of the wanted kind at node id {', '.join(map(str, missing))}: set the device's "
        "node id or the parameter node_id; if nobody answers at all, look at supply, cable, "
        "120 ohm at both ends, bit rate"
    )  # fmt: skip
    if twins:
        todo = "; ".join(filter(None, [
            f"more than one device answers at node id {', '.join(map(str, twins))}: leave one of "
            "them on the bus, and give it another id", todo]))  # fmt: skip
    names = ", ".join(f"{node}: CiA {profile}" for node, profile in sorted(wanted.items()))
    return Finding(f"{bus.name} node ids", text or "nobody answers", names, todo)


def configured(device: Any, name: str) -> list[Finding]:
    """Configure a device as its node would; return identity and guards, or why it failed."""
    try:
        device.configure()
    except Occupied as error:
        return [Finding(name, str(error), "nobody else", "stop the other program or node")]
    except NotAnswering as error:
        return [Finding(name, str(error), "an answer", "see the line of its bus")]
    except DeviceError as error:
        return [Finding(name, str(error), "its configuration", _likely(device))]
    except BaseException as error:  # the driver may be somebody else's
        return [failed_driver(name, error)]
    found = [Finding(name, device.identity)]
    if isinstance(device, CanopenDevice):
        found += [Finding(f"{name} set back", each) for each in device.set_back]
    if isinstance(device, Drive):
        if lacking := device.guards_refusal():
            makes = _makes(device)
            todo = f"as it says; {makes}" if makes else "as it says"
            found.append(Finding(f"{name} guards", lacking, "all of them", todo))
        found += [Finding(f"{name} guard", warning) for warning in device.warnings
                  if not (lacking and warning.startswith("UNGUARDED"))]  # fmt: skip
    return found


def failed_driver(name: str, error: BaseException) -> Finding:
    """Return that a driver has raised what is no error of a device."""
    text = f"its driver failed: {plugins.told(error)}"
    return Finding(name, text, "an error that names what is wrong", "mend the driver")


def _likely(device: Any) -> str:
    """Return what may help: the makes that come closest."""
    makes = _makes(device)
    if not makes:
        return "check supply, cable, ids and parameters"
    return f"correct the parameter that it names, or set `profile`; {makes}"


def _makes(device: Any) -> str:
    """Return the makes that come closest, empty if nobody says."""
    try:
        return device.likely_makes() if isinstance(device, CanopenDevice) else ""
    except DeviceError:
        return ""


def directions(
    encoder: Encoder, drive: Drive, clock: Clock, seconds: float
) -> list[Finding]:
    """Compare encoder and drive while somebody moves the handle UP and down again."""
    heights: list[float] = []
    places: list[float] = []
    until_ns = clock.now_ns() + round(seconds * 1e9)
    try:
        while clock.now_ns() < until_ns:
            heights.append(encoder.sdo.signed(0x6004) * encoder.step)
            places.append(drive.sdo.signed(0x6064) * drive.step)
            clock.sleep(_READ_S)
    except DeviceError as error:
        return [Finding("directions", str(error), "two positions", "see the lines above")]
    up = max(heights) - heights[0]
    down = heights[0] - min(heights)
    risen = up if up >= down else -down
    followed = places[heights.index(max(heights) if up >= down else min(heights))] - places[0]
    return [_travel("encoder", risen), _together(risen, followed)]


def _travel(name: str, risen: float) -> Finding:
    found = f"{risen * 1e3:+.1f} mm at the farthest point"
    if abs(risen) < LEAST_MOTION:
        todo = "move the handle by hand; if it moved, the count is stuck or the id is another's"
        return Finding(f"{name} direction", found, "more than 5 mm up", todo)
    todo = "" if risen > 0 else "it was moved up? then set the encoder's direction to the other"
    return Finding(f"{name} direction", found, "up is positive", todo)


def _together(risen: float, followed: float) -> Finding:
    found = f"encoder {risen * 1e3:+.1f} mm, drive {followed * 1e3:+.1f} mm"
    todo = ""
    if abs(risen) < LEAST_MOTION and abs(followed) < LEAST_MOTION:
        todo = "move the handle by hand"
    elif risen * followed < 0:
        todo = "set the amplifier's direction to the other"
    elif abs(risen - followed) > _SAME * max(abs(risen), abs(followed)):
        todo = "counts_per_turn of encoder or amplifier, or the lead, is wrong; or one is stuck"
    return Finding("encoder and drive", found, "the same motion", todo)


def sampled(
    parts: dict[str, tuple[Any, Line]], clock: Clock, period_ns: int, seconds: float
) -> list[Finding]:
    """Poll encoder and force sensor for a while: noise, latency, lost answers.

    parts: `encoder` and `force_sensor`, as far as they are configured, each with its port.
    """
    forces: list[tuple[float, float, float]] = []
    polled = {name: PolledSensor(device, port, clock) for name, (device, port) in parts.items()}
    wires = Wires(publish_force=lambda reading: forces.append((reading.fx, reading.fy, reading.fz)))
    loop = VerticalLoop(clock, period_ns, wires)
    for device, _ in parts.values():
        device.start()
    until_ns = clock.now_ns() + round(seconds * 1e9)
    while clock.now_ns() < until_ns:
        loop.step(Roles(polled.get("encoder"), polled.get("force_sensor")))
    found = []
    for name, (device, _) in parts.items():
        found += _answers(name, device, polled[name], period_ns)
        device.stop()
    if "force_sensor" in parts:
        found += _force(forces)
    return found


def _answers(name: str, device: Any, polled: PolledSensor, period_ns: int) -> list[Finding]:
    counters = device.counters
    lost, asked = counters["missing"] + counters["late"], max(1, counters["requests"])
    slow = quantile(polled.answers, 0.99)
    todo = "" if lost <= 1e-3 * asked else "cable, termination, load of bus and computer"
    late = "" if slow <= MOST_LATE * period_ns * 1e-9 else (
        "lower the rate, give it a bus of its own, or a computer with less to do"
    )  # fmt: skip
    fault = Finding(f"{name} status", device.fault or "no fault", "no fault",
                    "see docs/hardware.md, symptoms" if device.fault else "")  # fmt: skip
    return [
        fault,
        Finding(f"{name} lost answers", f"{lost} of {asked}", "at most one in a thousand", todo),
        Finding(f"{name} latency p99", f"{slow * 1e6:.0f} us",
                f"at most {MOST_LATE * period_ns * 1e-3:.0f} us", late),
    ]  # fmt: skip


def _force(forces: list[tuple[float, float, float]]) -> list[Finding]:
    if len(forces) < 2:
        return [Finding("force sensor noise", "no samples", "samples", "see its lines above")]
    noise = max(statistics.pstdev(axis) for axis in zip(*forces, strict=True))
    todo = ""
    if noise > MOST_NOISE:
        todo = "let go of the handle; then: shield, ground, cable, a gauge that breaks"
    elif noise < LEAST_NOISE:
        todo = "the gauges do not change at all: converter or cable"
    wanted = f"below {MOST_NOISE:g} N"
    return [Finding("force sensor noise", f"{noise:.3f} N at rest", wanted, todo)]
