# SPDX-License-Identifier: Apache-2.0
"""A law of another package, from its trials to its limits: found, written, loaded and kept to."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Annotated, NamedTuple

import pytest
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import Parameter
from screw_module_msgs.srv import SetControlMode

from screw_module_ros.calibration.gain_limits import LOADS, load_gain_limits
from screw_module_ros.calibration.version import law_version
from screw_module_ros.control.law import LINEAR, Law, Margin, Variant, feeds
from screw_module_ros.control.laws import LAWS
from screw_module_ros.identification import calibration, delivered_impedance, stability
from screw_module_ros.identification.lab import Lab
from screw_module_ros.identification.stand import LoopSettings, SimulatedStand
from screw_module_ros.plant.settings import load_world
from screw_module_ros.settings import Setting

MODE = 180
SERIAL = "SIM-0001"


class EasedSettings(NamedTuple):
    """What the law feeds back."""

    gain: Annotated[float, Setting("of the hand's force", "", 0.0, 20.0, live=True)] = 2.0
    cutoff: Annotated[float, Setting("of its own filter", "Hz", 1.0, 100.0, live=True)] = 20.0


def help_hand(own, m, sample, motion, pressed):
    """Feed the force on the hand back, as the envelope filters it."""
    return feeds(own.gain * (pressed + sample.handle), pressed)


EASED = Law(
    "eased", {MODE: Variant("EASED", ("gain",), force=True)}, EasedSettings, help=help_hand,
    judged=LINEAR, margins=(Margin("gain", "eased", ("rate",), ("rate", "cutoff")),),
)  # fmt: skip
TRUSTED = Law("trusted", {190: Variant("TRUSTED", ("gain",))}, EasedSettings, help=help_hand)
FAST = delivered_impedance.Settings(frequencies=(2.0, 8.0))


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """The file of gain limits that experiments write with a law of another package in the robot."""
    patch = pytest.MonkeyPatch()
    few = {name: stability.ENVIRONMENTS[name] for name in (*LOADS, "soft_grip")}
    patch.setattr(stability, "ENVIRONMENTS", few)
    patch.setattr(stability, "_curves", lambda *_: {})
    loop = LoopSettings(rate=1000.0, command_delay=1e-3)
    bench = SimulatedStand(load_world(), loop, laws=(f"{__name__}:EASED",))
    lab = Lab(bench, tmp_path_factory.mktemp("lab"))
    result = stability.run(lab, stability.Settings(simulated=False))
    result.save(lab.folder)
    delivered_impedance.run(lab, FAST)
    patch.undo()
    return result, lab.folder / calibration.GAIN_LIMITS


@pytest.fixture
def controller(make_node, found):
    """Return a function that makes a controller as on hardware, with this file and laws."""

    def made(*laws, **others):
        named = {
            "gain_limits_file": found[1], "module_serial": SERIAL, "gain_limits_required": True,
            "laws": "[" + ", ".join(f'"{__name__}:{law}"' for law in laws) + "]", **others,
        }  # fmt: skip
        words = [word for name, value in named.items() for word in ("-p", f"{name}:={value}")]
        return make_node("impedance_controller", *words)

    return made


def changed(node, name, value) -> str:
    """Set a parameter as `ros2 param set` does; return the reason of a refusal."""
    (result,) = node.set_parameters([Parameter(name, value=value)])
    return result.reason


@pytest.mark.long
def test_its_limits_are_found_written_loaded_and_kept_to(controller, found):
    result, file = found
    most = min(result.value(f"eased_{load}") for load in LOADS)
    limits = load_gain_limits(file, SERIAL).laws["eased"]
    assert most - 0.01 <= limits.largest["gain"] <= most
    assert limits.conditions["eased.cutoff"] == EasedSettings().cutoff

    node = controller("EASED", **{"eased.gain": 20.0})
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    assert node.get_parameter("eased.gain").value == limits.largest["gain"], "it was lowered"
    assert node._set_mode(SetControlMode.Request(mode=MODE)) == "mode 180, EASED"
    told = changed(node, "eased.gain", 19.0)
    assert told.startswith("eased.gain is 19, and the module's gain limits (SIM-0001 ")
    assert f"are {limits.largest['gain']:g} at most" in told and "beyond_gain_limits" in told
    assert "eased.cutoff is 30 Hz" in changed(node, "eased.cutoff", 30.0)
    assert not changed(node, "eased.cutoff", 10.0), "a lower one costs no margin"
    assert node.get_parameter("eased.gain").value == limits.largest["gain"]
    node.close()


@pytest.mark.long
def test_the_impedance_that_its_mode_delivers_is_in_the_file_too(found):
    delivered = load_gain_limits(found[1], SERIAL).delivered
    assert {"mass_eased", "mass_observer"} <= set(delivered)
    assert "eased" in delivered["impedance_over_frequency"]["modes"]


@pytest.mark.long
def test_the_gains_of_this_package_are_what_they_are_without_it(found):
    result, file = found
    alone = stability.judged(stability.VerticalSettings(), 30.0)
    assert list(alone) == ["feedback", "observer"]
    assert {law.name for law in LAWS} < set(load_gain_limits(file, SERIAL).laws)
    assert result.value("feedback_hand") > result.value("feedback_heavy_arm") > 1.0


@pytest.mark.long
@pytest.mark.parametrize("word", [False, True])
def test_a_law_that_no_linear_model_judges_needs_the_operators_word(controller, monkeypatch, word):
    node = controller("EASED", "TRUSTED", beyond_gain_limits=word)
    said: list[str] = []
    log = SimpleNamespace(info=lambda text: None, warning=said.append)
    monkeypatch.setattr(node, "get_logger", lambda: log)
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    assert [text for text in said if text.startswith("law trusted ")] == [
        f"law trusted {law_version(TRUSTED)}: no linear model judges its gains, so no limits of "
        "them are known: it is on your word that it runs"
    ]
    told = node._set_mode(SetControlMode.Request(mode=190))
    if word:
        assert told == "mode 190, TRUSTED"
        assert not changed(node, "trusted.gain", 20.0)
    else:
        assert "mode TRUSTED is law trusted's, of which no gain limits are known" in told
    node.close()
