# SPDX-License-Identifier: Apache-2.0
"""The SROS2 policy allows each node of the graph what it does, and nothing else."""

from __future__ import annotations

from typing import NamedTuple
from xml.etree import ElementTree

import pytest
from rclpy.node import Node

from screw_module_ros.graph import (
    BESIDE,
    COMPOSED,
    ENCODER_DECIMATED,
    FORCE_DECIMATED,
    GRAPH,
)
from screw_module_ros.nodes import bringup
from screw_module_ros.nodes.support.plan import ENCLAVES
from screw_module_ros.operator.robot import Robot
from screw_module_ros.resources import resource_path
from screw_module_ros.trials.graph_run import GraphRun

POLICY = "security/policy.xml"
NODES = [entry.executable for entry in GRAPH]
OTHERS = ["game", "operator"]
CLOCK = "/clock"  # rclpy hears it until the node has chosen its clock
KINDS = ("publish", "subscribe", "reply", "request", "execute", "call")


class Profile(NamedTuple):
    """What one node may do; full names, in the root namespace."""

    publish: frozenset[str]
    subscribe: frozenset[str]
    reply: frozenset[str]
    request: frozenset[str]
    execute: frozenset[str]
    call: frozenset[str]


def _full(node: str, name: str) -> str:
    if name.startswith("~"):
        return f"/{node}{name[1:]}"
    return name if name.startswith("/") else f"/{name}"


def _profile(element: ElementTree.Element) -> Profile:
    node, found = element.get("node"), {kind: set() for kind in KINDS}
    assert element.get("ns") == "/"
    for block in element:
        (kind,) = block.attrib
        assert block.get(kind) == "ALLOW"
        names = [_full(node, expression.text) for expression in block]
        assert len(names) == len(set(names))
        assert not any("*" in name for name in names), "least privilege has no patterns"
        found[kind] |= set(names)
    return Profile(**{kind: frozenset(names) for kind, names in found.items()})


def policy() -> dict[str, dict[str, Profile]]:
    """Return enclave -> node -> profile."""
    root = ElementTree.parse(resource_path(POLICY)).getroot()
    return {
        enclave.get("path").removeprefix(f"{ENCLAVES}/"): {
            profile.get("node"): _profile(profile) for profile in enclave.iter("profile")
        }
        for enclave in root.iter("enclave")
    }


def test_an_enclave_for_each_executable_and_no_other():
    found = policy()
    assert sorted(found) == sorted([*NODES, COMPOSED.executable, *BESIDE, *OTHERS])
    for name in (*NODES, "therapy_session", "web_bridge", *OTHERS):
        assert list(found[name]) == [name]
    assert list(found["characterize"]) == ["characterize", "characterize_client"]
    parts = {name: found[name][name] for name in COMPOSED.parts}
    assert found[COMPOSED.executable] == parts


def test_a_game_plays_and_does_no_more():
    game = policy()["game"]["game"]
    assert game.publish == {"/rosout", "/parameter_events", "/setpoint", "/therapy/wish"}
    assert game.subscribe == {CLOCK, "/endpoint_state", "/therapy/state", "/therapy/trial"}
    assert not game.request and not game.call and not game.execute


def test_only_who_must_commands_the_drive():
    found = policy()
    may = {node for enclave in found.values() for node, profile in enclave.items()
           if "/screw/force_command" in profile.publish}  # fmt: skip
    assert may == {"impedance_controller", "characterize"}
    enables = {node for enclave in found.values() for node, profile in enclave.items()
               if "/amplifier/enable" in profile.request}  # fmt: skip
    assert enables == {"operator", "characterize_client"}


def test_only_the_therapy_node_takes_the_slot():
    found = policy()
    may = {node for enclave in found.values() for node, profile in enclave.items()
           if "/therapy/slot" in profile.publish}  # fmt: skip
    assert may == {"therapy_session"}


def test_the_bridge_moves_nothing_and_switches_nothing_on():
    bridge = policy()["web_bridge"]["web_bridge"]
    moves = {"/setpoint", "/therapy/slot", "/screw/force_command"}
    assert not bridge.publish & moves
    assert not [name for name in bridge.request if name.endswith(("enable", "reset", "home"))]


def test_who_asks_asks_what_is_offered():
    found = policy()
    offered = {name for enclave in found.values() for profile in enclave.values()
               for name in profile.reply}  # fmt: skip
    run = {name for enclave in found.values() for profile in enclave.values()
           for name in profile.execute}  # fmt: skip
    for enclave in found.values():
        for profile in enclave.values():
            assert profile.request <= offered
            assert profile.call <= run


def _names(pairs: list) -> frozenset[str]:
    return frozenset(name for name, _ in pairs)


def _seen(node: Node, name: str) -> Profile:
    """Return what a running node has, actions apart."""
    services = _names(node.get_service_names_and_types_by_node(name, "/"))
    published = _names(node.get_publisher_names_and_types_by_node(name, "/"))
    actions = {name.partition("/_action/")[0] for name in published if "/_action/" in name}
    return Profile(
        frozenset(name for name in published if "/_action/" not in name),
        _names(node.get_subscriber_names_and_types_by_node(name, "/")),
        frozenset(name for name in services if "/_action/" not in name),
        _names(node.get_client_names_and_types_by_node(name, "/")),
        frozenset(actions),
        frozenset(),
    )


def _all_seen(node: Node, found: dict, seen: dict) -> bool:
    """Look at the graph; return whether all that the policy names has been discovered."""
    seen.update({name: _seen(node, name) for name in (*NODES, *BESIDE)})
    waited = [(found[name][name], seen[name]) for name in NODES if name != "session_recorder"]
    return all(
        has.publish >= allowed.publish
        and has.reply >= allowed.reply
        and has.subscribe >= allowed.subscribe - {CLOCK}
        for allowed, has in waited
    )


@pytest.mark.graph
def test_the_policy_is_the_running_graph():
    """What each node publishes, hears, offers and runs, name by name.

    What the recorder hears and asks is what there is; what `characterize` takes over while an
    experiment runs is allowed beyond what it has when idle.
    """
    found, seen = policy(), {}
    with GraphRun() as graph:
        simulated = ["--ros-args", "-p", "use_sim_time:=true"]
        of_any_port = {"web_bridge": ["-p", "port:=0"]}
        ours = [
            bringup.Process(name, [*simulated, *of_any_port.get(name, [])]) for name in BESIDE
        ]
        try:
            with Robot("operator", watch=graph.watch, simulated=True) as robot:
                robot.wait_until_ready([*graph.names, *BESIDE])
                robot.met(lambda: _all_seen(robot.node, found, seen), 20.0)
        finally:
            bringup.stop(ours)
    for name in (*NODES, "therapy_session", "web_bridge"):
        allowed, has = found[name][name], seen[name]
        assert allowed.publish == has.publish, name
        assert allowed.reply == has.reply, name
        if name != "session_recorder":
            assert allowed.subscribe - {CLOCK} == has.subscribe - {CLOCK}, name
            assert allowed.request == has.request, name
    idle, allowed = seen["characterize"], found["characterize"]["characterize"]
    assert allowed.publish - idle.publish == {"/screw/force_command", "/screw/controller_state"}
    assert (allowed.subscribe - {CLOCK}, allowed.reply, allowed.execute) == (
        idle.subscribe - {CLOCK}, idle.reply, idle.execute
    )  # fmt: skip
    published = frozenset().union(*(profile.publish for profile in seen.values()), {"/setpoint"})
    slow = {f"/{name}" for name in (ENCODER_DECIMATED, FORCE_DECIMATED)}  # never recorded
    recorder = found["session_recorder"]["session_recorder"]
    assert recorder.subscribe == published - slow
    asked = {f"/{name}/{service}" for name in (*NODES, *BESIDE) if name != "session_recorder"
             for service in ("get_parameters", "list_parameters")}  # fmt: skip
    assert recorder.request == asked
