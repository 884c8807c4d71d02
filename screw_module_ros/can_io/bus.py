# SPDX-License-Identifier: Apache-2.0
"""Opens one CAN bus through python-can on any interface (parameters `can.*`).

`rig` is a bus of the simulated rig, `rig/rig_bus.py`, which python-can finds by its entry point.
`virtual` works inside one process only (tests). Every other interface works by wall clock only; all
but `udp_multicast` are hardware.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Annotated, Any, NamedTuple

import can
from can.interfaces.udp_multicast import UdpMulticastBus

from ..clock import Clock
from ..domain import domain_id
from ..settings import Setting, validated
from .errors import BusError
from .port import Port

RIG = "rig"
SIMULATED_INTERFACES = (RIG, "virtual")
_UDP_PORT = 43113  # python-can's
_MOST_ECHOES = 256
_BITRATES = (10_000, 20_000, 50_000, 125_000, 250_000, 500_000, 800_000, 1_000_000)


class BusSettings(NamedTuple):
    """One CAN bus and this process's role on it; the same names in every driver node."""

    interface: Annotated[
        str, Setting("python-can interface: rig (simulated), socketcan, udp_multicast, pcan, ...")
    ] = RIG
    channel: Annotated[
        str, Setting("channel of the interface, like can0; for rig the name of a simulated bus")
    ] = "encoder"
    port: Annotated[int, Setting("UDP port (udp_multicast only)", "", 1, 65535)] = _UDP_PORT
    bitrate: Annotated[int, Setting("bit rate of the bus", "bit/s", choices=_BITRATES)] = 1_000_000
    fd: Annotated[bool, Setting("the bus also carries CAN FD frames; ours are classical")] = False
    sync_producer: Annotated[
        bool, Setting("this node sends SYNC on its bus; exactly one node of a bus does")
    ] = True


def within(settings: BusSettings, namespace: str) -> BusSettings:
    """Return the settings of a bus of the robot in `namespace`: each has its own simulated ones."""
    if settings.interface != RIG:
        return settings
    return settings._replace(channel=f"{namespace}/{settings.channel}".strip("/"))


def open_bus(
    settings: BusSettings, clock: Clock | None = None,
    hub: Callable[[str], can.BusABC] | None = None,
) -> can.BusABC:  # fmt: skip
    """Open the bus described by `settings`.

    clock: of those who use it. Simulated time works with simulated buses only, because stopped time
    would disarm every guard of a real robot. hub: opens the rig's end of a simulated bus, by its
    name (`rig_hub.RigHub`); the caller makes sure that no other process does.

    Raises BusError naming interface and channel, with the way out; ValueError for a value out of
    range.
    """
    validated(settings)
    if clock is not None and clock.simulated and settings.interface not in SIMULATED_INTERFACES:
        raise BusError(
            f"{where(settings)} works by wall clock only: for the simulated robot set "
            f"can.interface to {RIG} and can.channel to the name of a bus such as encoder, for any "
            "other set use_sim_time to false"
        )
    try:
        return _opened(settings, clock, hub)
    except Exception as error:  # each backend raises what its vendor's library does
        raise BusError(_cannot_open(settings, error)) from error


def open_port(settings: BusSettings, clock: Clock | None = None) -> Port:
    """Open the bus described by `settings` and return its `Port`; raises as `open_bus`."""
    # SocketCAN marks what was sent on this computer, by any program; our own frames it keeps back.
    echoes = settings.interface != "socketcan"
    return Port(
        open_bus(settings, clock), settings.sync_producer, where(settings), clock, echoes,
        lambda: open_bus(settings, clock),
    )  # fmt: skip


def where(settings: BusSettings) -> str:
    """Return the name of the bus, unique on this machine, for messages to the user."""
    name = f"{settings.interface} {settings.channel}"
    if settings.interface == RIG:
        return f"{name} in ROS domain {domain_id()}"
    return f"{name}:{settings.port}" if settings.interface == "udp_multicast" else name


def _opened(
    settings: BusSettings, clock: Clock | None, hub: Callable[[str], can.BusABC] | None
) -> can.BusABC:
    interface, channel, fd = settings.interface, settings.channel, settings.fd
    if interface == RIG:
        if settings.port != _UDP_PORT:
            raise ValueError("simulated buses have names (can.channel): remove can.port")
        if hub is not None:
            return hub(channel)
        if clock is not None and channel in clock.buses:
            return clock.buses[channel].join(partial(clock.buses.get, channel))
    if interface == "udp_multicast":
        return MulticastBus(channel=channel, port=settings.port, hop_limit=0, fd=fd)
    simulated = interface in SIMULATED_INTERFACES
    more: dict[str, Any] = {} if simulated else {"bitrate": settings.bitrate, "fd": fd}
    return can.Bus(interface=interface, channel=channel, ignore_config=True, **more)


def _cannot_open(settings: BusSettings, error: BaseException) -> str:
    cause = error.__cause__ or error
    text = f"cannot open CAN bus {where(settings)}: {cause}"
    if settings.interface == RIG:
        return text  # it names the way out
    way_out = "see the python-can manual for the names of interfaces and channels"
    if settings.interface == "socketcan":
        way_out = (
            f"is it there and up? sudo ip link set {settings.channel} up type can "
            f"bitrate {settings.bitrate}"
        )
    elif settings.interface == "udp_multicast":
        way_out = (
            "the channel must be a multicast group such as 239.74.163.2, to which this machine has "
            f"a route; sim_rig's buses are now can.interface: {RIG}, can.channel: their name"
        )
    return f"{text}; {way_out}"


class MulticastBus(UdpMulticastBus):
    """python-can's `udp_multicast` without our own frames, which it returns to their sender.

    They would pass for those of a second master. For each frame sent, the first equal one that
    comes is the echo, so a device's reply that copies our frame is still received. Datagrams that
    are no frames are left out.
    """

    def __init__(self, **kwargs: Any):
        super().__init__(**kwargs)
        self._echoes: deque[tuple[int, bytes]] = deque(maxlen=_MOST_ECHOES)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a frame; raises can.CanOperationError."""
        self._echoes.append((msg.arbitration_id, bytes(msg.data)))
        super().send(msg, timeout)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        while True:
            try:
                message, is_filtered = super()._recv_internal(timeout)
            except can.CanOperationError as error:
                if error.__cause__ is None or isinstance(error.__cause__, OSError):
                    raise
            else:
                if message is None or not self._is_echo(message):
                    return message, is_filtered
            timeout = 0.0

    def _is_echo(self, message: can.Message) -> bool:
        try:
            self._echoes.remove((message.arbitration_id, bytes(message.data)))
        except ValueError:
            return False
        return True
