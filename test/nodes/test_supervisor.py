# SPDX-License-Identifier: Apache-2.0
"""The supervisor in this process: sensors with an error, and what outlives it.

Ended and made again, what was stopped is stopped.
"""

from __future__ import annotations

import os
import shutil
from types import SimpleNamespace
from typing import NamedTuple

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from screw_module_msgs.msg import ForceSample
from services import asked
from std_srvs.srv import SetBool

from screw_module_ros.nodes.supervisor import SupervisorNode
from screw_module_ros.nodes.support import runtime
from screw_module_ros.nodes.support.place import SavedState
from screw_module_ros.safety.supervision import (
    ALL_NODES,
    EARLIER,
    OK,
    STOPPED,
    WAITING,
)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path / "state"


class Decided(NamedTuple):
    """What one safety_state said, and whether the lock was held while it was published."""

    estopped: bool
    locked: bool
    reasons: list[str]
    enabled: bool
    held: bool


@pytest.fixture
def supervisor(make_node, monkeypatch):
    """Return a maker of supervisors; each stands for a process that ended without a farewell.

    told: what it has published, each a `Decided`.
    """
    made = []

    def make():
        node = SupervisorNode() if made else make_node("supervisor")
        made.append(node)
        node.told = []

        def publish(message):
            node.told.append(Decided(
                message.estopped, message.vertical_locked, list(message.reasons),
                message.planar_permitted, node._changing.locked(),
            ))  # fmt: skip

        monkeypatch.setattr(node, "outlet", lambda kind, topic, qos: publish)
        node.trigger_configure()
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
S = 1_000_000_000


def fails(*_):
    raise ZeroDivisionError


def lock(node, locked):
    return asked(node, "~/lock_vertical", SetBool.Request(data=locked)).message


def estop(node):
    return asked(node, "~/estop").success


def reset(node):
    return asked(node, "~/reset").success


def heard(node, now, enabled=False, but=()):
    """Stand for a message of every node but these; enabled: of the drives."""
    for name, newest in node.sources.items():
        if name not in but:
            newest.arrival_ns = now
            newest.message = SimpleNamespace(
                faulted=False, enabled=enabled and name in ("amplifier", "manus"), reason=""
            )


def latch(node):
    """Have the plane fall silent while the drives are enabled."""
    heard(node, S, enabled=True)
    node.decide(S)
    assert node.told[-1].reasons == []
    heard(node, 2 * S, but=("manus",))
    node.decide(2 * S)
    assert SILENT in node.told[-1].reasons


@pytest.fixture
def saved():
    """The file of what outlives the supervisor's process."""
    return SavedState("/supervisor").path


def test_estop_lock_and_latched_stop_outlive_the_process(supervisor, saved):
    node = supervisor()
    latch(node)
    estop(node)
    lock(node, True)

    node = supervisor()
    node.decide(1)
    assert node.told[-1].estopped and node.told[-1].locked
    assert node.told[-1].reasons[:2] == ["emergency stop", EARLIER + SILENT]
    assert reset(node)

    node = supervisor()
    node.decide(1)
    assert node.told[-1][:2] == (False, True), "a reset does not unlock"
    lock(node, False)
    assert not saved.exists()


@pytest.mark.parametrize("end", ["in order", "loop", "requests", "cleanup"])
def test_only_an_orderly_end_forgets_what_was_latched(supervisor, lives, end):
    """Emergency stop and lock alone outlive one; a cleanup is no end, nor is an error."""
    node = supervisor()
    latch(node)
    estop(node)
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
    node.decide(1)
    assert node.told[-1].estopped
    assert (EARLIER + SILENT in node.told[-1].reasons) is not (end == "in order")


def test_a_stop_that_could_not_be_saved_is_saved_later(supervisor, saved):
    """The disk was full at the stop, and had space again before the process was killed."""
    node = supervisor()
    saved.parent.mkdir(parents=True, exist_ok=True)
    saved.with_suffix(".tmp").mkdir()
    estop(node)
    assert not saved.exists()
    saved.with_suffix(".tmp").rmdir()
    node.decide(1)
    node = supervisor()
    node.decide(1)
    assert node.told[-1].estopped


def test_activated_again_it_does_not_blame_nodes_for_its_own_pause(supervisor):
    """It took its last messages of before the pause for nodes that had fallen silent."""
    node = supervisor()
    now = node.clock.now_ns()
    heard(node, now, enabled=True)
    node.decide(now)
    assert node.told[-1].reasons == []
    node.trigger_deactivate()
    node.trigger_activate()
    later = now + 60 * S
    node.decide(later)
    assert node.told[-1].reasons == [f"{name}: not seen yet" for name in ALL_NODES]
    heard(node, later)
    node.decide(later)
    assert node.told[-1].reasons == [], "nothing is latched either"


def test_written_once_for_each_change(supervisor, folder, saved):
    node = supervisor()
    node.decide(1)
    assert not [path for path in folder.rglob("*") if path.is_file()], "nothing to keep"
    estop(node)
    saved.unlink()
    node.decide(1)
    assert not saved.exists(), "not each cycle"


@pytest.mark.parametrize(
    "content", [b"", b"{}", b"\xff\xfe", b'{"estopped": 0}']
)
def test_garbage_counts_as_an_emergency_stop(supervisor, saved, content):
    node = supervisor()
    estop(node)
    saved.write_bytes(content)
    node = supervisor()
    node.decide(1)
    assert node.told[-1].estopped
    assert reset(node) and not saved.exists()


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
    node.decide(1)
    assert node.told[-1].estopped, "not read: nobody knows whether it was stopped"
    assert "emergency stop" in said[0] and str(folder) in said[0]
    assert reset(node) and estop(node)
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
    node.decide(1)
    estop(node)
    assert [told.held for told in node.told] == [True, True]


def report(node, now_ns, **sample):
    """Return what the supervisor says of a force sensor whose sample has just come."""
    newest = node.sources["force_sensor"]
    newest.message, newest.arrival_ns = ForceSample(**sample), now_ns
    node.decide(now_ns)
    return [reason for reason in node.told[-1].reasons if reason.startswith("force_sensor:")]


def diagnose(node, level, message):
    status = DiagnosticStatus(name="force_sensor", level=level, message=message)
    (diagnostics,) = [each for each in node.subscriptions if each.topic_name == "/diagnostics"]
    diagnostics.callback(DiagnosticArray(status=[status]))


def test_the_status_in_the_sample_decides_without_any_diagnostics(supervisor):
    node = supervisor()
    assert report(node, S) == []
    told = "force_sensor: force sensor: supply too high (status bit 4)"
    assert report(node, S, status=1 << 4) == [told]


def test_an_alarm_stands_until_the_node_says_otherwise(supervisor):
    """It expired after 3 s without diagnostics, while the faulty sensor went on sending."""
    node = supervisor()
    diagnose(node, DiagnosticStatus.ERROR, "the gauges have not changed for 0.5 s")
    for seconds in (1, 10, 1000):
        told = "force_sensor: the gauges have not changed for 0.5 s"
        assert report(node, seconds * S) == [told]
    diagnose(node, DiagnosticStatus.OK, "sampling")
    assert report(node, 1001 * S) == []


def test_each_change_is_told_whatever_came_before(supervisor, monkeypatch, capfd):
    """rclpy raises where one place in the code logs with two severities: that ended the node."""
    node, now_ns = supervisor(), 0
    for level in (OK, WAITING, OK, STOPPED, OK, WAITING, STOPPED):
        reset(node)
        for _ in range(30):
            now_ns += 100_000_000
            monkeypatch.setattr(node.clock, "now_ns", lambda at=now_ns: at)
            heard(node, now_ns if level != WAITING else 0)
            if level == STOPPED:
                estop(node)
            node.decide(now_ns)
            node.tell()
    told = capfd.readouterr().err.splitlines()
    severities = [line[1:].partition("]")[0] for line in told if "[supervisor]" in line]
    assert {"INFO", "WARN", "ERROR"} <= set(severities) and severities[-1] == "ERROR"
