# SPDX-License-Identifier: Apache-2.0
"""Subscriptions of the controller: samples, set point, drive and supervisor."""

from __future__ import annotations

from screw_module_ros import graph
from screw_module_ros.loop.controller import VerticalController
from screw_module_ros.samples import EncoderReading, ForceReading

from .support.inbox import Inbox
from .support.topics import Newest, SlotInbox, requested

_SAFETY_AGE_NS = 200_000_000


class ControllerInputs:
    """The controller's subscriptions, for the loop's thread; times in [ns].

    inbox: wakes on an encoder sample; forces: wakes on a force sample. slot: that of a therapy
    session.
    """

    def __init__(self, inbox: Inbox, forces: Inbox):
        self._inbox, self._forces = inbox, forces
        take = inbox.subscribe
        self._take_encoder = take(*requested(graph.ENCODER), wakes=True)
        self._take_force = forces.subscribe(*requested(graph.FORCE), wakes=True)
        self._take_setpoint = take(*requested(graph.SETPOINT))
        self.slot = SlotInbox(inbox, vertical=True)
        self._take_amplifier = take(*requested(graph.AMPLIFIER_STATE))
        self._safety = Newest(take(*requested(graph.SAFETY_STATE)), _SAFETY_AGE_NS)
        self._resets: int | None = None

    def next_sample(self, until_ns: int) -> EncoderReading | None:
        """Return the newest encoder sample; wait for it until `until_ns` at most."""
        self._inbox.wait(until_ns)
        return self._take_encoder()

    def next_force(self, until_ns: int) -> ForceReading | None:
        """Return the newest force sample; wait for it until `until_ns` at most, 0 = no wait."""
        if until_ns:
            self._forces.wait(until_ns)
        return self._take_force()

    def read(self, controller: VerticalController, now_ns: int) -> None:
        """Pass set point, slot and amplifier state to the controller, if they come by a topic."""
        self.slot.read(controller.guide, now_ns)
        wanted = self._take_setpoint()
        if wanted is not None:
            controller.wanted.ask((wanted.position.z,), (wanted.velocity.z,), now_ns)
        state = self._take_amplifier()
        if state is not None:
            controller.on_drive(state.enabled, state.position, now_ns)

    def restart(self) -> None:
        """Drop the supervisor's count of resets."""
        self._resets = None

    def follow_supervisor(self, controller: VerticalController, now_ns: int) -> None:
        """Clear the fault when the supervisor's count of resets rises; it restarts from 0."""
        safety = self._safety.fresh(now_ns)
        if safety is None:
            return
        if self._resets is not None and safety.resets > self._resets:
            controller.reset(now_ns)
        self._resets = safety.resets
