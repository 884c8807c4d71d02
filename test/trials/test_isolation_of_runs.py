# SPDX-License-Identifier: Apache-2.0
import errno
import os
import socket
from pathlib import Path

import pytest

from screw_module_ros.nodes.support.place import AlreadyRunning
from screw_module_ros.trials import isolation


@pytest.fixture
def ports(can_port_base, monkeypatch):
    """Let places begin at this test's own ports, with two to choose from."""
    monkeypatch.setattr(isolation, "_FIRST_PORTS", (can_port_base, can_port_base + 4))
    return can_port_base


@pytest.fixture
def places():
    """Collect places, to release them at the end."""
    taken = []
    yield taken
    for place in reversed(taken):
        place.release()


def test_a_domain_that_is_set_is_kept(ports, places, ros_domain_id):
    places.append(isolation.own_place())
    assert places[0].domain == ros_domain_id


def test_without_one_a_free_domain_is_taken_and_set(ports, places, monkeypatch):
    monkeypatch.delenv("ROS_DOMAIN_ID")
    places.append(isolation.own_place())
    assert 1 <= places[0].domain <= 100
    assert os.environ["ROS_DOMAIN_ID"] == str(places[0].domain)


def test_nodes_keep_what_they_keep_for_this_run_alone(ports, monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    place = isolation.own_place()
    folder = Path(os.environ["XDG_STATE_HOME"])
    assert folder.is_dir() and not list(folder.iterdir())
    place.release()
    assert os.environ["XDG_STATE_HOME"] == str(tmp_path) and not folder.exists()


def test_discovery_stays_on_this_machine(ports, places, monkeypatch):
    monkeypatch.delenv("ROS_AUTOMATIC_DISCOVERY_RANGE", raising=False)
    places.append(isolation.own_place())
    assert os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"


def test_two_runs_do_not_share_ports_and_a_third_is_told(ports, places):
    places += [isolation.own_place(), isolation.own_place()]
    assert [place.first_port for place in places] == [ports, ports + 4]
    with pytest.raises(AlreadyRunning, match="CAN port"):
        isolation.own_place()


def test_no_port_of_a_run_is_one_that_the_kernel_gives_to_any_socket():
    """The middleware's sockets of other nodes got one between the choice and the rig's start."""
    ports = [first + number for first in isolation._FIRST_PORTS for number in range(4)]
    assert min(ports) > 60_999 and max(ports) < 65_536  # ip_local_port_range ends at 60 999


def test_a_machine_without_a_network_is_told_what_it_lacks(ports, monkeypatch):
    """The demo waited for 90 s and said that it had heard nothing of any node."""
    class Alone(socket.socket):
        def setsockopt(self, *given):
            raise OSError(errno.ENODEV, "No such device")

    monkeypatch.setattr(socket, "socket", Alone)
    with pytest.raises(OSError, match="No such device.*ip route add 239.0.0.0/8 dev lo"):
        isolation.own_place()


def test_released_ports_are_free_again(ports, places):
    isolation.own_place().release()
    places.append(isolation.own_place())
    assert places[0].first_port == ports


def test_ports_somebody_listens_on_are_left_alone(ports, places):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        other.bind(("", ports + 2))
        places.append(isolation.own_place())
    assert places[0].first_port == ports + 4


def test_every_driver_and_the_rig_are_told_the_same_port(ports, places):
    places.append(isolation.own_place())
    told = [text.split(":=") for text in places[0].arguments() if ":=" in text]
    by_port = {}
    for name, port in told:
        by_port.setdefault(int(port), set()).add(name)
    assert by_port == {
        ports: {"encoder:can.port", "sim_rig:encoder.can.port"},
        ports + 1: {"amplifier:can.port", "sim_rig:drive.can.port"},
        ports + 2: {"force_sensor:can.port", "sim_rig:force_sensor.can.port"},
        ports + 3: {"manus:can.port", "sim_rig:planar.can.port"},
    }
