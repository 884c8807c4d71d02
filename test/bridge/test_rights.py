# SPDX-License-Identifier: Apache-2.0
"""Who may do what: the table attacked name by name."""

from __future__ import annotations

import re

import pytest

from screw_module_ros.bridge.pages import FOLDER
from screw_module_ros.bridge.rights import (
    CALL,
    LIMITS,
    PATIENT,
    PATIENTS_STOP,
    PRESSES,
    PUBLISH,
    ROLES,
    SERVICES,
    SUBSCRIBE,
    THERAPIST,
    Denied,
    Rights,
    pressed,
)


@pytest.mark.parametrize("role", ROLES)
@pytest.mark.parametrize("wishes", [False, True])
@pytest.mark.parametrize("name", [
    "setpoint", "/setpoint", "//setpoint", "/therapy/../setpoint", "screw/force_command",
    "therapy/slot", "/left/setpoint", "safety_state", "", "/",
])  # fmt: skip
def test_nobody_publishes_what_moves_the_robot(role, wishes, name):
    with pytest.raises(Denied):
        Rights(["/"], wishes).may(role, PUBLISH, name)


def test_a_refused_set_point_tells_the_way():
    with pytest.raises(Denied, match="a game publishes therapy/wish"):
        Rights(["/"]).may(PATIENT, PUBLISH, "/setpoint")


def test_the_patient_reads_what_the_patients_page_shows():
    rights = Rights(["/"])
    for name in ("therapy/wish", "therapy/attendance", *SERVICES):
        with pytest.raises(Denied):
            rights.may(PATIENT, PUBLISH, name)
    for name in set(SERVICES) - {PATIENTS_STOP}:
        with pytest.raises(Denied):
            rights.may(PATIENT, CALL, name, arguments={"names": ["wish.high"]})
    assert rights.may(PATIENT, CALL, PATIENTS_STOP).type == "std_srvs/srv/Trigger"
    for name in ("/endpoint_state", "/therapy/state"):
        assert rights.may(PATIENT, SUBSCRIBE, name).full == name
    for name in ("therapy/trial", "therapy/assistance", "safety_state", "screw/encoder"):
        with pytest.raises(Denied):  # its token could read the results
            rights.may(PATIENT, SUBSCRIBE, name)


def test_the_patient_may_wish_where_that_is_allowed():
    rights = Rights(["/"], wishes=True)
    wish = rights.may(PATIENT, PUBLISH, "therapy/wish")
    assert wish.type == "screw_module_msgs/msg/EndpointSetpoint"
    with pytest.raises(Denied):
        rights.may(PATIENT, PUBLISH, "therapy/attendance")
    rights.wishes = False
    with pytest.raises(Denied):
        rights.may(PATIENT, PUBLISH, "therapy/wish")


@pytest.mark.parametrize("name", [
    "amplifier/enable", "supervisor/reset", "manus/enable", "encoder/home", "sim_rig/inject_fault",
    "therapy_session/change_state", "supervisor/set_parameters", "impedance_controller/set_mode",
])  # fmt: skip
def test_no_page_switches_on_or_releases(name):
    with pytest.raises(Denied):
        Rights(["/"]).may(THERAPIST, CALL, f"/{name}")


def test_the_therapist_calls_what_the_page_offers():
    rights = Rights(["/"])
    for name in ("therapy_session/start", "therapy_session/abort", "therapy_session/weigh",
                 "therapy_session/lower", "supervisor/estop"):  # fmt: skip
        assert rights.may(THERAPIST, CALL, f"/{name}").name == name
    names = {"names": list(LIMITS)}
    assert rights.may(THERAPIST, CALL, "/therapy_session/get_parameters", arguments=names)
    values = {"parameters": [{"name": name, "value": {}} for name in LIMITS]}
    assert rights.may(THERAPIST, CALL, "/therapy_session/set_parameters", arguments=values)


@pytest.mark.parametrize("arguments", [
    {}, {"names": []}, {"names": ["folder"]}, {"names": ["wish.high", "use_sim_time"]},
    {"parameters": [{"name": "autostart"}]}, {"parameters": [{}]}, {"parameters": [["wish.high"]]},
    {"parameters": "wish.high"}, {"parameters": [{"name": ["wish.high"]}]},
    {"names": ["wish.high"], "parameters": [{"name": "folder"}]},
])  # fmt: skip
def test_other_parameters_are_out_of_reach(arguments):
    with pytest.raises(Denied):
        Rights(["/"]).may(
            THERAPIST, CALL, "/therapy_session/set_parameters", arguments=arguments
        )


@pytest.mark.parametrize("name", ["therapy_session/weigh", "therapy_session/lower",
                                  "therapy_session/set_parameters"])  # fmt: skip
def test_a_patients_token_reaches_nothing_of_the_support(name):
    with pytest.raises(Denied):
        Rights(["/"], wishes=True).may(PATIENT, CALL, name)
    for topic in ("screw/controller_state", "screw/amplifier_state"):
        with pytest.raises(Denied):
            Rights(["/"]).may(PATIENT, SUBSCRIBE, topic)


def test_each_robot_has_its_names():
    rights = Rights(["/left", "/right"])
    assert rights.may(PATIENT, SUBSCRIBE, "/right/endpoint_state").full == "/right/endpoint_state"
    assert rights.may(PATIENT, SUBSCRIBE, "endpoint_state").full == "/left/endpoint_state"
    for name in ("/endpoint_state", "/middle/endpoint_state", "/left/right/endpoint_state"):
        with pytest.raises(Denied):
            rights.may(PATIENT, SUBSCRIBE, name)
    assert len(rights.places(SUBSCRIBE)) == 2 * len(ROLES[THERAPIST][SUBSCRIBE])
    rights = Rights(["/left", "/next"])  # as long as each other
    assert rights.may(PATIENT, SUBSCRIBE, "/next/endpoint_state").robot == "/next"


def test_no_role_has_what_the_bridge_does_not_subscribe_publish_or_call():
    rights = Rights(["/"], wishes=True)
    for verb in (SUBSCRIBE, PUBLISH, CALL):
        offered = {place.name for place in rights.places(verb)}
        assert all(set(role[verb]) <= offered for role in ROLES.values())


def test_types_are_meant_by_either_spelling():
    rights, name = Rights(["/"]), "/endpoint_state"
    for kind in ("", "screw_module_msgs/msg/EndpointState", "screw_module_msgs/EndpointState"):
        assert rights.may(PATIENT, SUBSCRIBE, name, kind).full == name
    for kind in ("screw_module_msgs/Other", "EndpointState", "std_msgs/String"):
        with pytest.raises(Denied, match="has the type screw_module_msgs/msg/EndpointState"):
            rights.may(PATIENT, SUBSCRIBE, name, kind)


@pytest.mark.parametrize("role", ROLES)
def test_a_page_tells_of_its_own_buttons_and_of_nothing_typed(role):
    for name in PRESSES[role]:
        assert pressed(role, {"msg": name}) == name
    of_others = {name for other in ROLES for name in PRESSES[other]} - set(PRESSES[role])
    wrong = (None, ["back"], "Erika Mustermann", *of_others)
    for content in ("fruit", None, {}, *({"msg": each} for each in wrong)):
        with pytest.raises(Denied, match="msg is one of"):
            pressed(role, content)


@pytest.mark.parametrize("role", ROLES)
def test_each_named_button_of_a_page_is_one_that_it_may_tell_of(role):
    files = [FOLDER / f"{role}.html", *(FOLDER / "js" / role).glob("*.js")]
    told = "".join(file.read_text("utf-8") for file in files)
    named = set(re.findall(r'<button[^>]* name="(\w+)"|"button", \{ name: "(\w+)"', told))
    chosen = {"fruit", "free"} if role == PATIENT else set()  # made in a loop
    assert {"".join(each) for each in named} | chosen == set(PRESSES[role])
