# SPDX-License-Identifier: Apache-2.0
"""What a user gets wrong: each ends in a sentence that names the thing and the way out."""

from __future__ import annotations

import pytest
from rclpy.lifecycle import TransitionCallbackReturn
from screw_module_msgs.msg import ForceCommand
from screw_module_msgs.srv import SetControlMode, SetImpedance

from screw_module_ros.graph import BUSES
from screw_module_ros.nodes.support.answering import Done
from screw_module_ros.nodes.support.place import AlreadyRunning, lock_device, lock_simulation


def refused(node) -> str:
    """Try to configure `node`; return the sentence it refused with."""
    assert node.trigger_configure() != TransitionCallbackReturn.SUCCESS
    assert node.failure
    return node.failure


@pytest.mark.parametrize("name", ["encoder", "force_sensor", "amplifier", "manus"])
def test_nobody_answers(make_node, can_port_base, name):
    """Without rig or hardware each driver node says which device is silent, and where."""
    told = refused(make_node(name, "-p", f"can.port:={can_port_base}"))
    assert "does not answer" in told and str(can_port_base) in told and "rig" in told


@pytest.mark.parametrize(
    ("interface", "channel", "told"),
    [
        ("socketcan", "can_not_there", "is it there and up"),
        ("udp_multicast", "127.0.0.1", "multicast group"),
        ("no_such_interface", "x", "no_such_interface"),
    ],
)
def test_a_wrong_bus(make_node, interface, channel, told):
    """A channel that is not there: the sentence names it and what to do."""
    given = ("-p", f"can.interface:={interface}", "-p", f"can.channel:={channel}")
    sentence = refused(make_node("encoder", *given))
    assert told in sentence and channel in sentence


def test_a_malformed_friction_file(make_node, tmp_path):
    """The controller does not start with half a model; it names file and key."""
    file = tmp_path / "friction.yaml"
    file.write_text("format: screw_module_ros/friction\nversion: 1\n")
    told = refused(make_node("impedance_controller", "-p", f"friction_file:={file}"))
    assert str(file) in told


def test_observer_without_the_damper_it_needs(make_node):
    """The sentence says how much damping is wanted."""
    assert "needs a damping of" in refused(make_node("impedance_controller", "-p", "mode:=5"))


def test_observer_is_refused_by_the_services_until_there_is_a_damper(make_node):
    """First the damper, then the mode; a stiffer spring asks for more of it."""
    node = make_node("impedance_controller")
    told = node._set_mode(SetControlMode.Request(mode=ForceCommand.OBSERVER))
    assert "raise the damping first" in told
    told = node._set_impedance(SetImpedance.Request(stiffness=100.0, damping=10.0))
    assert isinstance(told, Done) and told == "stiffness 100 N/m, damping 10 Ns/m"
    told = node._set_mode(SetControlMode.Request(mode=ForceCommand.OBSERVER))
    assert isinstance(told, Done) and told == "mode 5, OBSERVER"
    told = node._set_impedance(SetImpedance.Request(stiffness=2000.0, damping=10.0))
    assert "2000 N/m needs a damping of" in told


def test_a_rate_that_lines_up_with_nothing(make_node):
    """A period that is no whole number of microseconds is refused."""
    told = refused(make_node("encoder", "-p", "rate:=333.3"))
    assert "whole number of microseconds" in told


def test_required_nodes_that_do_not_exist(make_node):
    """The supervisor does not wait for ever for a misspelt node."""
    told = refused(make_node("supervisor", "-p", "required:=['encodr']"))
    assert "encodr" in told and "encoder" in told


def test_a_device_is_driven_once(make_node, can_port_base):
    """A second process on the same device is refused, whatever its ROS domain."""
    held = lock_device("udp_multicast", "239.74.163.2", can_port_base, "encoder node 2")
    told = refused(make_node("encoder", "-p", f"can.port:={can_port_base}"))
    held.release()
    assert "already driven by another process" in told


def test_a_bus_is_simulated_once(make_node, can_port_base):
    """Two simulations on one bus would both answer: the second is refused until the first ends."""
    held = lock_simulation("udp_multicast", "239.74.163.2", can_port_base + 3)
    ports = [word for number, bus in enumerate(BUSES)
             for word in ("-p", f"{bus.name}.can.port:={can_port_base + number}")]  # fmt: skip
    node = make_node("sim_rig", *ports)
    told = refused(node)
    assert f"port {can_port_base + 3} are already simulated" in told and "--first-port" in told
    held.release()
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    with pytest.raises(AlreadyRunning, match="already simulated"):
        lock_simulation("udp_multicast", "239.74.163.2", can_port_base)
    assert node.trigger_cleanup() == TransitionCallbackReturn.SUCCESS
    lock_simulation("udp_multicast", "239.74.163.2", can_port_base).release()


def test_the_lock_goes_with_its_holder():
    """A device can be taken again once it was let go."""
    lock_device("virtual", "x", 1, "drive").release()
    held = lock_device("virtual", "x", 1, "drive")
    with pytest.raises(AlreadyRunning, match="drive on virtual x"):
        lock_device("virtual", "x", 1, "drive")
    held.release()


def test_a_device_is_locked_whatever_udp_port_its_bus_does_not_use():
    held = lock_device("socketcan", "can0", 43114, "drive node 1")
    with pytest.raises(AlreadyRunning, match="drive node 1 on socketcan can0 is already driven"):
        lock_device("socketcan", "can0", 43214, "drive node 1")
    held.release()
    held = lock_device("udp_multicast", "239.74.163.9", 43114, "drive node 1")
    lock_device("udp_multicast", "239.74.163.9", 43214, "drive node 1").release()
    held.release()
