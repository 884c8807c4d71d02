# SPDX-License-Identifier: Apache-2.0
"""Odd service requests and parameter values into every node, in this process.

Nodes that need no device are active, drivers are not configured. A service answers, in one
sentence; a callback that raised would have ended the node.
"""

from __future__ import annotations

import os
import random
import sys
from collections import Counter
from pathlib import Path
from typing import Any
from unittest.mock import patch

import rclpy
from node_classes import node_class
from odd_messages import filled
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.logging import LoggingSeverity
from rclpy.signals import SignalHandlerOptions
from runner import sentence
from screw_module_msgs.srv import SetArm

from screw_module_ros import graph
from screw_module_ros.nodes.support.node import Node
from screw_module_ros.plant.patient import TRAITS
from screw_module_ros.trials.runner import own_place

WITHOUT_DEVICE = ("supervisor", "endpoint_state", "impedance_controller", "session_recorder",
                  "therapy_session", "sim_rig")  # fmt: skip
DRIVERS = ("encoder", "force_sensor", "amplifier", "manus", "characterize")
_ENDS = range(5, 9)  # transitions that end a node for good, as they should


class NodeRequests:
    """One case: one service of one node, with a request that nobody should send."""

    def __init__(self, folder: Path):
        self.counts: Counter[str] = Counter()
        os.environ.setdefault("ROS_LOG_DIR", str(folder))
        self._place = own_place()
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        self._nodes: list[Node] = []
        try:
            self._make_nodes(folder)
        except BaseException:
            self.close()  # else the next user of rclpy in this process fails
            raise

    def _make_nodes(self, folder: Path) -> None:
        for name in (*WITHOUT_DEVICE, *DRIVERS):
            node = _made(name, folder, [])
            self._nodes.append(node)
            node.get_logger().set_level(LoggingSeverity.FATAL)
            node.parameters.finish()
            if node.get_name() in WITHOUT_DEVICE:
                node.trigger_configure()
                node.trigger_activate()

    def close(self) -> None:
        """End the nodes."""
        for node in self._nodes:
            node.get_logger().set_level(LoggingSeverity.UNSET)  # levels outlive nodes and contexts
            node.close()
            node.destroy_node()
            node.clock.close()
        rclpy.try_shutdown()
        self._place.release()

    def case(self, rng: random.Random) -> None:
        """Call one service."""
        node = rng.choice(self._nodes)
        service = rng.choice(list(node.services))
        request = self._request(rng, node, service.srv_type)
        name = service.srv_name.rpartition("/")[2]
        if name == "change_state":
            if request.transition.id in _ENDS or "driver" in self._kind(node):
                return
            request.transition.label = ""
        try:
            answer = service.callback(request, service.srv_type.Response())
        except Exception as error:
            raise AssertionError(f"{node.get_name()} {name}: {request}") from error
        self._note(name, answer)

    def _kind(self, node: Node) -> str:
        return "driver" if node.get_name() in DRIVERS else "node"

    def _request(self, rng: random.Random, node: Node, kind: Any) -> Any:
        request = filled(rng, kind.Request())
        if kind in (SetParameters, SetParametersAtomically):
            known = list(node._parameters)
            request.parameters = [
                filled(rng, ParameterMessage()) for _ in range(rng.randrange(1, 4))
            ]
            for parameter in request.parameters:
                if rng.random() < 0.9:
                    parameter.name = rng.choice(known)
        if kind is SetArm and rng.random() < 0.9:
            request.traits = [rng.choice((*TRAITS, "x")) for _ in request.values]
            request.patient = rng.choice(("", "", *graph.PATIENTS, "x"))
        return request

    def _note(self, name: str, answer: Any) -> None:
        success = getattr(answer, "success", None)
        if success is not None:
            if not success and hasattr(answer, "message"):
                sentence(answer.message)
            self.counts[f"{name}: {'done' if success else 'refused'}"] += 1
            return
        results = getattr(answer, "results", None) or getattr(answer, "result", None)
        for result in results if isinstance(results, list) else [results]:
            if hasattr(result, "successful"):
                if not result.successful:
                    sentence(result.reason)
                self.counts[f"{name}: {'set' if result.successful else 'refused'}"] += 1
            else:
                self.counts[f"{name}: answered"] += 1


def _made(name: str, folder: Path, ports: list[str]) -> Node:
    words = [name, "--ros-args", "-p", "autostart:=false", *ports]
    if name in ("session_recorder", "characterize", "therapy_session"):
        words += ["-p", f"folder:={folder}"]
    with patch.object(sys, "argv", words):
        return node_class(name)()
