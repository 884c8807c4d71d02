# SPDX-License-Identifier: Apache-2.0
"""Settings tuples as ROS parameters: start-up values, run-time changes, clear refusals."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import pytest
import rclpy
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions

from screw_module_ros.nodes.support.parameters import Parameters
from screw_module_ros.settings import Setting, SettingError


class Spring(NamedTuple):
    """A law's numbers."""

    stiffness: Annotated[float, Setting("spring", "N/m", 0.0, 5000.0, live=True)] = 100.0
    axes: Annotated[tuple[float, float], Setting("per axis", "m", -1.0, 1.0)] = (0.1, 0.2)
    kind: Annotated[str, Setting("kind", choices=("soft", "hard"))] = "soft"
    cores: Annotated[tuple, Setting("whole numbers", "", -1, 9)] = (-1,)
    place: Annotated[str, Setting("a folder", at_start=True)] = ""
    ratio: Annotated[float, Setting("of damping", "", 0.0, 1.0, formerly="zeta")] = 0.7
    mass: Annotated[float, Setting("moved", "kg", 0.0, 9.0, formerly="weight")] = 1.0


class Made(NamedTuple):
    """A node under test: its parameters, what changed, and the switch for `configured`."""

    parameters: Parameters
    node: object
    changes: list
    configured: list


@pytest.fixture
def make():
    """Return a maker of nodes with the given start-up parameters."""
    context = rclpy.Context()
    nodes = []

    def build(*given: str) -> Made:
        arguments = [word for pair in given for word in ("-p", pair)]
        if given:
            arguments = ["--ros-args", *arguments]
        node = rclpy.create_node("law", context=context, cli_args=arguments)
        nodes.append(node)
        changes, configured = [], []
        parameters = Parameters(
            node, changes.append, lambda kind: bool(configured), lambda given: ""
        )
        parameters.declare(spring=Spring)
        return Made(parameters, node, changes, configured)

    rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
    yield build
    for node in nodes:
        node.destroy_node()
    rclpy.shutdown(context=context)


def test_start_values_reach_the_tuple(make):
    """What is given at start replaces the default, as the tuple's own types."""
    made = make("spring.stiffness:=250.0", "spring.axes:=[0.5, -0.5]")
    made.parameters.finish()
    assert made.parameters.read(Spring, "spring") == Spring(250.0, (0.5, -0.5), "soft")


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ("spring.stiffness:=-1.0", "below the smallest allowed, 0 N/m"),
        ("spring.stiffness:=5001.0", "above the largest allowed, 5000 N/m"),
        ("spring.stiffness:=.nan", "a finite number is wanted"),
        ("spring.stiffness:=100", "write 1.0, not 1"),
        ("spring.stiffness:=soft", "type float"),
        ("spring.kind:=medium", "one of 'soft', 'hard'"),
        ("spring.axes:=[0.1]", "2 values are wanted"),
        ("spring.axes:=[0.1, 2.0]", "above the largest allowed"),
    ],
)
def test_a_bad_start_value_is_named(make, given, told):
    """The refusal names the parameter and what is allowed."""
    with pytest.raises(SettingError, match=given.split(":=")[0]) as caught:
        make(given)
    assert told in str(caught.value)


def test_an_unknown_name_is_refused_with_the_known_ones(make):
    """A misspelt parameter is not silently ignored."""
    made = make("spring.stifness:=250.0")
    with pytest.raises(SettingError, match=r"spring\.stifness is unknown.*spring\.stiffness"):
        made.parameters.finish()


def test_former_names_are_taken_with_one_warning_that_names_the_new_ones(make):
    made = make("spring.zeta:=0.5", "spring.weight:=2.0")
    (warning,) = made.parameters.finish()
    assert "spring.zeta is now spring.ratio, spring.weight is now spring.mass" in warning
    assert made.parameters.read(Spring, "spring") == Spring(ratio=0.5, mass=2.0)
    assert not made.node.has_parameter("spring.zeta")


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (("spring.zeta:=0.5", "spring.ratio:=0.6"), "spring.zeta is now spring.ratio, and both"),
        (("spring.zeta:=1.5",), "spring.zeta = 1.5: above the largest allowed"),
        (("spring.zeta:=1",), "spring.zeta = 1: .* float is wanted"),
    ],
)
def test_a_former_name_is_checked_like_the_new_one(make, given, told):
    with pytest.raises(SettingError, match=told):
        make(*given)


def test_live_change_while_configured(make):
    """A live field changes and the node hears of its tuple; a fixed one does not."""
    made = make()
    made.parameters.finish()
    made.configured.append(True)
    good = made.node.set_parameters([Parameter("spring.stiffness", value=300.0)])[0]
    bad = made.node.set_parameters([Parameter("spring.kind", value="hard")])[0]
    assert good.successful and made.changes == [Spring]
    assert not bad.successful and "deactivate and clean up first" in bad.reason
    assert made.parameters.read(Spring, "spring") == Spring(stiffness=300.0)


def test_a_fixed_parameter_is_refused_until_the_node_would_read_it(make_node):
    """Inactive is too late: only configuring reads it, and activating would not take it over."""
    node = make_node("supervisor")

    def refused() -> str:
        return node.set_parameters([Parameter("timeout", value=0.3)])[0].reason

    node.trigger_configure()
    assert "timeout" in refused() and "clean up first" in refused()
    node.trigger_activate()
    assert "deactivate and clean up first" in refused()
    node.trigger_deactivate()
    assert "clean up first" in refused()
    node.trigger_cleanup()
    assert refused() == ""
    node.trigger_configure()
    assert node._settings.timeout == 0.3
    node.close()


def test_what_is_given_at_start_never_changes(make):
    """Where a node writes is not for who can send a message."""
    made = make("spring.place:=here")
    made.parameters.finish()
    result = made.node.set_parameters([Parameter("spring.place", value="there")])[0]
    assert not result.successful and "fixed once the node has started" in result.reason
    assert made.parameters.read(Spring, "spring").place == "here"


def test_a_dump_can_be_loaded_again(make):
    """`ros2 param load` sends every value, unchanged ones and arrays too."""
    made = make()
    made.parameters.finish()
    made.configured.append(True)
    for name in made.parameters._fields:
        message = made.node.get_parameter(name).to_parameter_msg()
        (result,) = made.node.set_parameters([Parameter.from_parameter_msg(message)])
        assert result.successful, (name, result.reason)


def test_what_all_nodes_are_given_need_not_be_known(make):
    made = make("spring.stifness:=250.0")
    (told,) = made.parameters.finish(shared={"spring.stifness"})
    assert "spring.stifness, given to all nodes, is no parameter of this one" in told


def test_a_bad_change_leaves_everything(make):
    """Out of range at run time: refused with the bound, nothing is taken over."""
    made = make()
    made.parameters.finish()
    result = made.node.set_parameters([Parameter("spring.stiffness", value=9000.0)])[0]
    assert not result.successful and "spring.stiffness" in result.reason
    assert made.changes == [] and made.parameters.read(Spring, "spring") == Spring()


def test_descriptions_carry_unit_and_range(make):
    """`ros2 param describe` shows what the tuple says."""
    made = make()
    described = made.node.describe_parameter("spring.stiffness")
    assert described.description.startswith("spring [N/m]")
    assert described.floating_point_range[0].from_value == 0.0
    assert described.floating_point_range[0].to_value == 5000.0
    assert "hard" in made.node.describe_parameter("spring.kind").additional_constraints


def test_a_parameter_without_a_name_is_refused(make):
    """rclpy stores it in any node, though nobody has declared it."""
    made = make()
    made.parameters.finish()
    (refused,) = made.node.set_parameters([Parameter("", value=5)])
    assert not refused.successful and "empty name" in refused.reason
    assert not made.node.has_parameter("")


def test_a_name_is_one_parameter_for_all_records_that_have_it(make):
    """The rate of a device is that of its node, with the node's bounds."""

    class Device(NamedTuple):
        stiffness: Annotated[float, Setting("another text", "N/m", 0.0, 1e6)] = 7.0

    made = make("spring.stiffness:=250.0")
    made.parameters.declare(spring=Device)
    assert made.parameters.read(Device, "spring") == Device(250.0)
    assert made.node.describe_parameter("spring.stiffness").description.startswith("spring [N/m]")
