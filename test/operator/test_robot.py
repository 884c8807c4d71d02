# SPDX-License-Identifier: Apache-2.0
"""The operator's client against one node that answers as it is told."""

import threading

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycle_msgs.msg import State
from lifecycle_msgs.srv import GetState
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from screw_module_msgs.msg import AmplifierState, EndpointSetpoint, PlanarState, SafetyState
from screw_module_msgs.srv import SetArm, SetControlMode
from std_srvs.srv import SetBool, Trigger

from screw_module_ros.operator.robot import Robot, RobotError, arm


class Bench:
    """The far end of every service and topic used here."""

    def __init__(self, node):
        self.lifecycle = State.PRIMARY_STATE_INACTIVE
        self.refusal = ""
        self.states = {AmplifierState: AmplifierState(), SafetyState: SafetyState()}
        self.states[PlanarState] = PlanarState()
        self.obeys = True
        self.causes = 0  # resets to refuse
        self.asked = []
        self.setpoints = []
        make = node.create_service
        self._services = [
            make(GetState, "amplifier/get_state", self._get_state),
            make(Trigger, "encoder/home", self._answer),
            make(Trigger, "amplifier/clear_fault", self._clear),
            make(Trigger, "supervisor/reset", self._reset),
            make(SetBool, "amplifier/enable", self._enable),
            make(SetControlMode, "impedance_controller/set_mode", self._answer),
            make(SetArm, "sim_rig/set_arm", self._answer),
        ]
        node.create_subscription(EndpointSetpoint, "setpoint", self.setpoints.append, 10)
        self._diagnostics = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._publishers = {
            AmplifierState: node.create_publisher(AmplifierState, "screw/amplifier_state", 10),
            SafetyState: node.create_publisher(SafetyState, "safety_state", 10),
            PlanarState: node.create_publisher(PlanarState, "manus/state", 10),
        }
        node.create_timer(0.02, self._publish)

    def _publish(self):
        for kind, publisher in self._publishers.items():
            publisher.publish(self.states[kind])
        error = DiagnosticStatus.ERROR
        status = DiagnosticStatus(name="amplifier", level=error, message="no mains")
        self._diagnostics.publish(DiagnosticArray(status=[status]))

    def _get_state(self, request, response):
        response.current_state.id = self.lifecycle
        return response

    def _clear(self, request, response):
        self.states[AmplifierState].faulted = bool(self.refusal)
        return self._answer(request, response)

    def _answer(self, request, response):
        self.asked.append(request)
        response.success, response.message = not self.refusal, self.refusal or "done"
        return response

    def _enable(self, request, response):
        self.states[AmplifierState].enabled = request.data and self.obeys
        return self._answer(request, response)

    def _reset(self, request, response):
        self._answer(request, response)
        if self.causes > 0:
            self.causes -= 1
            response.success, response.message = False, "the cause persists"
        else:
            self.states[SafetyState].level = SafetyState.OK
        return response


@pytest.fixture
def bench():
    context = Context()
    rclpy.init(context=context)
    node = rclpy.create_node("bench", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    ended = threading.Event()

    def serve():
        while not ended.is_set():
            executor.spin_once(timeout_sec=0.05)

    made = Bench(node)
    thread = threading.Thread(target=serve)
    thread.start()
    yield made
    ended.set()
    thread.join()
    executor.shutdown()
    node.destroy_node()
    rclpy.try_shutdown(context=context)


@pytest.fixture
def robot(bench):
    with Robot("tester") as made:
        yield made


def test_a_call_returns_what_the_node_said(robot):
    assert robot.trigger("encoder/home") == "done"


def test_a_refusal_is_an_error_with_service_and_reason(robot, bench):
    bench.refusal = "the nut moves"
    with pytest.raises(RobotError, match="encoder/home was refused: the nut moves"):
        robot.trigger("encoder/home")


def test_a_service_nobody_offers_is_named_with_what_the_nodes_say(robot, wait_until):
    wait_until(robot.complaints, what="a complaint on /diagnostics")
    with pytest.raises(RobotError, match=r"nobody offers x/y .*amplifier: no mains"):
        robot.trigger("x/y", deadline_s=0.1)


def test_ready_when_every_node_is_active(robot, bench):
    bench.lifecycle = State.PRIMARY_STATE_ACTIVE
    told = []
    robot.wait_until_ready(["amplifier"], 30.0, lambda waiting: told.append(list(waiting)))
    assert (told[0], told[-1]) == (["amplifier"], [])


def test_not_ready_says_who_and_why(robot, wait_until):
    wait_until(robot.complaints, what="a complaint on /diagnostics")
    with pytest.raises(RobotError, match="not ready .* amplifier: no mains; manus: nothing heard"):
        robot.wait_until_ready(["amplifier", "manus"], 0.2)


@pytest.mark.parametrize("load", [0.0, 900.0])
def test_not_ready_on_a_full_machine_names_its_load(robot, monkeypatch, load):
    monkeypatch.setattr("os.getloadavg", lambda: (load, load, load))
    with pytest.raises(RobotError, match="not ready") as caught:
        robot.wait_until_ready(["amplifier"], 0.2)
    assert ("The load of this machine was 900.0 on" in str(caught.value)) == (load > 0.0)


def test_watch_ends_a_wait(robot):
    def died():
        raise RobotError("encoder ended by itself with code 1")

    robot.watch = died
    with pytest.raises(RobotError, match="ended by itself"):
        robot.wait_until_ready(["amplifier"], 30.0)


def test_enabling_waits_for_the_drive(robot, bench):
    robot.enable()
    assert bench.states[AmplifierState].enabled
    robot.enable(False)
    assert not bench.states[AmplifierState].enabled


def test_a_drive_that_does_not_switch_tells_why(robot, bench, monkeypatch):
    monkeypatch.setattr("screw_module_ros.operator.robot.ANSWER_S", 0.5)
    bench.obeys = False
    bench.states[AmplifierState].reason = "no fresh command"
    wait_until_heard(robot, bench, AmplifierState)
    with pytest.raises(RobotError, match="amplifier did not switch on: no fresh command"):
        robot.enable()


def test_torque_taken_off_is_noticed_with_the_reason(robot, bench):
    bench.states[AmplifierState].reason = "the cable is out"
    wait_until_heard(robot, bench, AmplifierState)
    with pytest.raises(RobotError, match="amplifier took the torque off: the cable is out"):
        robot.check_enabled()


def test_only_latched_faults_are_cleared(robot, bench):
    robot.clear_faults()
    assert not bench.asked
    bench.states[AmplifierState].faulted = True
    wait_until_heard(robot, bench, AmplifierState)
    robot.clear_faults()
    assert len(bench.asked) == 1


def test_a_fault_that_stays_is_told(robot, bench, monkeypatch):
    monkeypatch.setattr("screw_module_ros.operator.robot.ANSWER_S", 0.5)
    bench.states[AmplifierState].faulted = True
    bench.refusal = "no mains"
    wait_until_heard(robot, bench, AmplifierState)
    with pytest.raises(RobotError, match="fault of amplifier cannot be cleared: no mains"):
        robot.clear_faults()


def test_a_drive_that_is_silent_is_waited_for(robot, bench, monkeypatch):
    monkeypatch.setattr("screw_module_ros.operator.robot.ANSWER_S", 0.5)
    bench.states[PlanarState].drive_state = [AmplifierState.UNKNOWN, 1]
    wait_until_heard(robot, bench, PlanarState)
    with pytest.raises(RobotError, match="manus cannot be cleared: nothing heard"):
        robot.clear_faults()


def wait_until_heard(robot, bench, kind):
    """What was published before the bench changed it is no longer on its way."""
    robot.wait_until(lambda: robot.state(kind) == bench.states[kind], 5.0, "not heard")


@pytest.fixture
def stopped(robot, bench):
    """The robot of an operator who has seen that it was stopped."""
    bench.states[SafetyState].level = SafetyState.STOPPED
    wait_until_heard(robot, bench, SafetyState)
    return robot


def test_a_stop_is_reset_before_motion(stopped, bench):
    stopped.permit()
    assert bench.states[SafetyState].level == SafetyState.OK


def test_a_cause_that_takes_a_while_to_go_is_waited_for(stopped, bench):
    bench.causes = 2
    stopped.permit()
    assert bench.causes == 0


def test_a_cause_that_stays_is_told(stopped, bench, monkeypatch):
    monkeypatch.setattr("screw_module_ros.operator.robot.ANSWER_S", 0.5)
    bench.causes = 1000
    with pytest.raises(RobotError, match="no permission to move: the cause persists"):
        stopped.permit()


def test_without_permission_the_reason_is_told(robot, bench, monkeypatch):
    monkeypatch.setattr("screw_module_ros.operator.robot.ANSWER_S", 0.3)
    bench.states[SafetyState] = SafetyState(level=SafetyState.WAITING, reasons=["manus: not seen"])
    wait_until_heard(robot, bench, SafetyState)
    with pytest.raises(RobotError, match="no permission to move: manus: not seen"):
        robot.permit()


def test_set_points_carry_nan_where_an_axis_is_left_alone(robot, bench, wait_until):
    def sent():
        robot.set_setpoint(z=0.2)
        return bench.setpoints

    wait_until(sent, what="a set point")
    position = bench.setpoints[0].position
    assert (position.x != position.x, position.z) == (True, 0.2)
    assert bench.setpoints[0].header.frame_id == "manus_base"


def test_an_arm_leaves_alone_what_is_not_said():
    request = arm(target=(0.1, 0.0, float("nan")), duration=2.0)
    assert (request.target.x, request.duration, request.kind) == (0.1, 2.0, "")
    for value in (request.target.z, request.mass, request.stiffness, request.amplitude.z):
        assert value != value
    assert (list(request.traits), list(request.values)) == ([], [])


def test_an_arm_has_the_traits_that_are_named():
    request = arm(traits={"carried": 0, "weight": 12.0})
    assert (list(request.traits), list(request.values)) == (["carried", "weight"], [0.0, 12.0])
    assert (request.patient, arm(patient="weak").patient) == ("", "weak")
