# SPDX-License-Identifier: Apache-2.0
"""The supervisor in this process: sensors with an error, and what outlives it.

Ended and made again, what was stopped is stopped.
"""

from __future__ import annotations

import os
import shutil
from types import SimpleNamespace

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from screw_module_msgs.msg import ForceSample
from std_srvs.srv import SetBool, Trigger

from screw_module_ros.nodes.supervisor import SupervisorNode
from screw_module_ros.nodes.support import runtime
from screw_module_ros.nodes.support.place import SavedState
from screw_module_ros.safety.supervision import (
    ALL_NODES,
    EARLIER,
    OK,
    STOPPED,
    WAITING,
    Decision,
)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path / "state"


class Publisher:
    """Notes what is published, and whether the lock was held."""

    def __init__(self, node):
        self.node, self.told, self.held = node, [], []

    def publish(self, message):
        self.held.append(self.node._changing.locked())
        self.told.append((message.estopped, message.vertical_locked, list(message.reasons)))


@pytest.fixture
def supervisor(make_node):
    """Return a maker of supervisors; each stands for a process that ended without a farewell."""
    made = []

    def make():
        node = SupervisorNode() if made else make_node("supervisor")
        made.append(node)
        node.trigger_configure()
        node._publisher = Publisher(node)
        node._send = node._publisher.publish
        node.trigger_activate()
        return node

    yield make
    for node in made[1:]:
        node.destroy_node()


@pytest.fixture
def lives(monkeypatch):
    """Return what lives a node's life as its process does, with a loop; True: it served until then.

    Without what changes this whole process: its scheduling, and the timer that ends it.
    """
    monkeypatch.setattr(runtime, "prepare", lambda settings: [])
    quiet = SimpleNamespace(arm=lambda: None, disarm=lambda: None)
    monkeypatch.setattr(runtime, "LastResort", lambda code: quiet)
    return lambda node, loop: runtime._live([node], loop)


SILENT = "manus: no message for more than 0.2 s"


def fails(*_):
    raise ZeroDivisionError


def lock(node, locked):
    return node._lock(SetBool.Request(data=locked))


def estop(node):
    return node._estop(Trigger.Request())


def reset(node):
    return node._reset(Trigger.Request())


def test_estop_lock_and_latched_stop_outlive_the_process(supervisor):
    node = supervisor()
    estop(node)
    lock(node, True)
    node._state = node._state._replace(latched=("encoder: no message for more than 0.2 s",))
    node._publish(1)

    node = supervisor()
    node._publish(1)
    estopped, locked, reasons = node._publisher.told[-1]
    assert estopped and locked
    assert reasons[:2] == [
        "emergency stop",
        "before the supervisor was started anew: encoder: no message for more than 0.2 s",
    ]
    assert reset(node) == ""

    node = supervisor()
    node._publish(1)
    assert node._publisher.told[-1][:2] == (False, True), "a reset does not unlock"
    lock(node, False)
    assert not node._kept.path.exists()


@pytest.mark.parametrize("end", ["in order", "loop", "requests", "cleanup"])
def test_only_an_orderly_end_forgets_what_was_latched(supervisor, lives, end):
    """Emergency stop and lock alone outlive one; a cleanup is no end, nor is an error."""
    node = supervisor()
    estop(node)
    node._state = node._state._replace(latched=(SILENT,))
    node._publish(1)
    if end == "in order":
        assert lives(node, lambda nodes: node.stopping.set())
    elif end == "requests":
        node.periodic.every(node.clock, 0.0, fails)  # in the thread that serves
        assert not lives(node, lambda nodes: node.stopping.wait(20.0))
    elif end == "loop":
        with pytest.raises(ZeroDivisionError):
            lives(node, fails)
    else:
        node.trigger_deactivate()
        node.trigger_cleanup()
    node = supervisor()
    assert node._state.estopped
    assert node._state.latched == (() if end == "in order" else (EARLIER + SILENT,))


def test_a_stop_that_could_not_be_saved_is_saved_later(supervisor):
    """The disk was full at the stop, and had space again before the process was killed."""
    node = supervisor()
    folder = node._kept.path.parent
    folder.mkdir(parents=True, exist_ok=True)
    node._kept.path.with_suffix(".tmp").mkdir()
    estop(node)
    assert not node._kept.path.exists()
    node._kept.path.with_suffix(".tmp").rmdir()
    node._publish(1)
    node = supervisor()
    assert node._state.estopped


def test_activated_again_it_does_not_blame_nodes_for_its_own_pause(supervisor):
    """It took its last messages of before the pause for nodes that had fallen silent."""
    node = supervisor()
    now = node.clock.now_ns()
    heard(node, now, enabled=True)
    node._publish(now)
    assert node._state.enabled
    node.trigger_deactivate()
    node.trigger_activate()
    later = now + 60_000_000_000
    node._publish(later)
    assert node._publisher.told[-1][2] == [f"{name}: not seen yet" for name in ALL_NODES]
    heard(node, later)
    node._publish(later)
    assert node._publisher.told[-1][2] == []
    assert not node._state.latched


def heard(node, now, enabled=False):
    """Stand for a message of every node; enabled: of the drives."""
    for name, newest in node._sources.items():
        newest.arrival_ns = now
        newest.message = SimpleNamespace(
            faulted=False, enabled=enabled and name in ("amplifier", "manus"), reason=""
        )


def test_written_once_for_each_change(supervisor, folder):
    node = supervisor()
    node._publish(1)
    assert not [path for path in folder.rglob("*") if path.is_file()], "nothing to keep"
    estop(node)
    node._kept.path.unlink()
    node._publish(1)
    assert not node._kept.path.exists(), "not each cycle"


@pytest.mark.parametrize(
    "content", [b"", b"{}", b"\xff\xfe", b'{"estopped": 0}']
)
def test_garbage_counts_as_an_emergency_stop(supervisor, content):
    node = supervisor()
    estop(node)
    path = node._kept.path
    path.write_bytes(content)
    node = supervisor()
    node._publish(1)
    assert node._publisher.told[-1][0]
    assert reset(node) == "" and not path.exists()


def test_a_file_that_cannot_be_read_or_written_is_told_and_the_node_goes_on(
    supervisor, folder, monkeypatch
):
    said = []
    log = SimpleNamespace(warning=said.append, info=said.append, error=said.append)
    monkeypatch.setattr(SupervisorNode, "get_logger", lambda self: log)
    with monkeypatch.context() as patch:
        patch.setattr("os.access", lambda path, mode: False)
        with pytest.raises(PermissionError):  # where nothing can be written nothing was kept
            SavedState("/supervisor").read()
    shutil.rmtree(folder)
    folder.write_text("no folder")
    node = supervisor()
    node._publish(1)
    assert node._publisher.told[-1][0], "not read: nobody knows whether it was stopped"
    assert "emergency stop" in said[0] and str(folder) in said[0]
    assert reset(node) == "" and estop(node) == ""
    assert any("would lose it" in sentence for sentence in said)


def test_each_name_and_domain_has_its_own(folder, monkeypatch):
    one, second = SavedState("/supervisor"), SavedState("/supervisor/supervisor")
    one.write({"a": 1})
    second.write({"a": 2})
    assert (one.read(), SavedState("/supervisor/supervisor").read()) == ({"a": 1}, {"a": 2})
    monkeypatch.setenv("ROS_DOMAIN_ID", str(int(os.environ["ROS_DOMAIN_ID"]) + 1))
    assert SavedState("/supervisor").read() == {}
    assert {path.suffix for path in folder.rglob("*") if path.is_file()} == {".json"}


@pytest.mark.parametrize(
    ("first", "again"),
    [
        ({"ROS_DOMAIN_ID": "7"}, {"ROS_DOMAIN_ID": "07"}),
        ({"ROS_DOMAIN_ID": "0"}, {"ROS_DOMAIN_ID": ""}),
        ({"ROS_DOMAIN_ID": "16"}, {"ROS_DOMAIN_ID": "0x10"}),
        ({"XDG_STATE_HOME": ""}, {"XDG_STATE_HOME": "", "HOME": "{home}/"}),
    ],
)
def test_one_file_however_the_environment_spells_it(monkeypatch, tmp_path, first, again):
    monkeypatch.setenv("HOME", str(tmp_path))
    for number, variables in enumerate((first, again)):
        for name, value in variables.items():
            monkeypatch.setenv(name, value.format(home=tmp_path))
        if not number:
            SavedState("/supervisor").write({"a": 1})
    assert SavedState("/supervisor").read() == {"a": 1}


def test_deciding_filling_and_publishing_are_one(supervisor):
    """Else an emergency stop could go out with what the loop has filled in: permitted."""
    node = supervisor()
    node._publish(1)
    estop(node)
    assert node._publisher.held == [True, True]


S = 1_000_000_000


def report(node, now_ns, **sample):
    """Return what the supervisor makes of a force sensor's sample that has just come."""
    newest = SimpleNamespace(message=ForceSample(**sample), arrival_ns=now_ns)
    return node._report("force_sensor", newest, now_ns)


def diagnose(node, level, message):
    status = DiagnosticStatus(name="force_sensor", level=level, message=message)
    node._note_diagnostics(DiagnosticArray(status=[status]))


def test_the_status_in_the_sample_decides_without_any_diagnostics(supervisor):
    node = supervisor()
    assert not report(node, S).error
    found = report(node, S, status=1 << 4)
    assert found.error and found.reason == "force sensor: supply too high (status bit 4)"


def test_an_alarm_stands_until_the_node_says_otherwise(supervisor):
    """It expired after 3 s without diagnostics, while the faulty sensor went on sending."""
    node = supervisor()
    diagnose(node, DiagnosticStatus.ERROR, "the gauges have not changed for 0.5 s")
    for seconds in (1, 10, 1000):
        assert report(node, seconds * S).reason == "the gauges have not changed for 0.5 s"
    diagnose(node, DiagnosticStatus.OK, "sampling")
    assert not report(node, 1001 * S).error


def test_each_change_is_told_whatever_came_before(supervisor, monkeypatch):
    """rclpy raises where one place in the code logs with two severities: that ended the node."""
    node, now_ns = supervisor(), 0
    for level in (OK, WAITING, OK, STOPPED, OK, WAITING, STOPPED):
        node._decided = Decision(level, False, False, False, ("a reason",)), level == STOPPED
        for _ in range(30):
            now_ns += 100_000_000
            monkeypatch.setattr(node.clock, "now_ns", lambda at=now_ns: at)
            node._tell()
    assert node._announced.level == STOPPED
