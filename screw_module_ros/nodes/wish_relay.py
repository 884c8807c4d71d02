# SPDX-License-Identifier: Apache-2.0
"""Passes games' set points from `therapy/wish` to `setpoint`, within the therapist's limits."""

from __future__ import annotations

import math

from screw_module_msgs.msg import EndpointSetpoint

from screw_module_ros import graph
from screw_module_ros.therapy.hand import Point
from screw_module_ros.therapy.wishes import SILENT_NS, WishGate, WishLimits

from .support.inbox import Inbox
from .support.node import Node
from .support.states import at_base
from .support.topics import offered, requested

_NOWHERE: Point = (math.nan,) * 3


class WishRelay:
    """Subscribes to wishes and publishes set points for the hot loop of a node."""

    def __init__(self, node: Node, inbox: Inbox, limits: WishLimits):
        self._node = node
        self._take = inbox.subscribe(*requested(graph.THERAPY_WISH))
        self._publish = node.outlet(*offered(graph.SETPOINT))
        self._message = at_base(EndpointSetpoint)
        self._gate = WishGate(limits)
        self._ends_ns: int | None = None  # when set points of before a session are forgotten

    def limit(self, limits: WishLimits) -> None:
        """Use new limits from the next wish on."""
        self._gate.limits = limits

    def begin(self, limits: WishLimits, hand: Point | None, now_ns: int) -> None:
        """End what a game or anybody asked for, and use new limits: a session begins.

        hand: its position [m], at which it is let go: a session may guide the plane alone, and the
        vertical spring would stay. None: not yet, which is nowhere as set point; that stops the
        last one where it is, and it still pulls. After a second it is nowhere anyway, or each pause
        of the session would pull back there.
        """
        self._gate.limits = limits
        self.ask_for(hand or _NOWHERE)
        self._ends_ns = now_ns + SILENT_NS

    def relay(self, allowed: bool, hand: Point | None, now_ns: int) -> None:
        """Pass on the newest wish, if any; release the hand when a game is silent or cut off.

        allowed: whether a game may pull now. hand: its position [m], None if unknown: it is
        released as soon as it is known, as NaN would leave the spring where it is. now_ns [ns].
        """
        message = self._take()
        if allowed and message is not None:
            wish = (message.position.x, message.position.y, message.position.z)
            self.ask_for(self._gate.passed(wish, hand or _NOWHERE, now_ns))
        elif hand is not None:
            let_go = self._gate.released(hand, now_ns) if allowed else self._gate.cut_off(hand)
            if let_go is not None:
                self.ask_for(let_go)
            elif self._ends_ns is not None and now_ns >= self._ends_ns:
                self._ends_ns = None
                self.ask_for(_NOWHERE)

    def ask_for(self, point: Point) -> None:
        """Move the set point [m]; NaN leaves an axis alone."""
        position = self._message.position
        position.x, position.y, position.z = point
        self._node.stamp(self._message.header)
        self._publish(self._message)
