# SPDX-License-Identifier: Apache-2.0
"""Opens one CAN bus through python-can on any interface (parameters `can.*`).

`udp_multicast` connects processes of one machine: the hop limit is 0, so no frame leaves it. The
receive buffer is enlarged, because bursts overflow the default one, and the socket receives its own
group only. `virtual` works inside one process only (tests). Every other interface is hardware.
"""

from __future__ import annotations

import errno
import os
import socket
from typing import Annotated, NamedTuple

import can
from can.interfaces.udp_multicast import UdpMulticastBus

from ..clock import Clock
from ..settings import Setting, validated
from .port import BusError, Port
from .udp_bus import LeanUdpBus

__all__ = ["BusSettings", "Port", "open_bus", "open_port"]

SIMULATED_INTERFACES = ("virtual", "udp_multicast")
MULTICAST_ROUTE = "sudo ip route add 239.0.0.0/8 dev lo"
"""What a machine without any network lacks."""
RECEIVE_BUFFER_BYTES = 4 * 1024 * 1024
_BITRATES = (10_000, 20_000, 50_000, 125_000, 250_000, 500_000, 800_000, 1_000_000)
# Linux numbers that the socket module does not name.
_SO_RCVBUFFORCE = 33
_IP_MULTICAST_ALL = 49


class BusSettings(NamedTuple):
    """One CAN bus and this process's role on it; the same names in every driver node."""

    interface: Annotated[
        str, Setting("python-can interface: udp_multicast, socketcan, virtual, pcan, ...")
    ] = "udp_multicast"
    channel: Annotated[
        str, Setting("channel of the interface, like can0, or the multicast group")
    ] = "239.74.163.2"
    port: Annotated[int, Setting("UDP port (udp_multicast only)", "", 1, 65535)] = 43113
    bitrate: Annotated[int, Setting("bit rate of the bus", "bit/s", choices=_BITRATES)] = 1_000_000
    fd: Annotated[bool, Setting("the bus also carries CAN FD frames; ours are classical")] = False
    sync_producer: Annotated[
        bool, Setting("this node sends SYNC on its bus; exactly one node of a bus does")
    ] = True


def open_bus(settings: BusSettings) -> can.BusABC:
    """Open the bus described by `settings`.

    Raises BusError naming interface and channel, with the way out; ValueError for a value out of
    range.
    """
    validated(settings)
    try:
        bus = _opened(settings)
    except Exception as error:  # each backend raises what its vendor's library does
        raise BusError(_cannot_open(settings, error)) from error
    if settings.interface == "udp_multicast":
        _tune_multicast(bus)
    return bus


def open_port(settings: BusSettings, clock: Clock | None = None) -> Port:
    """Open the bus described by `settings` and return its `Port`; raises as `open_bus`.

    Simulated time works with simulated buses only, because stopped time would disarm every guard of
    a real robot. With any other bus it raises BusError.
    """
    if clock is not None and clock.simulated and settings.interface not in SIMULATED_INTERFACES:
        raise BusError(
            f"{where(settings)} is no simulated bus: set use_sim_time to false for this node, or "
            f"can.interface to one of {', '.join(SIMULATED_INTERFACES)}"
        )
    return Port(open_bus(settings), settings.sync_producer, where(settings), clock)


def where(settings: BusSettings) -> str:
    """Return the name of the bus for messages to the user."""
    tail = f":{settings.port}" if settings.interface == "udp_multicast" else ""
    return f"{settings.interface} {settings.channel}{tail}"


def _opened(settings: BusSettings) -> can.BusABC:
    interface, channel, fd = settings.interface, settings.channel, settings.fd
    if interface == "udp_multicast":
        lean = not fd and ":" not in channel  # classical frames, IPv4
        kind = LeanUdpBus if lean else UdpMulticastBus
        return kind(channel=channel, port=settings.port, hop_limit=0, fd=fd)
    more = {} if interface == "virtual" else {"bitrate": settings.bitrate, "fd": fd}
    return can.Bus(interface=interface, channel=channel, ignore_config=True, **more)


def _tune_multicast(bus: can.BusABC) -> None:
    """Enlarge the receive buffer and receive only our own group; both are best effort."""
    # A duplicate descriptor reaches the socket without touching python-can's private fields.
    with socket.socket(fileno=os.dup(bus.fileno())) as duplicate:
        for level, option, value in (
            (socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES),
            (socket.SOL_SOCKET, _SO_RCVBUFFORCE, RECEIVE_BUFFER_BYTES),
            (socket.IPPROTO_IP, _IP_MULTICAST_ALL, 0),
        ):
            try:
                duplicate.setsockopt(level, option, value)
            except OSError:
                continue


def _cannot_open(settings: BusSettings, error: BaseException) -> str:
    cause = error.__cause__ or error
    way_out = "see the python-can manual for the names of interfaces and channels"
    if settings.interface == "socketcan":
        way_out = (
            f"is it there and up? sudo ip link set {settings.channel} up type can "
            f"bitrate {settings.bitrate}"
        )
    elif getattr(cause, "errno", None) == errno.EADDRINUSE:
        way_out = (
            "another program's socket has this UDP port: start again, or give sim_rig and the "
            "nodes other ports (bringup --first-port)"
        )
    elif settings.interface == "udp_multicast":
        way_out = (
            "the channel must be a multicast group such as 239.74.163.2 and the machine needs a "
            f"route to it, if need be: {MULTICAST_ROUTE}"
        )
    return f"cannot open CAN bus {where(settings)}: {cause}; {way_out}"
