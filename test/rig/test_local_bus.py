# SPDX-License-Identifier: Apache-2.0
"""A bus within the rig's process: its end, the adapter's; the frames are in `test_rig_bus`."""

from __future__ import annotations

import can
import pytest

from screw_module_ros.rig.local_bus import LocalHub


@pytest.fixture
def hub():
    made = LocalHub("bus")
    yield made
    made.shutdown()


def test_plain_frames_reach_the_rig_and_every_other_member(hub):
    sender, one, other = (hub.join() for _ in range(3))
    sender.send_frame(0x80, b"\x01")
    hub.send_frame(0x81, b"")
    other.shutdown()
    hub.send_frame(0x82, b"")
    assert list(hub.queue) == [(0x80, b"\x01")]
    assert list(sender.queue) == [(0x81, b""), (0x82, b"")], "nobody receives his own frames"
    assert list(one.queue) == [(0x80, b"\x01"), *sender.queue]
    assert list(other.queue) == list(one.queue)[:2]
    for member in (sender, one):
        member.shutdown()


def test_an_adapter_that_was_unplugged_is_back_for_who_opens_it_anew(hub):
    """A member hears what came before, and is dead from then on, also when it is plugged in."""
    member = hub.join(lambda: hub)
    hub.send_frame(0x81, b"before")
    hub.plug(False)
    assert member.receive_frame(0.0) == (0x81, b"before")
    with pytest.raises(can.CanOperationError, match="acknowledge"):
        hub.send_frame(0x81, b"nobody is there")
    with pytest.raises(can.CanInitializationError, match="Network is down"):
        hub.join()
    hub.plug(True)
    for use in (lambda: member.send_frame(0x80, b""), lambda: member.receive_frame(0.0)) * 2:
        with pytest.raises(can.CanOperationError, match="Network is down"):
            use()
    member.shutdown()
    with hub.join() as anew:
        hub.send_frame(0x81, b"after")
        assert list(anew.queue) == [(0x81, b"after")]


def test_a_member_joins_again_when_the_rig_is_back(hub):
    """Its user is told of the error both ways, and goes on as with an adapter that is back."""
    hubs = [None]
    member = hub.join(lambda: hubs[0])
    hub.send_frame(0x81, b"")
    hub.shutdown()
    assert member.receive_frame(0.0) == (0x81, b""), "sent before the end"
    for use in (lambda: member.send_frame(0x80, b""), lambda: member.receive_frame(0.0)) * 2:
        with pytest.raises(can.CanOperationError, match="sim_rig has ended"):
            use()
    hubs[0] = again = LocalHub("bus")
    assert member.receive_frame(0.0) is None
    member.send_frame(0x80, b"")
    again.send_frame(0x82, b"")
    assert (again.queue.pop(), member.receive_frame(0.0)) == ((0x80, b""), (0x82, b""))
    member.shutdown()
    again.shutdown()
