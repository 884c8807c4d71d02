# SPDX-License-Identifier: Apache-2.0
"""The whole far end: five devices on up to four buses, one world, one thread.

`process` is one pass without waiting, `run` serves the buses by wall clock, `run_in_steps` in
simulated time. The answer to SYNC has priority: the rig takes one frame from each bus in turn and
does its housekeeping in the quiet part of a period. It advances the physics when a device reads or
commands it.
"""

from __future__ import annotations

import select
from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Protocol

import can

from screw_module_ros.clock import Clock, WallClock
from screw_module_ros.lockstep.conductor import Conductor
from screw_module_ros.lockstep.page import FOREVER, NOW
from screw_module_ros.plant.world import World
from screw_module_ros.rig.build import BUSES, RigSettings, build_devices
from screw_module_ros.rig.device import CLEAR, SimulatedDevice
from screw_module_ros.rig.drive import SimulatedDrive
from screw_module_ros.rig.faults import catalogue
from screw_module_ros.rig.physics import RELEASED, Physics
from screw_module_ros.rig.port import COUNTED, RigPort
from screw_module_ros.settings import shown, validated

ALL = "all"

_BUS = "_bus"
_PLANE = "planar"
_SYNC_ID = 0x080
_MOST_FRAMES = 256
"""Frames handled in one pass at most."""
_AWAITED = ("encoder", "force_sensor")
"""Buses served first: real devices answer at the same time, simulated ones one after another."""
_BACKLOG = 64
"""Frames handled by the loop at most, before it serves the timers."""
_HOUSEKEEPING_NS = 1_000_000
_AFTER_TICK_NS = 600_000
"""Time of the housekeeping: the nodes tick at whole periods and have written by then."""
_LONGEST_UNSEEN_NS = 2_000_000
"""Longest time without an update of the world."""
_LOOK_S = 0.05
_PAUSE_S = 0.0002
"""Pause between two passes for interfaces without a file descriptor."""


class Loops(Protocol):
    """The loops of the rig's process (`lockstep.rounds`). earliest_ns: of their waits [ns]."""

    earliest_ns: int

    def run_ready(self, now_ns: int) -> bool:
        """Run each loop that is ready; return whether any was."""

    def holds(self) -> bool:
        """Return whether a frame within this process has not been read: time waits for it."""


class Rig:
    """The simulated devices on `buses`, driven by `world`.

    buses: encoder, drive, force_sensor, planar -> bus; several keys may share a bus, and devices
    without a key do not exist. clock: simulated time advances in steps (see `physics`);
    period_ns: the shortest period of the nodes. Raises ValueError for an unknown bus or setting.
    """

    def __init__(
        self,
        buses: Mapping[str, can.BusABC],
        world: World,
        clock: Clock | None = None,
        period_ns: int = 1_000_000,
        settings: RigSettings | None = None,
    ):
        unknown = ", ".join(name for name in buses if name not in BUSES)
        if unknown or not buses:
            raise ValueError(f"buses: {unknown or 'none'}; some of {', '.join(BUSES)} are wanted")
        settings = validated(settings or RigSettings())
        clock = self._clock = clock or WallClock()
        latency_ns = round(settings.command_latency * 1e9)
        self.physics = Physics(world, clock.simulated, period_ns, latency_ns)
        if clock.simulated:  # the world begins now, whatever anybody waits for before the loop runs
            self.physics.advance(clock.now_ns())
        self._period_ns = period_ns
        self._every_ns = min(period_ns, _HOUSEKEEPING_NS)
        self._after_ns = _AFTER_TICK_NS * self._every_ns // _HOUSEKEEPING_NS
        self._requests: deque[Callable[[], object]] = deque()
        by_bus = {id(bus): RigPort(bus, clock) for bus in buses.values()}
        self._ports = {name: by_bus[id(bus)] for name, bus in buses.items()}
        self._distinct = list(by_bus.values())
        #: name -> device: encoder, drive, force_sensor, shoulder, elbow
        self.devices: dict[str, SimulatedDevice] = {
            device.name: device for device in build_devices(settings, self._ports, self.physics)
        }
        self._outside, self._by_number = select.epoll(), {}
        for port in self._distinct:
            if (number := port.fileno()) is not None:
                self._outside.register(number, select.EPOLLIN)
                self._by_number[number] = port
            port.first[_SYNC_ID] = self.physics.sync
            port.rebuild()

    def process(self, now_ns: int) -> int:
        """Do one pass without waiting: requests, every waiting frame, timers.

        Returns the number of frames handled.
        """
        handled = self.serve(now_ns)
        self._housekeep(now_ns)
        return handled

    def serve(self, now_ns: int) -> int:
        """Serve requests and every waiting frame; return the number of frames."""
        if self._requests:
            self._serve_requests()
        return self.serve_expected(now_ns)

    def run(self, should_stop: Callable[[], bool]) -> None:
        """Serve the buses in real time until `should_stop()`.

        Raises OSError or ValueError when a bus is closed meanwhile.
        """
        self.physics.resume()
        awaited = [self._ports[name] for name in _AWAITED if name in self._ports]
        # A dictionary keeps each port once, at its first place.
        found = {port.fileno(): port for port in (*awaited, *self._distinct)}
        ports = {number: port for number, port in found.items() if number is not None}
        if None in found:
            self._run_without_waiting(should_stop)
            return
        descriptors, clock, wait = list(ports), self._clock.now_ns, select.select
        backlog, wake_ns = 0, 0
        while not should_stop():
            pause_s = max(0, wake_ns - clock()) * 1e-9
            ready = wait(descriptors, (), (), pause_s)[0]
            now_ns = clock()
            for descriptor in ready:
                ports[descriptor].receive(now_ns)
            backlog += len(ready)
            # Waiting frames come before the timers: a timer may monitor them.
            if now_ns >= wake_ns and (not ready or backlog > _BACKLOG):
                self._serve_requests()
                self._housekeep(now_ns)
                backlog, wake_ns = 0, self._next_wake(now_ns)

    def run_in_steps(
        self, conductor: Conductor, should_stop: Callable[[], bool], stepped: Callable[[int], None],
        loops: Loops | None = None,
    ) -> None:
        """Serve the buses and advance simulated time until `should_stop()`.

        stepped: called with each new time [ns], after the devices' timers. loops: those of the same
        process.
        """
        while not should_stop():
            while self.turn(conductor, stepped, loops):
                pass

    def turn(
        self, conductor: Conductor, stepped: Callable[[int], None], loops: Loops | None = None,
        until_ns: int = FOREVER,
    ) -> bool:
        """One pass of `run_in_steps`: loops run, or time moves, to `until_ns` at most.

        Return whether loops ran: then more may be ready.
        """
        conductor.look()
        now_ns = conductor.header[NOW]
        if self._requests:
            self._serve_requests()
        self.serve_expected(now_ns)
        if loops is not None:
            if loops.run_ready(now_ns):
                return True
            until_ns = min(until_ns, loops.earliest_ns)
        content_ns = conductor.quiet()
        if content_ns is None or (loops is not None and loops.holds()):
            if not conductor.sleep(_LOOK_S):
                self._serve_uncounted(now_ns)  # whoever holds time may be joining a bus
        elif (early_s := conductor.too_early()) > 0.0:
            conductor.sleep(early_s)
        else:
            now_ns = min(content_ns, until_ns, (now_ns // self._period_ns + 1) * self._period_ns)
            conductor.move(now_ns)
            self._housekeep(now_ns)
            self._serve_uncounted(now_ns)
            stepped(now_ns)
            conductor.release()
        return False

    def serve_expected(self, now_ns: int) -> int:
        """Handle the frames that time waits for, one from each bus in turn; return their number."""
        handled, served = 0, 1
        while served and handled < _MOST_FRAMES:
            served = 0
            for port in self._distinct:
                if port.queue or (port.far and port.expects()):
                    served += port.receive(now_ns)
            handled += served
        return handled

    def _serve_uncounted(self, now_ns: int) -> None:
        """Admit new members of the buses and handle the frames of foreign ones: once per step."""
        for number, _ in self._outside.poll(0):
            while self._by_number[number].receive(now_ns):
                pass

    def call(self, function: Callable[[], object]) -> None:
        """Call `function` between two frames, in the thread that runs the rig.

        Use it to change the world or a device from another thread. `process` or `run` raises its
        exceptions.
        """
        self._requests.append(function)

    def inject(self, device: str, fault: str, value: float, duration: float, now_ns: int) -> str:
        """Inject a fault; `describe` lists the faults.

        device: a device, a bus (`planar`, or a key of the buses with `_bus` behind it) or `all`.
        value: size in the fault's own unit, 0 = its default; duration: [s], 0 = until the fault
        `clear`. An empty fault changes nothing and returns the list. Takes effect with the next
        pass. Returns a description; raises ValueError with the problem and the known faults.
        """
        if not fault:
            return self.describe(device or ALL)
        devices = self._chosen(device)
        if len(devices) > 1 and fault != CLEAR:
            devices = [one for one in devices if fault in one.FAULTS] or devices
        sentences = [one.announce(fault, value, duration) for one in devices]
        for one in devices:
            self.call(partial(one.inject, fault, value, duration, now_ns))
        return "; ".join(sentences)

    def describe(self, device: str = ALL) -> str:
        """Return the faults of a device, a bus or all, as readable text."""
        chosen = self._chosen(device)
        lines = [f"{one.name}, active: {', '.join(one.active)}" for one in chosen if one.active]
        lines += catalogue({one.name: one.FAULTS for one in chosen})
        known = ", ".join((*self.devices, *self._buses(), ALL))
        lines += [
            f"devices and buses: {known}; '{CLEAR}' ends every fault of a device",
            "value 0 = the default; duration in s, 0 = until cleared",
        ]
        return "\n".join(lines)

    @property
    def counters(self) -> dict[str, Any]:
        """Counters by name, over all buses.

        ignored: frames that no device here answers. lost: frames that processes which do not read
        have lost. slipped: periods of wall clock skipped because the machine was busy.
        """
        found = {name: sum(getattr(port, name) for port in self._distinct) for name in COUNTED}
        return found | {"slipped": self.physics.slipped}

    def close(self) -> None:
        """Release the motors and stop listening; the caller closes the buses."""
        self._outside.close()
        for device in self.devices.values():
            device.link.listen({})
            if isinstance(device, SimulatedDrive):
                device.axis.drive(*RELEASED)

    # Inside.

    def _housekeep(self, now_ns: int) -> None:
        if self.physics.stepped or now_ns - self.physics.reached_ns >= _LONGEST_UNSEEN_NS:
            self.physics.advance(now_ns)
        for device in self.devices.values():
            device.poll(now_ns)

    def _serve_requests(self) -> None:
        while self._requests:
            self._requests.popleft()()

    def _next_wake(self, now_ns: int) -> int:
        every, after = self._every_ns, self._after_ns
        return ((now_ns - after) // every + 1) * every + after

    def _run_without_waiting(self, should_stop: Callable[[], bool]) -> None:
        while not should_stop():
            if not self.process(self._clock.now_ns()):
                self._clock.sleep(_PAUSE_S)

    def _buses(self) -> dict[str, RigPort]:
        named = {name + _BUS: port for name, port in self._ports.items()}
        if _PLANE in self._ports:
            named[_PLANE] = self._ports[_PLANE]
        return named

    def _chosen(self, name: str) -> list[SimulatedDevice]:
        """Return the devices for a name. Raises ValueError for an unknown one."""
        if name == ALL:
            return list(self.devices.values())
        if name in self.devices:
            return [self.devices[name]]
        port = self._buses().get(name)
        if port is None:
            known = ", ".join((*self.devices, *self._buses(), ALL))
            raise ValueError(f"there is no {shown(name)} here; there are {known}")
        return [device for device in self.devices.values() if device.link.port is port]
