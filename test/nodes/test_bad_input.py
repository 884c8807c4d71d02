# SPDX-License-Identifier: Apache-2.0
"""What a user gets wrong: each ends in a sentence that names the thing and the way out."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from rclpy.lifecycle import TransitionCallbackReturn
from screw_module_msgs.msg import ForceCommand
from screw_module_msgs.srv import SetControlMode, SetImpedance
from services import asked

from screw_module_ros.can_io.bus import BusSettings, where, within
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.graph import bus_of
from screw_module_ros.locks import AlreadyRunning, lock_device, lock_simulation
from screw_module_ros.nodes.support.answering import Done
from screw_module_ros.nodes.support.law_inputs import set_impedance


def refused(node) -> str:
    """Try to configure `node`; return the sentence it refused with."""
    assert node.trigger_configure() != TransitionCallbackReturn.SUCCESS
    assert node.failure
    return node.failure


@pytest.mark.parametrize("name", ["encoder", "force_sensor", "amplifier", "manus"])
def test_no_rig(make_node, ros_domain_id, name):
    """Without the rig each driver node says which bus is missing, and where; it tries again."""
    told = refused(make_node(name, "-r", "__ns:=/left"))
    assert f"rig left/{bus_of(name)} in ROS domain {ros_domain_id}: no sim_rig serves" in told
    assert "start it in this ROS domain and namespace" in told


@pytest.mark.parametrize("name", ["encoder", "force_sensor", "amplifier", "manus"])
def test_nobody_answers(make_node, name):
    """On a silent bus each driver node says which device is silent, and where."""
    told = refused(make_node(name, "-p", "can.interface:=virtual", "-p", "can.channel:=silent"))
    assert "does not answer" in told and "virtual silent" in told


@pytest.mark.parametrize(
    ("interface", "channel", "told"),
    [
        ("socketcan", "can_not_there", "is it there and up"),
        ("udp_multicast", "127.0.0.1", "multicast group"),
        ("no_such_interface", "x", "no_such_interface"),
        ("rig", "239.74.163.2", "names such as encoder"),
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
    words = ("-p", "mode:=5", "-p", "gain_limits_required:=false")
    assert "needs a damping of" in refused(make_node("impedance_controller", *words))


def test_observer_is_refused_by_the_services_until_there_is_a_damper(make_node):
    """First the damper, then the mode; a stiffer spring asks for more of it."""
    node = make_node("impedance_controller")
    law = node.parameters, VerticalSettings
    told = asked(node, "~/set_mode", SetControlMode.Request(mode=ForceCommand.OBSERVER))
    assert not told.success and "raise the damping first" in told.message
    told = set_impedance(*law, SetImpedance.Request(stiffness=100.0, damping=10.0))
    assert isinstance(told, Done) and told == "stiffness 100 N/m, damping 10 Ns/m"
    told = asked(node, "~/set_mode", SetControlMode.Request(mode=ForceCommand.OBSERVER))
    assert told.success and told.message == "mode 5, OBSERVER"
    told = set_impedance(*law, SetImpedance.Request(stiffness=2000.0, damping=10.0))
    assert "2000 N/m needs a damping of" in told


def test_a_rate_that_lines_up_with_nothing(make_node):
    """A period that is no whole number of microseconds is refused."""
    told = refused(make_node("encoder", "-p", "rate:=333.3"))
    assert "whole number of microseconds" in told


def test_required_nodes_that_do_not_exist(make_node):
    """The supervisor does not wait for ever for a misspelt node."""
    told = refused(make_node("supervisor", "-p", "required:=['encodr']"))
    assert "encodr" in told and "encoder" in told


def test_a_device_is_driven_once(make_node, ros_domain_id):
    """A second process on the same device is refused."""
    held = lock_device(f"rig encoder in ROS domain {ros_domain_id}", "encoder node 2")
    told = refused(make_node("encoder"))
    held.release()
    assert "already driven by another process" in told


def test_a_bus_is_simulated_once(make_node, ros_domain_id):
    """Two simulations on one bus would both answer: the second is refused until the first ends."""
    planar = f"rig planar in ROS domain {ros_domain_id}"
    held = lock_simulation(planar)
    node = make_node("sim_rig")
    told = refused(node)
    assert f"{planar} are already simulated" in told and "another namespace" in told
    held.release()
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    with pytest.raises(AlreadyRunning, match="already simulated"):
        lock_simulation(planar)
    assert node.trigger_cleanup() == TransitionCallbackReturn.SUCCESS
    lock_simulation(planar).release()


def test_simulated_buses_cannot_be_reached_from_the_network(make_node):
    """Frames from other computers reached them, while they were UDP multicast groups."""
    node = make_node("sim_rig")
    before = udp_sockets()
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    assert udp_sockets() == before
    assert all(bus.fileno() >= 0 for bus in node._buses.values()) and len(node._buses) == 4
    assert node.trigger_cleanup() == TransitionCallbackReturn.SUCCESS


def test_a_process_that_does_not_read_its_bus_is_told_of_once(make_node, capfd):
    node = make_node("sim_rig")
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    for bus in node._buses.values():
        bus.lost = 3
    assert [node.health().values["lost"] for _ in range(2)] == [12, 12]
    assert capfd.readouterr().err.count("reads no frames of its bus loses them") == 1
    assert node.trigger_cleanup() == TransitionCallbackReturn.SUCCESS


def udp_sockets() -> set[str]:
    """Return this process's UDP sockets as the kernel lists them."""
    links = (os.readlink(link) for link in Path("/proc/self/fd").iterdir() if link.is_symlink())
    ours = {link[len("socket:[") : -1] for link in links if link.startswith("socket:[")}
    rows = [
        line.split()
        for name in ("udp", "udp6")
        for line in Path("/proc/net", name).read_text().splitlines()[1:]
    ]
    return {row[1] for row in rows if row[9] in ours}


def test_the_lock_goes_with_its_holder():
    """A device can be taken again once it was let go."""
    lock_device("virtual x", "drive").release()
    held = lock_device("virtual x", "drive")
    with pytest.raises(AlreadyRunning, match="drive on virtual x is already driven"):
        lock_device("virtual x", "drive")
    held.release()


def test_the_name_of_a_bus_is_unique_on_this_machine(ros_domain_id):
    """Only a bus of udp_multicast has a port; a simulated one is of a domain."""
    can0 = BusSettings("socketcan", "can0")
    assert where(can0) == where(can0._replace(port=43214)) == "socketcan can0"
    group = BusSettings("udp_multicast", "239.74.163.9")
    assert where(group) != where(group._replace(port=43214))
    rig = BusSettings(channel="drive")
    assert where(within(rig, "/left")) == f"rig left/drive in ROS domain {ros_domain_id}"
    assert where(within(rig, "/")) == f"rig drive in ROS domain {ros_domain_id}"
