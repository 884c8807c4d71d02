# SPDX-License-Identifier: Apache-2.0
"""Subscriptions and publishers of the hot loop, outside rclpy's executor.

rclpy's executor spends about 60 us per callback. So the hot loop takes the messages of its
subscriptions directly from a wait set, and the executor ignores them (`HotGroup`).
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from functools import partial
from typing import TYPE_CHECKING, Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile

from screw_module_ros.clock import Clock, WallClock
from screw_module_ros.lockstep.clock import SimulatedClock
from screw_module_ros.lockstep.end import End

from .wire import Layout

if TYPE_CHECKING:  # a process of one node has no topics within it
    from .local_topics import LocalSubscription, LocalTopics

_WALL = WallClock()
_LOST_NS = 900_000_000  # wall clock after which a published message counts as lost
_SLICE_NS = 20_000_000  # the same, of a publisher that has gone


class HotGroup(ReentrantCallbackGroup):
    """A callback group that no executor serves: the hot loop takes its messages."""

    def can_execute(self, entity: Any) -> bool:
        """Return False: the executor ignores the entity."""
        return False


class Inbox:
    """Subscriptions of the hot loop with one common wait.

    clock: clock of the wait. direct: topics whose content another part of this process passes by
    calls; they have no subscription, and taking from them returns None. local: topics that pass
    within this process.
    """

    def __init__(
        self, node: Node, clock: Clock, direct: Collection[str] = (),
        local: LocalTopics | None = None,
    ):  # fmt: skip
        self._node, self._clock, self._direct, self._local = node, clock, direct, local
        self._group = HotGroup()
        self._all: list[Subscription | LocalSubscription] = []
        self._waking: list[Any] = []
        self._wait_set: Any = None

    def subscribe(
        self, kind: type | Layout, topic: str, qos: QoSProfile, wakes: bool = False
    ) -> Callable[..., Any]:
        """Subscribe; return a `Subscription`, to be called for the next message.

        wakes: `wait` returns when this subscription has a message.
        """
        if topic in self._direct:
            return _nothing
        made = self._subscription(kind, topic, qos, wakes)
        self._all.append(made)
        if wakes:
            self._waking.append(made)
        return made

    def _subscription(
        self, kind: type | Layout, topic: str, qos: QoSProfile, wakes: bool
    ) -> Subscription | LocalSubscription:
        clock = self._clock
        if self._local is None or not self._local.carries(topic):
            return Subscription(self._node, clock, self._group, kind, topic, qos, wakes)
        assert isinstance(clock, SimulatedClock), "loops of one thread have no other clock"
        name = self._node.resolve_topic_name(topic)
        return self._local.subscribe(name, kind, qos.depth, wakes, clock)

    def discard(self) -> None:
        """Drop what has come so far."""
        for subscription in self._all:
            subscription.discard()

    def wait(self, until_ns: int) -> None:
        """Wait for a message of a waking subscription, until `until_ns` at most."""
        if isinstance(self._clock, SimulatedClock):
            if not any(one.has_kept for one in self._waking):
                ends = [one.end for one in self._waking if one.end is not None]
                self._clock.member.wait(until_ns, ends)
            return
        if self._wait_set is None:
            self._wait_set = new_wait_set(self._node, len(self._waking))
        wait_set = self._wait_set
        wait_set.clear_entities()
        for one in self._waking:
            wait_set.add_subscription(one.handle)
        wait_set.wait(max(0, until_ns - self._clock.now_ns()))

    def close(self) -> None:
        """Destroy the subscriptions."""
        for subscription in self._all:
            subscription.close()
        self._all, self._waking, self._wait_set = [], [], None


class Subscription:
    """One subscription of a hot loop; a call returns its next message, None without one.

    Of a queue of one it returns the newest. A `Layout` gives records in place of messages. In
    simulated time a message published on a tick arrives on the next tick, independent of the speed
    of the processes, unless this subscription wakes its loop.
    """

    def __init__(
        self, node: Node, clock: Clock, group: HotGroup, kind: type | Layout, topic: str,
        qos: QoSProfile, wakes: bool,
    ):
        self._node, self._clock, self._wakes = node, clock, wakes
        self._depth = qos.depth
        self._wait_set: Any = None
        if clock.simulated:
            # One more place: a message of this tick must not push out that of the last one.
            qos = QoSProfile(
                history=qos.history, depth=qos.depth + 1, reliability=qos.reliability,
                durability=qos.durability,
            )  # fmt: skip
        message_type = kind.kind if isinstance(kind, Layout) else kind
        self._subscription = node.create_subscription(
            message_type, topic, never, qos, callback_group=group
        )
        self.handle = self._subscription.handle
        self._take = _taker(self.handle, kind)
        self.end: End | None = None
        if isinstance(clock, SimulatedClock):
            self.end = clock.subscription(self._subscription.topic_name)
        self._kept: tuple[int, Any] | None = None
        self._arrived_ns = self._stamp_ns = 0

    def __call__(self, early: bool | None = None) -> Any:
        """Return the next message.

        early: in simulated time also one that was published at the present time; None: if this
        subscription wakes its loop.
        """
        end = self.end
        if end is None:
            return self._received()
        early = self._wakes if early is None else early
        found = None if self._kept is None else self._released(self._kept, early)
        while self._kept is None and (found is None or self._depth == 1):
            message = self._taken(end, early)
            if message is None:
                break
            if end.is_early and not early:
                self._kept = (self._clock.now_ns(), message)
            else:
                found, self._arrived_ns = message, self._clock.now_ns()
        return found

    @property
    def has_kept(self) -> bool:
        """Whether a message was kept for a later time."""
        return self._kept is not None

    @property
    def arrived_ns(self) -> int:
        """Time at which the message returned last came [ns]; it may have waited for long.

        By wall clock the middleware stamps with the system clock. One that is set meanwhile makes a
        message older, never newer than it is taken.
        """
        if self.end is not None:
            return self._arrived_ns
        waited_ns = self._clock.stamp_ns() - self._stamp_ns
        return self._clock.now_ns() - max(0, waited_ns)

    def discard(self) -> None:
        """Drop what has come so far."""
        for _ in range(self._depth + 2):  # one more place, and one that was kept
            if self(early=True) is None:
                return

    def close(self) -> None:
        """Destroy it."""
        if self.end is not None:
            self.end.close()
        self._node.destroy_subscription(self._subscription)

    def _received(self) -> Any:
        taken = self._take()
        if taken is None:
            return None
        self._stamp_ns = taken[1]["received_timestamp"]
        return taken[0]

    def _released(self, kept: tuple[int, Any], early: bool) -> Any:
        if kept[0] == self._clock.now_ns() and not early:
            return None
        self._kept = None
        self._arrived_ns, message = kept
        return message

    def _taken(self, end: End, early: bool) -> Any:
        """Take one message; wait for one that must arrive."""
        taken = self._take()
        if taken is None and (end.pending if early else end.unsettled):
            self._wait_set = self._wait_set or new_wait_set(self._node, 1)
            taken = awaited(self._wait_set, self._take, self.handle, end)
        if taken is None:
            return None
        end.take(taken[1]["publication_sequence_number"] or 0)
        return taken[0]


def awaited(wait_set: Any, take: Callable[[], Any], handle: Any, end: End) -> Any:
    """Take a published message that is still in transit; None if it is lost.

    It arrives within a moment, or it is lost: then time does not wait for this end until the next
    one has come. wait_set: with one place; take: takes a message of `handle`, a subscription; end:
    its count.
    """
    _await_message(wait_set, handle, end)
    taken = take()
    if taken is None:
        end.stop_following()
    return taken


def _await_message(wait_set: Any, handle: Any, end: End) -> None:
    """Wait until a message is there, or has had its time to arrive.

    The middleware drops what a process that ends has sent and nobody has taken yet; waiting for it
    held the time of all others.
    """
    end_ns = _WALL.now_ns() + _LOST_NS
    while True:
        is_last = end.is_orphaned  # asked before the wait, in which its last message may come
        wait_set.clear_entities()
        wait_set.add_subscription(handle)
        wait_set.wait(_SLICE_NS)
        ready = wait_set.get_ready_entities("subscription")
        if ready or is_last or _WALL.now_ns() >= end_ns:
            return


def new_wait_set(node: Node, subscriptions: int) -> Any:
    """Return a wait set of the middleware with so many places for subscriptions of a node."""
    context: Any = node.context.handle
    with context:
        return _rclpy.WaitSet(subscriptions, 0, 0, 0, 0, 0, context)


class Outlet:
    """A publisher of the hot loop; in simulated time its messages are counted.

    publish: takes a message; a raw outlet takes serialized bytes.
    """

    def __init__(
        self, node: Node, clock: Clock, kind: type, topic: str, qos: QoSProfile, raw: bool = False,
        local: LocalTopics | None = None,
    ):  # fmt: skip
        self._node = node
        self._publisher = node.create_publisher(kind, topic, qos)
        handle = self._publisher.handle
        self.publish = handle.publish_raw if raw else handle.publish
        self._end: End | None = None
        if not isinstance(clock, SimulatedClock):
            return
        name = self._publisher.topic_name
        self._end = clock.publisher(name)
        self.publish = self._end.counted(self.publish)
        if local is not None and local.carries(topic):
            self.publish = local.publishing(name, kind, raw, handle, self._end)

    @property
    def heard(self) -> bool:
        """Whether all subscriptions of the topic that are known to the node get its messages."""
        known = self._node.count_subscribers(self._publisher.topic_name)
        return 0 < known <= self._publisher.get_subscription_count()

    def close(self) -> None:
        """Destroy the publisher."""
        if self._end is not None:
            self._end.close()
        self._node.destroy_publisher(self._publisher)


def _taker(handle: Any, kind: type | Layout) -> Callable[[], Any]:
    """Return a function that takes a message, or a record, with the middleware's info on it."""
    take_message = handle.take_message
    if not isinstance(kind, Layout):
        return partial(take_message, kind, False)
    message_type, unpack = kind

    def take() -> Any:
        taken = take_message(message_type, True)
        return taken if taken is None else (unpack(taken[0]), taken[1])

    return take


def _nothing(early: bool | None = None) -> None:
    return None


def never(message: Any) -> None:
    """Callback of a subscription that its owner polls."""
    raise AssertionError("a polled subscription is never served by the executor")


def fill_stamp(message: Any, stamp_ns: int) -> None:
    """Write `stamp_ns` (ns since the epoch) into the flat message's stamp."""
    stamp = message.stamp
    stamp.sec, stamp.nanosec = divmod(stamp_ns, 1_000_000_000)
