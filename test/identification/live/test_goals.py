# SPDX-License-Identifier: Apache-2.0
"""A goal of `characterize` without a graph: refusals, feedback, what is told, who confirms."""

from __future__ import annotations

import threading
from types import SimpleNamespace

import can
import pytest
from screw_module_msgs.action import RunExperiment

from screw_module_ros.can_io.bus import BusSettings
from screw_module_ros.clock import ManualClock, WallClock
from screw_module_ros.identification.live import characterize, fixture
from screw_module_ros.identification.live.characterize import CharacterizeNode, Feedback, _checked
from screw_module_ros.identification.live.fixture import RigBusSettings, sees_rig
from screw_module_ros.identification.trials import Cancelled


@pytest.mark.parametrize(
    ("experiment", "settings", "folder", "said"),
    [
        ("juggling", "", "x", "no experiment 'juggling'; there are"),
        ("static_torque", "{amplitude: 5.0}", "x", "amplitude = 5.0 Nm: above the largest allowed"),
        ("static_torque", "", "", "folder is empty"),
        ("static_torque", "", "/proc/nothing", "lies outside of"),
        ("static_torque", "", "../x", "lies outside of"),
        ("static_torque", "", "link/x", "lies outside of"),
        ("static_torque", "", "file", "cannot be written"),
        ("gravity", "", "x", "needs the result of friction_map"),
        # What is there stays: the gain limits that a controller runs with was replaced, also
        # through a link out of here.
        ("gravity", "", ".", "gravity.npz exists already and is never overwritten"),
        ("delivered_impedance", "", ".", "module_gain_limits.yaml exists already"),
        ("calibration", "", ".", "module_calibration.yaml exists already"),
    ],
)
def test_a_goal_that_cannot_be_done_is_refused(tmp_path, experiment, settings, folder, said):
    (tmp_path / "link").symlink_to("/tmp")
    (tmp_path / "file").write_text("")
    for file in ("gravity.npz", "module_gain_limits.yaml", "module_calibration.yaml"):
        (tmp_path / file).symlink_to("/nonexistent")
    goal = RunExperiment.Goal(experiment=experiment, settings=settings, folder=folder)
    with pytest.raises(ValueError, match=said):
        _checked(goal, tmp_path)


class TestFeedback:
    @pytest.fixture
    def told(self):
        return []

    @pytest.fixture
    def feedback(self, told):
        self.clock = ManualClock(100_000_000_000)
        goal = SimpleNamespace(
            publish_feedback=lambda m: told.append((m.progress, m.remaining, m.doing))
        )
        return Feedback(goal, RunExperiment.Feedback, lambda: None, self.clock)

    @pytest.mark.parametrize(
        ("first", "seconds", "then", "share", "remaining"),
        [
            (0.0, 30.0, 10.0, 0.25, 30.0 * (30.0 + 10.0) / (10.0 + 10.0)),
            # What was kept from before does not count.
            (20.0, 10.0, 25.0, 0.625, 15.0 * (10.0 + 10.0) / (5.0 + 10.0)),
        ],
    )
    def test_estimates_from_the_pace_so_far(
        self, feedback, told, first, seconds, then, share, remaining
    ):
        feedback.say("stage")
        feedback.progress("map", first, 40.0)
        self.clock.sleep(seconds)
        feedback.progress("map", then, 40.0)
        assert told[-1] == (share, pytest.approx(remaining), "stage")

    def test_is_not_told_too_often(self, feedback, told):
        for step in range(100):
            self.clock.sleep(0.01)
            feedback.progress("map", step, 100.0)
        assert 4 <= len(told) <= 6

    def test_hears_of_a_cancellation(self, feedback):
        def cancelled():
            raise Cancelled

        feedback._watch = cancelled
        with pytest.raises(Cancelled):
            feedback.progress("map", 0.0, 1.0)

    def test_of_nothing_to_do(self, feedback, told):
        feedback.progress("map", 0.0, 0.0)
        assert told[-1][:2] == (1.0, 0.0)


def _quiet(text):
    """Log nothing."""


class Node:
    """The parts of the node around an experiment, of which `fails` takes the place."""

    _work = CharacterizeNode._work

    def __init__(self, fails: Exception, while_saving: bool):
        self._fails, self._while_saving = fails, while_saving
        self.clock = SimpleNamespace(leave=lambda: None)
        self.parameters = SimpleNamespace(read=lambda kind: SimpleNamespace(folder="~"))
        logger = SimpleNamespace(info=_quiet, warning=_quiet, error=_quiet)
        self.get_logger = lambda: logger

    def _measured(self, goal, experiment, settings, folder, left):
        left.append("amplifier not disabled: it did not switch off")
        if not self._while_saving:
            raise self._fails
        return self

    def save(self, folder):
        raise self._fails


@pytest.mark.parametrize(
    ("error", "while_saving", "said"),
    [
        (OSError(28, "No space left on device"), True, "[Errno 28] No space left on device"),
        (TypeError("odd"), True, "gravity: TypeError: odd"),
        (ZeroDivisionError("division by zero"), False,
         "gravity: ZeroDivisionError: division by zero"),
    ],
)  # fmt: skip
def test_what_could_not_be_restored_is_told_however_it_ends(
    monkeypatch, tmp_path, error, while_saving, said
):
    monkeypatch.setattr(characterize, "_checked", lambda *asked: (None, None, tmp_path))
    request = RunExperiment.Goal(experiment="gravity", folder="x")
    goal = SimpleNamespace(request=request, is_cancel_requested=False)
    outcome = Node(error, while_saving)._work(goal)
    assert not outcome.succeeded
    assert outcome.result.message == f"{said}; amplifier not disabled: it did not switch off"


def test_an_empty_name_lists_the_experiments():
    goal = SimpleNamespace(request=RunExperiment.Goal(), is_cancel_requested=False)
    outcome = Node(TypeError("odd"), while_saving=False)._work(goal)
    assert outcome.succeeded and outcome.result.success
    assert "static_torque" in outcome.result.message


@pytest.mark.parametrize(
    ("sent", "other_bus", "seen"),
    [
        (0x182, "", True),
        (None, "", False),  # a silent bus
        (0x183, "", False),  # another device
        (0x182, "another", False),  # an encoder on another bus
    ],
)
def test_only_a_rig_that_answers_on_the_bus_needs_no_operator(request, sent, other_bus, seen):
    channel = request.node.name
    told = {"can.interface": "virtual", "can.channel": channel, "node_id": 2}
    robot = SimpleNamespace(
        clock=WallClock(), node=SimpleNamespace(get_namespace=lambda: "/"),
        parameters=lambda node, names: told,
    )  # fmt: skip
    ends = threading.Event()

    def talk() -> None:
        with can.Bus(interface="virtual", channel=channel) as sender:
            while sent and not ends.wait(0.002):
                sender.send(can.Message(arbitration_id=sent, is_extended_id=False))

    thread = threading.Thread(target=talk)
    thread.start()
    bus = BusSettings(interface="virtual", channel=other_bus or channel)
    try:
        assert sees_rig(robot, bus, RigBusSettings()) is seen
    finally:
        ends.set()
        thread.join()


@pytest.mark.parametrize("interface", ["socketcan", "udp_multicast"])
def test_hardware_is_no_rig(monkeypatch, interface):
    monkeypatch.setattr(fixture, "open_bus", None)  # nor is it listened to
    robot = SimpleNamespace(clock=WallClock())
    assert not sees_rig(robot, BusSettings(interface=interface), RigBusSettings())


@pytest.mark.parametrize(
    ("pids", "sent", "seen"), [((7, 8), (5, 5), True), ((8, 8), (5, 5), False),
                               ((7, 8), (0, 5), False)]
)  # fmt: skip
def test_in_simulated_time_who_moves_it_must_have_answered(pids, sent, seen):
    page = SimpleNamespace(conductor=7, buses=lambda: list(zip(pids, sent, strict=True)))
    robot = SimpleNamespace(clock=SimpleNamespace(simulated=True, page=page))
    assert sees_rig(robot, BusSettings(), RigBusSettings()) is seen
