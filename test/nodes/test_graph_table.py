# SPDX-License-Identifier: Apache-2.0
"""The table of the graph: what is started apart, what composed, and on which cores."""

from __future__ import annotations

import pytest

from screw_module_ros.nodes.support.graph import (
    COMPOSED,
    GRAPH,
    chosen,
    nodes_of,
    placement,
    table,
)


def test_composed_has_the_same_nodes_in_the_same_order():
    """Four executables become one; no node comes or goes."""
    apart = [entry.executable for entry in GRAPH]
    composed = table(composed=True)
    assert sorted(node for entry in composed for node in entry.nodes) == sorted(apart)
    started = [entry.executable for entry in composed]
    assert len(started) == len(apart) - 3
    left = [name for name in started if name != "module"]
    assert left == [name for name in apart if name not in COMPOSED.parts]
    assert started.index("supervisor") < started.index("module") < started.index("manus")


def test_what_is_in_the_module_cannot_be_started_beside_it():
    """A name of the other table is refused, and the sentence says what there is."""
    with pytest.raises(ValueError, match="no node 'encoder' in the graph; there are .*module"):
        chosen(True, only=["encoder"], composed=True)
    with pytest.raises(ValueError, match="no node 'module'"):
        chosen(True, only=["module"])
    (entry,) = chosen(False, only=["module"], composed=True)
    assert entry == COMPOSED
    assert "sim_rig" not in [entry.executable for entry in chosen(False, composed=True)]


def test_all_parts_of_the_module_share_its_core():
    """One process has one set of cores, whichever part is asked."""
    words = placement(2, composed=True)
    cores = {word for word in words if word.split(":realtime")[0] in COMPOSED.parts}
    assert cores == {f"{part}:realtime.cores:=[0]" for part in COMPOSED.parts}
    assert placement(4, composed=True) == []


def test_nodes_of_an_executable():
    """One each, but for the module."""
    assert nodes_of("manus") == ("manus",)
    assert nodes_of("module") == COMPOSED.parts
