# SPDX-License-Identifier: Apache-2.0
"""Messages of our processes go over UDP, and keep to this machine where that is asked for."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from screw_module_ros.nodes.support import place
from screw_module_ros.nodes.support.place import (
    BUILTIN_VARIABLE,
    NETWORK_VARIABLE,
    PROFILES_VARIABLE,
    RANGE_VARIABLE,
    choose_transport,
)

VARIABLES = (BUILTIN_VARIABLE, PROFILES_VARIABLE, RANGE_VARIABLE, NETWORK_VARIABLE,
             "ROS_LOCALHOST_ONLY", "ROS_STATIC_PEERS")  # fmt: skip
THREADS = """
from pathlib import Path
import rclpy
from screw_module_ros.nodes.support.place import choose_transport
choose_transport()
rclpy.init()
node = rclpy.create_node("listens")
for thread in Path("/proc/self/task").iterdir():
    print((thread / "comm").read_text().strip())
node.destroy_node()
rclpy.shutdown()
"""


# Local addresses of the process's UDP sockets while a node of it lives, after proc(5).
BOUND = """
import os, socket
from pathlib import Path
import rclpy
from screw_module_ros.nodes.support.place import choose_transport
choose_transport()
rclpy.init()
node = rclpy.create_node("listens")
links = (link for link in Path("/proc/self/fd").iterdir() if link.is_symlink())
ours = {os.readlink(link).removeprefix("socket:[").rstrip("]") for link in links}
rows = (line.split() for line in Path("/proc/net/udp").read_text().splitlines()[1:])
bound = {row[1].partition(":")[0] for row in rows if row[9] in ours}
print(*sorted(socket.inet_ntoa(bytes.fromhex(address)[::-1]) for address in bound))
node.destroy_node()
rclpy.shutdown()
"""


@pytest.fixture
def environment(monkeypatch):
    """Return a setter of the variables; all others of ours are unset."""
    for name in VARIABLES:
        monkeypatch.setenv(name, "")  # noted, so that it is set back
        monkeypatch.delenv(name)

    def given(**values: str) -> dict[str, str]:
        for name, value in values.items():
            monkeypatch.setenv(name, value)
        return {name: os.environ[name] for name in VARIABLES if name in os.environ}

    return given


def test_this_machine_where_nothing_is_asked_for(environment):
    choose_transport()
    found = environment()
    assert set(found) == {PROFILES_VARIABLE, RANGE_VARIABLE}
    assert "<address>127.0.0.1</address>" in Path(found[PROFILES_VARIABLE]).read_text()


@pytest.mark.parametrize(
    "asked",
    [
        {RANGE_VARIABLE: "SUBNET"},  # as the setup.bash of a ROS installation sets it
        {RANGE_VARIABLE: "SYSTEM_DEFAULT"},
        {"ROS_STATIC_PEERS": "10.0.0.7"},
        {NETWORK_VARIABLE: "0", RANGE_VARIABLE: "SUBNET"},
    ],
)
def test_what_others_set_does_not_open_and_that_is_said(environment, asked):
    environment(**asked)
    name, value = list(asked.items())[-1]
    told = choose_transport()
    assert f"although {name}={value}" in told and f"{NETWORK_VARIABLE}=1" in told
    assert environment()[PROFILES_VARIABLE].endswith("fastdds_localhost.xml")
    assert choose_transport() == ""  # a child inherits it, and need not say it again


def test_a_process_binds_to_this_machine_alone_although_the_subnet_is_set(environment):
    environment(**{RANGE_VARIABLE: "SUBNET"})
    done = subprocess.run(
        [sys.executable, "-c", BOUND], capture_output=True, text=True, timeout=60, check=True
    )
    assert done.stdout.split() == ["127.0.0.1", "239.255.0.1"]


def test_our_own_word_opens_over_udp_with_a_warning(environment):
    environment(**{NETWORK_VARIABLE: "1"})
    assert "enable the drives" in choose_transport()
    found = environment()
    assert found.pop(BUILTIN_VARIABLE).startswith("UDPv4")
    assert found == {RANGE_VARIABLE: "SUBNET", NETWORK_VARIABLE: "1"}


@pytest.mark.parametrize(("before", "after"), [("", "SUBNET"), ("LOCALHOST", "SUBNET"),
                                               ("SYSTEM_DEFAULT", "SYSTEM_DEFAULT")])  # fmt: skip
def test_opening_tells_what_becomes_possible(environment, before, after):
    environment(**{RANGE_VARIABLE: before})
    assert "enable the drives" in place.open_to_network()
    assert environment()[RANGE_VARIABLE] == after


def test_localhost_is_kept_by_a_profile(environment):
    environment(**{RANGE_VARIABLE: "LOCALHOST"})
    choose_transport()
    found = environment()
    assert set(found) == {PROFILES_VARIABLE, RANGE_VARIABLE}
    assert "<address>127.0.0.1</address>" in Path(found[PROFILES_VARIABLE]).read_text()
    choose_transport()  # children inherit it and find it done
    assert environment() == found


@pytest.mark.parametrize("name", [BUILTIN_VARIABLE, PROFILES_VARIABLE])
def test_a_users_wish_is_respected(environment, name):
    before = environment(**{name: "his own", RANGE_VARIABLE: "LOCALHOST"})
    choose_transport()
    assert environment() == before


def test_other_rmw_implementations_are_left_alone(environment, monkeypatch):
    monkeypatch.setattr(
        place, "get_rmw_implementation_identifier", lambda: "rmw_cyclonedds_cpp"
    )
    before = environment(**{RANGE_VARIABLE: "LOCALHOST"})
    choose_transport()
    assert environment() == before


@pytest.mark.parametrize("discovery_range", ["LOCALHOST", "OFF"])
def test_no_shared_memory_is_in_use(environment, discovery_range):
    environment(**{RANGE_VARIABLE: discovery_range})
    done = subprocess.run(
        [sys.executable, "-c", THREADS], capture_output=True, text=True, timeout=60, check=True
    )
    names = done.stdout.split()
    assert any(name.startswith("dds.udp.") for name in names)
    assert not any(name.startswith("dds.shm") for name in names)


@pytest.mark.parametrize("given", ["LOCALHOST", "SYSTEM_DEFAULT", ""])
def test_a_child_whose_range_was_set_once_more_uses_no_shared_memory_either(environment, given):
    """With the profile inherited and LOCALHOST set again, rmw_fastrtps made shared memory of it."""
    choose_transport()
    environment(**{RANGE_VARIABLE: given})
    assert choose_transport() == ""
    assert environment()[RANGE_VARIABLE] == "SYSTEM_DEFAULT"
    assert environment()[PROFILES_VARIABLE].endswith("fastdds_localhost.xml")
