# SPDX-License-Identifier: Apache-2.0
"""What the SROS2 policy allows each node, and what a running node has."""

from __future__ import annotations

from typing import NamedTuple
from xml.etree import ElementTree

from rclpy.node import Node

from screw_module_ros.graph import BESIDE, GRAPH
from screw_module_ros.nodes.bringup import ENCLAVES
from screw_module_ros.resources import resource_path

POLICY = "security/policy.xml"
NODES = [entry.executable for entry in GRAPH]
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


def _names(pairs: list) -> frozenset[str]:
    return frozenset(name for name, _ in pairs)


def seen_of(node: Node, name: str) -> Profile:
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


def all_seen(node: Node, found: dict, seen: dict) -> bool:
    """Look at the graph; return whether all that the policy names has been discovered."""
    seen.update({name: seen_of(node, name) for name in (*NODES, *BESIDE)})
    waited = [(found[name][name], seen[name]) for name in NODES if name != "session_recorder"]
    return all(
        has.publish >= allowed.publish
        and has.reply >= allowed.reply
        and has.subscribe >= allowed.subscribe - {CLOCK}
        for allowed, has in waited
    )
