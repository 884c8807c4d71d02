# SPDX-License-Identifier: Apache-2.0
"""Which nodes a recording says have not reported their parameters."""

from __future__ import annotations

from types import SimpleNamespace

from screw_module_ros.nodes.recording_parameters import NodeParameters
from screw_module_ros.recording.recorder import NO_ANSWER


class Silent:
    """A graph in which no node answers; names: the nodes that are there."""

    def __init__(self):
        self.names: list[str] = []

    def get_service_names_and_types(self):
        types = ["rcl_interfaces/srv/GetParameters"]
        return [(f"{name}/get_parameters", types) for name in self.names]

    def get_namespace(self):
        return "/"

    def get_fully_qualified_name(self):
        return "/session_recorder"

    def create_client(self, kind, service):
        pending = SimpleNamespace(add_done_callback=lambda done: None)
        return SimpleNamespace(call_async=lambda request: pending)

    def destroy_client(self, client):
        pass


def test_a_node_that_stays_and_keeps_silent_is_noted():
    silent = Silent()
    parameters = NodeParameters(silent)
    silent.names = ["/manus"]
    for _ in range(6):
        parameters.ask()
    assert parameters.values == {"/manus": NO_ANSWER}


def test_a_script_that_is_run_again_and_again_is_not():
    """Each run ends before it could answer; `verify` would call the bag incomplete."""
    silent = Silent()
    parameters = NodeParameters(silent)
    for _ in range(6):
        silent.names = ["/my_script"]
        parameters.ask()
        parameters.ask()
        silent.names = []
        parameters.ask()
    assert parameters.values == {}


def test_the_nodes_of_another_robot_are_not_asked():
    silent = Silent()
    parameters = NodeParameters(silent)
    silent.names = ["/left/manus"]
    for _ in range(6):
        parameters.ask()
    assert parameters.values == {}
