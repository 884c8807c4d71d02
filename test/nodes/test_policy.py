# SPDX-License-Identifier: Apache-2.0
"""The SROS2 policy allows each node what it must do; `test_graph.py` compares it with the graph."""

from __future__ import annotations

from policy_profiles import CLOCK, NODES, policy

from screw_module_ros.graph import BESIDE, MODULE, WHOLE
from screw_module_ros.operator import client

OTHERS = ["game", "operator"]
SHARED = (MODULE, WHOLE)


def test_an_enclave_for_each_executable_and_no_other():
    found = policy()
    assert sorted(found) == sorted([*NODES, *(s.executable for s in SHARED), *BESIDE, *OTHERS])
    for name in (*NODES, "therapy_session", "web_bridge", *OTHERS):
        assert list(found[name]) == [name]
    assert list(found["characterize"]) == ["characterize", "characterize_client"]
    for shared in SHARED:
        assert found[shared.executable] == {name: found[name][name] for name in shared.parts}


def test_a_game_plays_and_does_no_more():
    game = policy()["game"]["game"]
    assert game.publish == {"/rosout", "/parameter_events", "/therapy/wish", "/therapy/score"}
    assert game.subscribe == {CLOCK, "/endpoint_state", "/therapy/state", "/therapy/trial"}
    assert not game.request and not game.call and not game.execute


def test_only_who_must_commands_the_drive():
    found = policy()
    may = {node for enclave in found.values() for node, profile in enclave.items()
           if "/screw/force_command" in profile.publish}  # fmt: skip
    assert may == {"impedance_controller"}
    excites = {node for enclave in found.values() for node, profile in enclave.items()
               if "/screw/excitation" in profile.publish}  # fmt: skip
    assert excites == {"characterize"}
    enables = {node for enclave in found.values() for node, profile in enclave.items()
               if "/amplifier/enable" in profile.request}  # fmt: skip
    assert enables == {"operator", "characterize_client"}


def test_the_door_without_a_games_limits_is_not_a_games():
    """A wish is limited and yields to a session; a set point does neither."""
    found = policy()
    may = {node for enclave in found.values() for node, profile in enclave.items()
           if "/setpoint" in profile.publish}  # fmt: skip
    assert may == {"therapy_session", "operator", "characterize_client"}


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


def test_the_operator_may_do_what_the_client_does():
    """`Robot` waits for each state, and sets all values of a call together or none."""
    operator = policy()["operator"]["operator"]
    assert {f"/{topic}" for topic in client.STATES.values()} <= operator.subscribe
    set_one_by_one = {name for name in operator.request if name.endswith("/set_parameters")}
    assert set_one_by_one
    assert {f"{name}_atomically" for name in set_one_by_one} <= operator.request
