# SPDX-License-Identifier: Apache-2.0
"""What a live trial needs of the robot: each check raises NotPossible, with the way out."""

from __future__ import annotations

from typing import Any

from screw_module_msgs.msg import AmplifierState, EncoderSample, ImpedanceState, SafetyState

from screw_module_ros import graph
from screw_module_ros.control.modes import OFF
from screw_module_ros.geometry import Screw
from screw_module_ros.identification.trials import NotPossible
from screw_module_ros.operator.client import RobotError
from screw_module_ros.operator.robot import Robot

from .fixture import topic_of

_SILENT_S, _ANSWER_S = 2.0, 10.0


def _heard(robot: Robot, kind: type, name: str, patience_s: float) -> Any:
    """Return the newest message of a node; refuse one that is silent."""
    if not robot.met(lambda: robot.state(kind), patience_s):
        raise NotPossible(f"the {name} is silent: start and activate it first")
    return robot.newest(kind)


def check_homed(robot: Robot) -> None:
    """Refuse an encoder that is silent or not homed."""
    if not _heard(robot, EncoderSample, "encoder", _SILENT_S).homed:
        raise NotPossible(
            "the encoder is not homed: bring the nut to the reference mark, then "
            f"ros2 service call {topic_of(robot, 'encoder/home')} std_srvs/srv/Trigger"
        )


def check_height(robot: Robot, height: float, screw: Screw, within: float = 1e-3) -> None:
    """Refuse an encoder, set for a screw, whose height differs from that of the handle [m]."""
    shown = robot.newest(EncoderSample).position
    if abs(shown - height) > within:
        raise NotPossible(
            f"the handle is at {1e3 * height:.1f} mm, the encoder shows {1e3 * shown:.1f} mm: "
            "home the encoder at the reference mark; if it shows the mark's height there, the "
            f"screw's lead is not the {1e3 * screw.lead:g} mm that encoder and amplifier take"
        )


def check_disabled(robot: Robot) -> None:
    """Refuse an amplifier that is silent or enabled."""
    if _heard(robot, AmplifierState, "amplifier", _ANSWER_S).enabled:
        raise NotPossible(f"the amplifier is enabled; disable it: {disabling(robot)}")


def check_passive(robot: Robot) -> None:
    """Refuse torque. Without an amplifier node there is no heartbeat, and its drive is off."""
    if robot.node.count_publishers(graph.AMPLIFIER_STATE) == 0:
        return
    robot.met(lambda: robot.state(AmplifierState), _SILENT_S)
    amplifier, controller = robot.state(AmplifierState), robot.state(ImpedanceState)
    if amplifier and amplifier.enabled and (controller is None or controller.mode != OFF):
        raise NotPossible(
            "the module must be passive, and the amplifier is enabled; disable it: "
            f"{disabling(robot)}"
        )


def check_not_stopped(robot: Robot) -> None:
    """Refuse a robot that its supervisor has stopped."""
    state = _heard(robot, SafetyState, "supervisor", _ANSWER_S)
    if state.level == SafetyState.STOPPED:
        raise NotPossible(
            f"the supervisor has stopped the robot ({'; '.join(state.reasons)}): ros2 service call "
            f"{topic_of(robot, 'supervisor/reset')} std_srvs/srv/Trigger"
        )


def check_acting(robot: Robot) -> None:
    """Raise RobotError with the reason if the torque is off, or nobody says that it is on.

    A killed amplifier's drive is off, by its own guards.
    """
    controller = robot.state(ImpedanceState)
    if controller is not None and controller.faulted:
        raise RobotError(f"torque off: {controller.reason}")
    if not robot.met(lambda: robot.state(AmplifierState), _SILENT_S):
        raise RobotError(f"the amplifier is silent{robot.complaints_text()}")
    state = robot.newest(AmplifierState)
    if not state.enabled:
        raise RobotError(f"the amplifier switched the torque off: {state.reason}")


def check_screw(robot: Robot, screw: Screw) -> None:
    """Refuse an amplifier with another lead than the encoder's, which is `screw`."""
    lead = robot.parameters("amplifier", ("lead",))["lead"]
    if lead != screw.lead:
        raise NotPossible(
            f"amplifier runs with a lead of {1e3 * lead:g} mm, encoder with {1e3 * screw.lead:g} "
            "mm: forces and heights would differ by the ratio; give both the screw's own (lead)"
        )


def common_rate(robot: Robot) -> float:
    """Return the tick rate of both sensors [1/s]; refuse different rates, and another clock."""
    rates = []
    for node in ("encoder", "force_sensor"):
        own = robot.parameters(node, ("rate", "use_sim_time"))
        if own["use_sim_time"] != robot.clock.simulated:
            raise NotPossible(
                f"{node} runs with use_sim_time {str(own['use_sim_time']).lower()}, "
                "characterize does not: start it with the same"
            )
        rates.append(own["rate"])
    if rates[0] != rates[1]:
        raise NotPossible(
            f"encoder at {rates[0]:g} and force_sensor at {rates[1]:g} samples per second: start "
            "both with the same rate"
        )
    return rates[0]


def disabling(robot: Robot) -> str:
    """Return the command that disables the amplifier."""
    service = topic_of(robot, "amplifier/enable")
    return f'ros2 service call {service} std_srvs/srv/SetBool "{{data: false}}"'
