# SPDX-License-Identifier: Apache-2.0
"""What reaches both laws alike from outside: slots of a therapy session, and a new impedance."""

from __future__ import annotations

from screw_module_msgs.msg import TherapySlot
from screw_module_msgs.srv import SetImpedance

from screw_module_ros.control.slot import Slot
from screw_module_ros.graph import THERAPY_SLOT
from screw_module_ros.loop.inputs import Guide

from .answering import Done
from .inbox import Inbox
from .parameters import Parameters
from .topics import requested


def set_impedance(parameters: Parameters, kind: type, request: SetImpedance.Request) -> str:
    """Carry out a request to change the impedance of the law with settings `kind`."""
    refused = parameters.write(stiffness=request.stiffness, damping=request.damping)
    law = parameters.read(kind)
    return refused or Done(f"stiffness {law.stiffness:g} N/m, damping {law.damping:g} Ns/m")


class SlotInbox:
    """Subscribes `therapy/slot` for a hot loop. vertical: the axis is z, else x and y.

    take: returns the next message. refused: problem of the newest slot, empty without one.
    """

    def __init__(self, inbox: Inbox, vertical: bool):
        self.refused = ""
        self._vertical = vertical
        self.take = inbox.subscribe(*requested(THERAPY_SLOT))

    def read(self, guide: Guide, now_ns: int) -> TherapySlot | None:
        """Pass a new slot to the guide, and return its message, None without.

        An invalid slot counts as none. now_ns [ns].
        """
        message = self.take()
        if message is None:
            return None
        try:
            guide.ask(*slot_of(message, self._vertical), now_ns)
            self.refused = ""
        except ValueError as error:
            self.refused = f"{THERAPY_SLOT}: {error}"
        return message


def slot_of(message: TherapySlot, vertical: bool) -> tuple[Slot | None, int]:
    """Return the message's slot for one group of axes, None for none, and its start [ns].

    Axes that are held have a slot without length, which is always open.
    """
    start, target = message.start, message.target
    line: tuple[float, float, float, float] = (
        (start.z, 0.0, target.z, 0.0) if vertical else (start.x, start.y, target.x, target.y)
    )
    if message.vertical if vertical else message.planar:
        slot = Slot(
            *line,
            message.duration,
            message.back_stiffness,
            message.side_stiffness,
            message.damping,
            message.half_width,
            message.end_half_width,
            message.growth,
        )
        return slot, message.start_ns
    if message.held[vertical]:
        point = Slot(
            *line[:2], *line[:2], side_stiffness=message.hold_stiffness, damping=message.damping,
            half_width=0.0, end_half_width=0.0, growth=0.0,
        )  # fmt: skip
        return point, 0
    return None, 0
