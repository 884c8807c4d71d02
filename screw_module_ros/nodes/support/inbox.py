# SPDX-License-Identifier: Apache-2.0
"""Subscriptions and publishers of the hot loop, outside rclpy's executor.

rclpy's executor spends about 60 us per callback. So the hot loop takes the messages of its
subscriptions directly from a wait set, and the executor ignores them (`HotGroup`).
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from itertools import islice
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from screw_module_ros.clock import Clock
from screw_module_ros.lockstep.wires import Hop, Source

from .wire import Layout

_LOST_NS = 900_000_000  # wall clock after which a published message counts as lost
_SLICE_NS = 20_000_000  # the same, of a publisher that has gone


class HotGroup(CallbackGroup):
    """A callback group that no executor serves: the hot loop takes its messages."""

    def can_execute(self, entity) -> bool:
        """Return False: the executor ignores the entity."""
        return False

    def beginning_execution(self, entity) -> bool:
        """Return False: never executed."""
        return False

    def ending_execution(self, entity) -> None:
        """Do nothing: never executed."""


class Inbox:
    """Subscriptions of the hot loop with one common wait.

    clock: clock of the wait. direct: topics whose content another part of this process passes by
    calls; they have no subscription, and taking from them returns None.
    """

    def __init__(self, node: Node, clock: Clock, direct: Collection[str] = ()):
        self._node = node
        self._clock = clock
        self._direct = direct
        self._group = HotGroup()
        self._subscriptions: list[Subscription] = []
        self._hops: list[Hop] = []
        self._takes: list[tuple[Callable[[], Any], int]] = []
        self._waking: list[Any] = []
        self._wakers: list[Hop] = []
        self._wait_set: Any = None

    def subscribe(
        self, kind: type | Layout, topic: str, qos: QoSProfile, wakes: bool = False
    ) -> Callable[[], Any]:
        """Subscribe; return a function that takes the next message, or a record of a `Layout`.

        It returns None when there is none. Its `arrived_ns`, if it has one, is when the last one
        came: it may have waited in the queue for long (`Newest`).

        `wakes`: `wait` returns when this subscription has a message. In simulated time the other
        subscriptions return only messages published before the present time: a message published on
        a tick arrives on the next tick, independent of the speed of the processes.
        """
        if topic in self._direct:
            return _nothing
        take = self._subscribed(kind, topic, qos, wakes)
        self._takes.append((take, qos.depth))
        return take

    def _subscribed(
        self, kind: type | Layout, topic: str, qos: QoSProfile, wakes: bool
    ) -> Callable[[], Any]:
        message_type = kind.kind if isinstance(kind, Layout) else kind
        subscription = self._node.create_subscription(
            message_type, topic, never, qos, callback_group=self._group
        )
        self._subscriptions.append(subscription)
        handle = subscription.handle
        if wakes:
            self._waking.append(handle)
        take_one = _taker(handle, kind)
        if self._clock.simulated:
            hop = self._clock.hop(subscription.topic_name)
            self._hops.append(hop)
            if not wakes:
                return _Settled(self, take_one, handle, hop, qos.depth == 1)
            self._wakers.append(hop)
            return lambda: self._take_counted(take_one, handle, hop, qos.depth == 1)

        return _Received(take_one, self._clock)

    def _take_counted(self, take: Callable, handle: Any, hop: Hop, only_newest: bool) -> Any:
        """Take a message; wait for one that is published and still in transit."""
        newest = None
        while True:
            taken = self.take_one(take, handle, hop, hop.pending)
            if taken is None:
                return newest
            newest = taken
            if not (only_newest and hop.pending()):
                return newest

    def take_one(
        self, take: Callable, handle: Any, hop: Hop, is_due: Callable[[], bool]
    ) -> Any:
        """Take one message, None without one; is_due: it is published and must arrive."""
        taken = take()
        if taken is None and is_due():
            taken = awaited(self._node, take, handle, hop)
        if taken is None:
            return None
        hop.taken(taken[1]["publication_sequence_number"] or 0)
        return taken[0]

    def discard(self) -> None:
        """Drop what has come so far."""
        for take, depth in self._takes:
            for _ in islice(iter(take, None), depth + 1):  # one may have been held back
                pass

    def now_ns(self) -> int:
        """Return the time of the inbox's clock [ns]."""
        return self._clock.now_ns()

    def wait(self, until_ns: int) -> bool:
        """Wait for a message of a waking subscription, until `until_ns` at most.

        In simulated time return False when `until_ns` came first, unless a message may have arrived
        that does not hold time: from a publisher that is not counted, or of a topic that this end
        does not follow yet.
        """
        if self._clock.simulated:
            self._clock.member.wait(until_ns, hops=self._wakers)
            in_time = self._clock.now_ns() < until_ns
            return in_time or not any(hop.pending() for hop in self._wakers)
        if self._wait_set is None:
            self._wait_set = _new_wait_set(self._node, len(self._waking))
        wait_set = self._wait_set
        wait_set.clear_entities()
        for handle in self._waking:
            wait_set.add_subscription(handle)
        wait_set.wait(max(0, until_ns - self._clock.now_ns()))
        return True  # a message may have come: a late wake-up must not leave it for the next tick

    def close(self) -> None:
        """Destroy the subscriptions."""
        self._wait_set, self._waking = None, []
        for hop in self._hops:
            hop.close()
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        self._subscriptions, self._hops, self._takes, self._wakers = [], [], [], []


def awaited(node: Node, take: Callable[[], Any], handle: Any, hop: Hop) -> Any:
    """Take a published message that is still in transit; None if it is lost.

    It arrives within a moment, or it is lost: then time does not wait for this end until the next
    one has come. take: takes a message of `handle`, a subscription of `node`; hop: its count.
    """
    _await_message(node, handle, hop)
    taken = take()
    if taken is None:
        hop.let_go()
    return taken


def _await_message(node: Node, handle: Any, hop: Hop) -> None:
    """Wait until a message is there, or has had its time to arrive.

    The middleware drops what a process that ends has sent and nobody has taken yet; waiting for it
    held the time of all others.
    """
    wait_set = _new_wait_set(node, 1)
    for _ in range(_LOST_NS // _SLICE_NS):
        is_last = hop.is_orphaned  # asked before the wait, in which its last message may come
        wait_set.clear_entities()
        wait_set.add_subscription(handle)
        wait_set.wait(_SLICE_NS)
        if is_last or wait_set.get_ready_entities("subscription"):
            return


def _new_wait_set(node: Node, subscriptions: int) -> Any:
    context = node.context
    with context.handle:
        return _rclpy.WaitSet(subscriptions, 0, 0, 0, 0, 0, context.handle)


class _Received:
    """A subscription by wall clock."""

    def __init__(self, take: Callable, clock: Clock):
        self._take, self._clock = take, clock
        self._stamp_ns = 0

    def __call__(self) -> Any:
        """Return the next message, None without one."""
        taken = self._take()
        if taken is None:
            return None
        self._stamp_ns = taken[1]["received_timestamp"]
        return taken[0]

    @property
    def arrived_ns(self) -> int:
        """Time at which the middleware received the message returned last [ns].

        It stamps with the system clock. One that is set meanwhile makes a message older, never
        newer than it is taken.
        """
        waited_ns = self._clock.stamp_ns() - self._stamp_ns
        return self._clock.now_ns() - max(0, waited_ns)


class _Settled:
    """A subscription that holds messages of the present tick back until the next one.

    arrived_ns: time at which the message returned last had come; a reader that looks rarely gets
    one that was held back for long.
    """

    def __init__(
        self, inbox: Inbox, take: Callable, handle: Any, hop: Hop, only_newest: bool
    ):
        self._inbox, self._hop, self._only_newest = inbox, hop, only_newest
        self._from = (take, handle, hop, hop.unsettled)
        self._early: tuple[int, Any] | None = None
        self.arrived_ns = 0

    def __call__(self) -> Any:
        """Return the next message, or the newest with `only_newest`; None without one."""
        found = self._kept()
        while found is None or self._only_newest:
            if self._early is not None:
                break
            message = self._inbox.take_one(*self._from)
            if message is None:
                break
            if self._hop.is_new():
                self._early = (self._inbox.now_ns(), message)
            else:
                found, self.arrived_ns = message, self._inbox.now_ns()
        return found

    def _kept(self) -> Any:
        if self._early is None or self._early[0] == self._inbox.now_ns():
            return None
        (self.arrived_ns, message), self._early = self._early, None
        return message


class Outlet:
    """A publisher of the hot loop; in simulated time its messages are counted.

    publish: takes a message; a raw outlet takes serialized bytes.
    """

    def __init__(
        self, node: Node, clock: Clock, kind: type, topic: str, qos: QoSProfile, raw: bool = False
    ):
        self._node = node
        self._publisher = node.create_publisher(kind, topic, qos)
        handle = self._publisher.handle
        self._send = handle.publish_raw if raw else handle.publish
        self._source: Source | None = None
        self.publish = self._send
        if clock.simulated:
            self._source = clock.source(self._publisher.topic_name)
            self.publish = self._publish_counted

    def _publish_counted(self, message: Any) -> None:
        self._source.publishing()
        self._send(message)
        self._source.published()

    def close(self) -> None:
        """Destroy the publisher."""
        if self._source is not None:
            self._source.close()
        self._node.destroy_publisher(self._publisher)


def _taker(handle: Any, kind: type | Layout) -> Callable[[], Any]:
    """Return a function that takes a message, or a record, with the middleware's info on it."""
    take_message = handle.take_message
    if not isinstance(kind, Layout):
        return lambda: take_message(kind, False)
    message_type, unpack = kind

    def take() -> Any:
        taken = take_message(message_type, True)
        return taken if taken is None else (unpack(taken[0]), taken[1])

    return take


def _nothing() -> None:
    return None


def never(message: Any) -> None:
    """Callback of a subscription that its owner polls."""
    raise AssertionError("a polled subscription is never served by the executor")


def fill_stamp(message: Any, stamp_ns: int) -> None:
    """Write `stamp_ns` (ns since the epoch) into the flat message's stamp."""
    message.stamp.sec, message.stamp.nanosec = divmod(stamp_ns, 1_000_000_000)
