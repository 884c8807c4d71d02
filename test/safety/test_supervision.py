# SPDX-License-Identifier: Apache-2.0
"""The supervisor permits nothing while anything is wrong, and nothing comes back by itself."""

import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.safety.supervision import (
    ALL_NODES,
    OK,
    STOPPED,
    WAITING,
    NodeReport,
    SupervisionSettings,
    SupervisorState,
    decide,
    estop,
    kept,
    lock,
    reset,
    restored,
)

SETTINGS = SupervisionSettings()
HEALTHY = {node: NodeReport(seen=True, age=0.01) for node in ALL_NODES}
MOVING = HEALTHY | {"amplifier": NodeReport(seen=True, age=0.01, enabled=True)}
NOW = 5_000_000_000


def after(*all_reports, state=None, settings=SETTINGS, now_ns=NOW):
    """Decision and state after a series of reports, 20 ms apart."""
    state, decision = state or SupervisorState(), None
    for step, reports in enumerate(all_reports):
        decision, state = decide(settings, state, reports, now_ns + step * 20_000_000)
    return decision, state


def changed(reports, node, **values):
    return reports | {node: reports[node]._replace(**values)}


def test_everything_there_permits_motion():
    decision, _ = after(HEALTHY)
    assert decision == (OK, True, True, True, ())


@pytest.mark.parametrize("node", ALL_NODES)
def test_a_node_never_seen_is_waited_for(node):
    decision, state = after(HEALTHY | {node: NodeReport(seen=False)})
    assert (decision.level, decision.motion_permitted) == (WAITING, False)
    assert decision.reasons == (f"{node}: not seen yet",)
    assert after(HEALTHY, state=state)[0].level == OK


def test_no_reports_at_all_is_waiting():
    decision, _ = after({})
    assert decision.level == WAITING
    assert len(decision.reasons) == len(ALL_NODES)


@pytest.mark.parametrize("node", ALL_NODES)
@pytest.mark.parametrize("age", [0.2001, 1e9, math.nan, math.inf])
def test_a_node_lost_while_enabled_stops_and_stays_stopped(node, age):
    decision, state = after(MOVING, changed(MOVING, node, age=age))
    assert decision.level == STOPPED
    assert decision.reasons == (f"{node}: no message for more than 0.2 s",)
    decision, _ = after(HEALTHY, HEALTHY, state=state)
    assert (decision.level, decision.motion_permitted) == (STOPPED, False)


@pytest.mark.parametrize("node", ALL_NODES)
def test_a_node_lost_while_nothing_is_enabled_is_only_waited_for(node):
    decision, state = after(HEALTHY, changed(HEALTHY, node, age=1.0))
    assert decision.level == WAITING
    assert after(HEALTHY, state=state)[0].level == OK


@pytest.mark.parametrize("flag", ["faulted", "error"])
@pytest.mark.parametrize("node", ALL_NODES)
def test_a_fault_in_the_very_message_that_ends_enabled_is_latched(node, flag):
    """The amplifier drops enabled and raises its fault in one message."""
    decision, state = after(
        MOVING, changed(HEALTHY, node, **{flag: True}, reason="over-temperature")
    )
    assert decision.reasons[0] == f"{node}: over-temperature"
    assert after(HEALTHY, state=state)[0].level == STOPPED


def test_a_fault_while_nothing_is_enabled_stops_until_it_is_cleared():
    faulty = changed(HEALTHY, "amplifier", faulted=True, reason="undervoltage")
    decision, state = after(faulty)
    assert decision.level == STOPPED
    assert after(HEALTHY, state=state)[0].level == OK


def test_estop_is_latched_until_reset():
    decision, state = after(HEALTHY, HEALTHY, state=estop(SupervisorState()))
    assert decision.level == STOPPED
    assert decision.reasons == ("emergency stop",)
    state, refusal = reset(SETTINGS, state, HEALTHY, NOW)
    assert (refusal, state.resets) == ("", 1)
    assert after(HEALTHY, state=state)[0].level == OK


def test_reset_is_refused_while_a_drive_is_enabled():
    """Else an estop could come and go between two messages, unseen by the drive."""
    _, state = after(MOVING)
    state, refusal = reset(SETTINGS, estop(state), MOVING, NOW)
    assert "amplifier: still enabled" in refusal
    assert (state.estopped, state.resets) == (True, 0)


@pytest.mark.parametrize(
    "values", [{"age": 1.0}, {"faulted": True}, {"error": True}, {"age": math.nan}]
)
@pytest.mark.parametrize("node", ["encoder", "force_sensor", "amplifier", "manus"])
def test_reset_is_refused_while_the_cause_persists(node, values):
    wrong = changed(HEALTHY, node, **values)
    _, state = after(MOVING, wrong)
    state, refusal = reset(SETTINGS, state, wrong, NOW)
    assert refusal.startswith(f"the cause persists: {node}")
    assert (state.resets, bool(state.latched)) == (0, True)


def test_the_controllers_fault_goes_with_the_reset():
    faulty = changed(HEALTHY, "impedance_controller", faulted=True, reason="encoder: jumped")
    _, state = after(MOVING, faulty)
    state, refusal = reset(SETTINGS, state, faulty, NOW)
    assert (refusal, state.resets) == ("", 1)
    decision, state = after(faulty, state=state)
    assert (decision.level, decision.motion_permitted) == (WAITING, False)
    assert after(HEALTHY, state=state)[0].level == OK


@pytest.mark.parametrize(
    ("after_ns", "level"),
    [(-1, STOPPED), (0, WAITING), (499_999_999, WAITING), (500_000_000, STOPPED)],
)
def test_a_controller_that_does_not_follow_the_reset_is_stopped_again(after_ns, level):
    faulty = changed(HEALTHY, "impedance_controller", faulted=True)
    state, _ = reset(SETTINGS, SupervisorState(), faulty, NOW)
    decision, _ = after(faulty, state=state, now_ns=NOW + after_ns)
    assert decision.level == level
    assert decision.reasons == ("impedance_controller: reports an error",)


@pytest.mark.parametrize("node", ["encoder", "amplifier"])
def test_a_reset_excuses_nobody_else(node):
    state, _ = reset(SETTINGS, SupervisorState(), HEALTHY, NOW)
    assert after(changed(HEALTHY, node, faulted=True), state=state)[0].level == STOPPED


def test_a_node_that_was_heard_just_in_time_is_not_lost():
    assert after(changed(HEALTHY, "encoder", age=0.2))[0].level == OK


def test_faults_come_before_what_is_lost_and_the_emergency_stop_first():
    wrong = changed(changed(MOVING, "encoder", age=1.0), "manus", faulted=True, reason="heat")
    decision, state = after(MOVING, wrong)
    lost = "encoder: no message for more than 0.2 s"
    assert decision.reasons == (lost, "manus: heat")
    assert after(wrong, state=estop(state))[0].reasons == ("emergency stop", lost, "manus: heat")
    resting = wrong | {"amplifier": HEALTHY["amplifier"]}
    decision, state = after(resting, state=estop(SupervisorState()))
    assert decision.reasons == ("emergency stop", "manus: heat", lost) and not state.latched


@pytest.mark.parametrize("node", ALL_NODES)
def test_a_node_never_seen_is_no_cause_that_persists(node):
    missing = HEALTHY | {node: NodeReport(seen=False)}
    assert reset(SETTINGS, estop(SupervisorState()), missing, NOW)[1] == ""
    assert after(missing, state=SupervisorState(enabled=True))[0].reasons[0].startswith(node)


def test_a_reset_while_nothing_is_wrong_forgets_what_was_enabled():
    _, state = after(MOVING, MOVING)
    state, refusal = reset(SETTINGS, state, HEALTHY, NOW)
    assert (refusal, state.enabled, state.reset_ns) == ("", False, NOW)
    decision, state = after(changed(HEALTHY, "manus", age=1.0), HEALTHY, state=state)
    assert decision.level == OK, "a loss after the reset is only waited for"


def test_a_lost_controller_is_not_excused_by_a_reset():
    lost = changed(HEALTHY, "impedance_controller", age=1.0)
    assert "persists" in reset(SETTINGS, SupervisorState(), lost, NOW)[1]


def test_the_pin_takes_the_vertical_permission_only():
    decision, _ = after(HEALTHY, state=lock(SupervisorState(), True))
    assert decision == (OK, True, False, True, ())


@pytest.mark.parametrize(
    ("required", "vertical", "planar"),
    [
        (("encoder", "force_sensor", "impedance_controller", "amplifier"), True, False),
        (("force_sensor", "manus"), False, True),
    ],
)
def test_a_robot_with_one_part_only(required, vertical, planar):
    settings = SupervisionSettings(required=required)
    reports = {node: HEALTHY[node] for node in required}
    decision, _ = after(reports, settings=settings)
    assert decision == (OK, True, vertical, planar, ())


report = st.builds(
    NodeReport,
    st.booleans(),
    st.one_of(st.floats(0.0, 0.4), st.just(math.nan)),
    st.booleans(),
    st.booleans(),
    st.booleans(),
)
likely = st.one_of(st.just(NodeReport(True, 0.01)), report)
event = st.one_of(
    st.fixed_dictionaries(dict.fromkeys(ALL_NODES, likely)),
    st.just(HEALTHY),
    st.just(MOVING),
    st.sampled_from(["estop", "reset", "lock", "unlock"]),
)


@given(st.lists(event, max_size=25), st.lists(st.sampled_from(ALL_NODES), unique=True, max_size=5))
def test_no_sequence_permits_motion_while_anything_is_wrong(events, required):
    settings = SupervisionSettings(required=tuple(required))
    state, reports, now_ns, stopped = SupervisorState(), {}, NOW, False
    for what in events:
        now_ns += 20_000_000
        if what == "estop":
            state, stopped = estop(state), True
        elif what == "reset":
            state, refusal = reset(settings, state, reports, now_ns)
            stopped = stopped and refusal != ""
        elif what in ("lock", "unlock"):
            state = lock(state, what == "lock")
        else:
            reports = what
        decision, state = decide(settings, state, reports, now_ns)
        stopped = stopped or bool(state.latched)
        required_reports = [reports.get(node, NodeReport(False)) for node in required]
        fine = all(
            r.seen and r.age <= 0.2 and not r.faulted and not r.error for r in required_reports
        )
        assert decision.motion_permitted == (fine and not stopped)
        assert decision.motion_permitted == (decision.level == OK)
        assert decision.motion_permitted == (not decision.reasons)
        assert decision.vertical_permitted <= (decision.motion_permitted and not state.locked)
        assert decision.planar_permitted <= decision.motion_permitted


# -- started anew ----------------------------------------------------------------------------------


@pytest.mark.parametrize("estopped", [False, True])
@pytest.mark.parametrize("locked", [False, True])
@pytest.mark.parametrize("latched", [(), ("encoder: lost", "manus: too")])
def test_what_is_stopped_or_locked_survives_a_restart(estopped, locked, latched):
    state = SupervisorState(latched, estopped, locked, enabled=True, resets=3, reset_ns=NOW)
    values = json.loads(json.dumps(kept(state)))
    assert bool(values) == (estopped or locked or bool(latched))
    again = restored(values)
    assert (again.estopped, again.locked, again.enabled, again.resets) == (
        estopped, locked, False, 0
    )  # fmt: skip
    assert again.latched == tuple(f"before the supervisor was started anew: {r}" for r in latched)
    assert restored(kept(again)) == again, "told once, however often it is started"


def test_a_restored_stop_ends_by_a_reset_alone_and_the_lock_by_unlocking():
    decision, state = after(
        HEALTHY, HEALTHY, state=restored({"estopped": True, "locked": True, "latched": ["x"]})
    )
    assert decision.level == STOPPED and not decision.motion_permitted
    state, refusal = reset(SETTINGS, state, HEALTHY, NOW)
    decision, state = after(HEALTHY, state=state)
    assert (refusal, decision.level, decision.vertical_permitted) == ("", OK, False)
    assert kept(state) == {"estopped": False, "locked": True, "latched": []}
    assert kept(lock(state, False)) == {}


@pytest.mark.parametrize(
    "values",
    [
        None, [], 1, "estopped", {"estopped": True},
        {"estopped": 1, "locked": False, "latched": []},
        {"estopped": True, "locked": None, "latched": []},
        {"estopped": True, "locked": False, "latched": "encoder"},
        {"estopped": True, "locked": False, "latched": [1]},
        {"estopped": True, "locked": False, "latched": [], "more": 1},
    ],
)  # fmt: skip
def test_what_nobody_kept_is_refused(values):
    with pytest.raises(ValueError, match=r"wanted|must be"):
        restored(values)
