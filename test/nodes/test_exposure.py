# SPDX-License-Identifier: Apache-2.0
"""From another machine, here a network namespace, a node is seen only where it was opened."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from screw_module_ros.nodes.bringup import executable_path

pytestmark = [pytest.mark.graph, pytest.mark.long]

RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
CHOICES = ("SCREW_MODULE_NETWORK", "FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_BUILTIN_TRANSPORTS",
           "ROS_LOCALHOST_ONLY", "ROS_STATIC_PEERS")  # fmt: skip
# Looks until it sees the node that it is told of, then on for several rounds of announcements.
LOOKS = """
import sys, threading
import rclpy
rclpy.init()
node, pause, seen = rclpy.create_node("stranger"), threading.Event(), set()
for _ in range(600):
    seen |= set(node.get_node_names())
    if sys.argv[1] in seen:
        break
    pause.wait(0.1)
for _ in range(70):
    seen |= set(node.get_node_names())
    pause.wait(0.1)
print(*sorted(seen))
node.destroy_node()
rclpy.shutdown()
"""


def ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True, capture_output=True)


@pytest.fixture
def machines() -> Iterator[tuple[str, str]]:
    """Return two network namespaces with a cable between them; skip where there are none."""
    if not shutil.which("ip"):
        pytest.skip("needs the command ip")
    names = [f"exposure_{os.getpid()}_{end}" for end in "ab"]
    cable = [f"x{os.getpid()}{end}" for end in "ab"]
    with ExitStack() as left:
        try:
            for name in names:
                ip("netns", "add", name)
                left.callback(ip, "netns", "del", name)
            ip("link", "add", cable[0], "type", "veth", "peer", "name", cable[1])
            for number, (name, end) in enumerate(zip(names, cable, strict=True), 1):
                ip("link", "set", end, "netns", name)
                ip("-n", name, "addr", "add", f"10.77.0.{number}/24", "dev", end)
                for device in ("lo", end):
                    ip("-n", name, "link", "set", device, "up")
                ip("-n", name, "route", "add", "224.0.0.0/4", "dev", end)
        except subprocess.CalledProcessError as error:
            pytest.skip(f"no network namespaces here: {error.stderr.decode().strip()}")
        yield names[0], names[1]


def test_a_stranger_sees_only_what_was_opened(machines, tmp_path):
    here, there = machines
    plain = {name: value for name, value in os.environ.items() if name not in CHOICES}
    # As the setup.bash of a ROS installation sets it, which opens nothing by itself.
    plain |= {"XDG_STATE_HOME": str(tmp_path), RANGE: "SUBNET"}
    opened = {**plain, "SCREW_MODULE_NETWORK": "1"}
    inside, outside = (["ip", "netns", "exec", name] for name in (here, there))
    with ExitStack() as ends:
        for words in (["endpoint_state"], ["supervisor", "--network"]):
            node = subprocess.Popen(
                [*inside, executable_path(words[0]), *words[1:]], env=plain,
                stderr=subprocess.PIPE, text=True,
            )  # fmt: skip
            ends.callback(node.communicate)
            ends.callback(node.terminate)
            assert any("active" in line for line in node.stderr)
        seen = subprocess.run(
            [*outside, sys.executable, "-c", LOOKS, "supervisor"],
            env=opened, capture_output=True, text=True, timeout=100, check=True,
        ).stdout.split()  # fmt: skip
    assert seen == ["stranger", "supervisor"]


def test_a_node_that_waits_for_the_time_of_another_machine_names_it(machines, tmp_path):
    """Its rig is heard, on /clock, but its page of time is in the other's memory."""
    here, there = (["ip", "netns", "exec", name] for name in machines)
    own_memory = ["unshare", "-m", "sh", "-c", 'mount -t tmpfs tmpfs /dev/shm && exec "$@"', "-"]
    env = {name: value for name, value in os.environ.items() if name not in CHOICES}
    env |= {"XDG_STATE_HOME": str(tmp_path)}
    in_simulated_time = ["--network", "--ros-args", "-p", "use_sim_time:=true"]
    with ExitStack() as ends:

        def start(where: list[str], name: str) -> subprocess.Popen:
            command = [*where, executable_path(name), *in_simulated_time]
            node = subprocess.Popen(command, env=env, stderr=subprocess.PIPE, text=True)
            ends.callback(node.communicate)
            ends.callback(node.terminate)
            return node

        assert any("active" in line for line in start(here, "sim_rig").stderr)
        waits = start([*there, *own_memory], "endpoint_state")
        assert any("/clock comes from another machine" in line for line in waits.stderr)
