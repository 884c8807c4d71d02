# SPDX-License-Identifier: Apache-2.0
"""Whether a configured device takes part in the cyclic exchange: one answer to our SYNC."""

from __future__ import annotations

from ..can_io.port import Port
from ..devices.canopen import NMT_PRE_OPERATIONAL, NMT_START, CanopenDevice
from .finding import Finding

_WITHIN_S = 0.1
#: SYNCs beyond one period of its TPDO; the first may come before the device has started.
_SPARE = 2


def answer_to_sync(device: CanopenDevice, name: str, port: Port) -> Finding:
    """Return whether a configured device answers SYNC, in NMT operational for that moment.

    No command and no heartbeat is sent: a drive stays off, and its guards are not armed.
    """
    heard: list[int] = []

    def on_answer(_data: bytes, arrival_ns: int) -> None:
        heard.append(arrival_ns)

    syncs = getattr(device.settings, "sync_divider", 1) + _SPARE
    port.subscribe(device.answer_id, on_answer)
    try:
        device.command_nmt(NMT_START)
        sent = 0
        while not heard and sent < syncs:
            port.send_sync(port.clock.now_ns())
            sent += 1
            port.wait_for(lambda: heard, _WITHIN_S)
        device.command_nmt(NMT_PRE_OPERATIONAL)
    finally:
        port.unsubscribe(device.answer_id, on_answer)
    what = f"{name} answer to SYNC"
    if heard:
        return Finding(what, f"frame 0x{device.answer_id:X}")
    why = f"; its emergency: {device.emergency}" if device.emergency else ""
    return Finding(
        what, f"none to {sent} SYNCs{why}", f"frame 0x{device.answer_id:X}",
        "look at 1005, 1007 and 1019 with the maker's program, or restore its defaults (1011)",
    )  # fmt: skip
