# SPDX-License-Identifier: Apache-2.0
"""Who may do what: tables attacked name by name."""

from __future__ import annotations

import pytest

from screw_module_ros.bridge.rights import (
    ASKED,
    HEARD,
    LIMITS,
    PATIENT,
    ROLES,
    SENT,
    THERAPIST,
    Denied,
    Rights,
)


@pytest.mark.parametrize("role", ROLES)
@pytest.mark.parametrize("wishes", [False, True])
@pytest.mark.parametrize("name", [
    "setpoint", "/setpoint", "//setpoint", "/therapy/../setpoint", "screw/force_command",
    "therapy/slot", "/left/setpoint", "safety_state", "", "/",
])  # fmt: skip
def test_nobody_publishes_what_moves_the_robot(role, wishes, name):
    with pytest.raises(Denied):
        Rights(["/"], wishes).sends(role, name)


def test_a_refused_set_point_tells_the_way():
    with pytest.raises(Denied, match="a game publishes therapy/wish"):
        Rights(["/"]).sends(PATIENT, "/setpoint")


def test_the_patient_reads():
    rights = Rights(["/"])
    for name in (*SENT, *ASKED):
        with pytest.raises(Denied):
            rights.sends(PATIENT, name)
        with pytest.raises(Denied):
            rights.asks(PATIENT, name, {"names": ["wish.high"]})
    assert rights.hears(PATIENT, "/endpoint_state")[0].full == "/endpoint_state"
    with pytest.raises(Denied):
        rights.hears(PATIENT, "/therapy/assistance")


def test_the_patient_may_wish_where_that_is_allowed():
    rights = Rights(["/"], wishes=True)
    assert rights.sends(PATIENT, "therapy/wish")[1] == "screw_module_msgs/msg/EndpointSetpoint"
    with pytest.raises(Denied):
        rights.sends(PATIENT, "therapy/attendance")
    rights.wishes = False
    with pytest.raises(Denied):
        rights.sends(PATIENT, "therapy/wish")


@pytest.mark.parametrize("name", [
    "amplifier/enable", "supervisor/reset", "manus/enable", "encoder/home", "sim_rig/inject_fault",
    "therapy_session/change_state", "supervisor/set_parameters", "impedance_controller/set_mode",
])  # fmt: skip
def test_no_page_switches_on_or_releases(name):
    with pytest.raises(Denied):
        Rights(["/"]).asks(THERAPIST, f"/{name}", {})


def test_the_therapist_asks_for_what_the_page_offers():
    rights = Rights(["/"])
    for name in ("therapy_session/start", "therapy_session/abort", "supervisor/estop"):
        assert rights.asks(THERAPIST, f"/{name}", {})[0].name == name
    rights.asks(THERAPIST, "/therapy_session/get_parameters", {"names": list(LIMITS)})


@pytest.mark.parametrize("arguments", [
    {}, {"names": []}, {"names": ["folder"]}, {"names": ["wish.high", "use_sim_time"]},
    {"parameters": [{"name": "autostart"}]}, {"parameters": [{}]}, {"parameters": [["wish.high"]]},
    {"parameters": "wish.high"}, {"parameters": [{"name": ["wish.high"]}]},
    {"names": ["wish.high"], "parameters": [{"name": "folder"}]},
])  # fmt: skip
def test_other_parameters_are_out_of_reach(arguments):
    with pytest.raises(Denied):
        Rights(["/"]).asks(THERAPIST, "/therapy_session/set_parameters", arguments)


def test_each_robot_has_its_names():
    rights = Rights(["/left", "/right"])
    assert rights.hears(PATIENT, "/right/endpoint_state")[0].full == "/right/endpoint_state"
    assert rights.hears(PATIENT, "endpoint_state")[0].full == "/left/endpoint_state"
    for name in ("/endpoint_state", "/middle/endpoint_state", "/left/right/endpoint_state"):
        with pytest.raises(Denied):
            rights.hears(PATIENT, name)
    assert len(rights.places(HEARD)) == 2 * len(HEARD)
