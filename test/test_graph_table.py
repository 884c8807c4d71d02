# SPDX-License-Identifier: Apache-2.0
"""The table of the graph: what is started, and that everything else that lists it agrees.

That the running graph agrees with the security policy is `test/nodes/test_graph.py`.
"""

from __future__ import annotations

import ast
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest
from rclpy.qos import ReliabilityPolicy

from screw_module_ros.graph import (
    BESIDE,
    BUSES,
    GRAPH,
    MODULE,
    PATIENTS,
    TOPICS,
    Topic,
    chosen,
    interface_class,
    subscribed_by,
    table,
)
from screw_module_ros.nodes.bringup import placement
from screw_module_ros.nodes.support.topics import offered, requested
from screw_module_ros.nodes.support.wire import Layout
from screw_module_ros.plant.settings import patients
from screw_module_ros.recording.counts import TICKED
from screw_module_ros.rig import build

ROOT = Path(__file__).parents[1]
NODES = [entry.executable for entry in GRAPH]
KNOWS_ALL = "session_recorder"  # hears every topic


def test_composed_has_the_same_nodes_in_the_same_order():
    """Four executables become one; no node comes or goes."""
    apart = [entry.executable for entry in GRAPH]
    composed = table(shared=MODULE)
    assert sorted(node for entry in composed for node in entry.nodes) == sorted(apart)
    started = [entry.executable for entry in composed]
    assert len(started) == len(apart) - 3
    left = [name for name in started if name != "module"]
    assert left == [name for name in apart if name not in MODULE.parts]
    assert started.index("supervisor") < started.index("module") < started.index("manus")


def test_what_is_in_the_module_cannot_be_started_beside_it():
    """A name of the other table is refused, and the sentence says what there is."""
    with pytest.raises(ValueError, match="no node 'encoder' in the graph; there are .*module"):
        chosen(True, only=["encoder"], shared=MODULE)
    with pytest.raises(ValueError, match="no node 'module'"):
        chosen(True, only=["module"])
    (entry,) = chosen(False, only=["module"], shared=MODULE)
    assert entry == MODULE
    assert "sim_rig" not in [entry.executable for entry in chosen(False, shared=MODULE)]


def test_all_parts_of_the_module_share_its_core():
    """One process has one set of cores, whichever part is asked."""
    words = placement(2, shared=MODULE)
    cores = {word for word in words if word.split(":realtime")[0] in MODULE.parts}
    assert cores == {f"{part}:realtime.cores:=[0]" for part in MODULE.parts}
    assert placement(4, shared=MODULE) == []


# What lists nodes or topics elsewhere -----------------------------------------------------------


def policy() -> dict[str, dict[str, set[str]]]:
    """Return node -> publish, subscribe -> topics as in the table, from the security policy."""
    found: dict[str, dict[str, set[str]]] = {}
    root = ElementTree.parse(ROOT / "security/policy.xml").getroot()
    for profile in root.iter("profile"):
        names = found.setdefault(profile.get("node"), {"publish": set(), "subscribe": set()})
        for block in profile.iter("topics"):
            (kind,) = block.attrib
            names[kind] |= {resolved(topic.text, profile.get("node")) for topic in block}
    return found


def resolved(name: str, node: str) -> str:
    """Return a topic's name without the namespace of the robot."""
    return name.replace("~", node).removeprefix("/")


def _published_by(node: str) -> list[Topic]:
    """Return the topics that this node alone publishes."""
    return [topic for topic in TOPICS.values() if topic.publisher == node]


@pytest.mark.parametrize("node", [*NODES, "therapy_session"])
def test_the_policy_lets_a_node_publish_and_hear_what_the_table_says(node):
    """A topic that is missing on either side fails here, before a robot refuses it."""
    may = policy()[node]
    ours = {resolved(name, topic.publisher) for name, topic in TOPICS.items()}
    published = {name for name in may["publish"] if name in ours}
    heard = {name for name in may["subscribe"] if name in ours} - {"clock"}
    alone = {resolved(topic.name, node) for topic in _published_by(node)}
    assert published - {"diagnostics", "setpoint"} == alone
    if node != KNOWS_ALL:
        heard_of = {resolved(topic.name, topic.publisher or node) for topic in subscribed_by(node)}
        assert heard == heard_of


def test_every_subscriber_and_publisher_is_a_node():
    """A misspelt node would have no topic."""
    known = {*NODES, *BESIDE}
    for topic in TOPICS.values():
        assert {*topic.subscribers, topic.publisher or "encoder", topic.clock or "encoder"} <= known
    assert {bus.node for bus in BUSES} <= known


@pytest.mark.parametrize("topic", TOPICS.values(), ids=lambda topic: topic.name)
def test_types_and_qualities_are_there(topic):
    """The names in the table lead to message classes and profiles that fit each other."""
    kind, name, profile = offered(topic.name)
    assert (kind, name) == (interface_class(topic.type), topic.name)
    taken, _, wanted = requested(topic.name)
    assert (taken.kind if isinstance(taken, Layout) else taken) is kind
    assert wanted.reliability == profile.reliability and wanted.depth == 1


def test_the_supervisor_hears_each_node_that_moves_or_measures():
    """Its table is made from this one."""
    heard = {topic.publisher for topic in subscribed_by("supervisor") if topic.publisher}
    assert heard == {*NODES} - {"sim_rig", "supervisor", KNOWS_ALL}


def test_ticks_of_a_type_are_known_once():
    """`session verify` finds a topic by its type."""
    assert len(TICKED) == sum(bool(topic.clock) for topic in TOPICS.values())
    assert all(topic.every for topic in TICKED.values())


def test_the_rig_has_the_buses_of_the_table():
    """The rig shares no code with the near end, so its names are its own."""
    assert tuple(bus.name for bus in BUSES) == build.BUSES


def test_setup_installs_every_node():
    """`ros2 run` finds each executable of the table."""
    tree = ast.parse((ROOT / "setup.py").read_text(encoding="utf-8"))
    words = {node.value for node in ast.walk(tree) if isinstance(node, ast.Constant)}
    installed = {str(word).partition(" = ")[0] for word in words}
    assert installed >= {*NODES, MODULE.executable, *BESIDE}


def test_the_page_of_nodes_lists_nodes_and_topics():
    """Its table has each node once, with what it alone publishes."""
    page = (ROOT / "docs/nodes.md").read_text("utf-8")
    rows = re.findall(r"^\| `(\w+)` \| (.+?) \|", page, re.MULTILINE)
    listed = {node: set(re.findall(r"`([\w/~]+)`", cells)) for node, cells in rows}
    decimated = {name for name in TOPICS if name.endswith("/decimated")}
    for node in NODES:
        assert listed[node] == {topic.name for topic in _published_by(node)} - decimated


def test_only_the_two_fastest_topics_need_a_subscription_for_sensor_data():
    """A subscription with default settings is reliable, and hears no best effort publisher."""
    quick = {name for name, topic in TOPICS.items() if topic.qos == "sample"}
    assert quick == {"screw/encoder", "handle/force"}
    for name, topic in TOPICS.items():
        if topic.qos in {"command", "state"}:
            assert offered(name)[2].reliability == ReliabilityPolicy.RELIABLE


def test_the_patients_that_bringup_offers_are_those_of_the_plant():
    assert PATIENTS == tuple(patients())
