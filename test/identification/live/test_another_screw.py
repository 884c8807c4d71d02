# SPDX-License-Identifier: Apache-2.0
"""Another robot, from parameters alone: a screw with a lead of 12.7 mm, a law of another package.

Experiments on its graph.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import laws_of_others
import pytest
from test_characterize import Stand, operated

from screw_module_ros.graph import WHOLE
from screw_module_ros.identification.results import load_result
from screw_module_ros.nodes.bringup import Process
from screw_module_ros.resources import resource_path
from screw_module_ros.trials.runner import GraphRun, recordings_in

pytestmark = [pytest.mark.graph, pytest.mark.long]

LEAD = 0.0127


@pytest.fixture(scope="module")
def stand(tmp_path_factory) -> Iterator[Stand]:
    """Return the operator beside the graph of such a robot and `characterize`."""
    folder = tmp_path_factory.getbasetemp()
    plant = resource_path("params/plant.yaml").read_text("utf-8")
    assert "lead: 0.01905" in plant
    (folder / "plant.yaml").write_text(plant.replace("lead: 0.01905", f"lead: {LEAD}"))
    said = [f"sim_rig:plant_file:={folder / 'plant.yaml'}", "sim_rig:speed:=0.0"]
    said += [f"{node}:lead:={LEAD}" for node in ("encoder", "amplifier")]
    said += ['impedance_controller:laws:=["laws_of_others:THE_FLOOR"]']
    words = [word for each in said for word in ("-p", each)]
    extra = [*words, *recordings_in(folder / "bags")]
    patch = pytest.MonkeyPatch()
    patch.setenv("PYTHONPATH", str(Path(laws_of_others.__file__).parent), prepend=os.pathsep)
    with GraphRun(extra=extra, without=["endpoint_state"], shared=WHOLE) as graph:
        given = ["--ros-args", "-p", "use_sim_time:=true", "-p", f"folder:={folder}"]
        process = Process("characterize", given)
        try:
            with operated(graph) as (robot, client):
                yield Stand(robot, client, process)
        finally:
            process.stop()
            patch.undo()


def test_friction_and_torque_are_those_of_its_own_screw(stand, tmp_path):
    """Heights, forces and the motor's constant are right, and everything is as it was."""
    stand.make_ready()
    stand.fix("stage")
    goal = stand.goal(
        "friction_map", tmp_path, speeds=[0.06], inverted_speeds=[], low=0.135, high=0.165
    )
    goal.result()
    found = load_result(tmp_path, "friction_map")
    assert found.value("mean_up") == pytest.approx(18.0, abs=4.0)
    assert found.value("filled_up") > 0.05
    stand.fix("locked_rotor")
    stand.goal("static_torque", tmp_path, duration=2.0, omega=6.3, amplitude=0.3).result()
    found = load_result(tmp_path, "static_torque")
    assert found.value("torque_constant") == pytest.approx(0.16, rel=0.05)
    assert found.value("dead_zone") == pytest.approx(0.025, abs=0.005)
    stand.check_put_back()


def test_a_mode_of_the_controller_s_law_of_another_package_is_measured(stand, tmp_path):
    """`characterize` takes the laws that the controller runs; nobody names them to it."""
    stand.make_ready()
    stand.fix("human_arm")
    told = stand.goal("force_error", tmp_path, modes=[199], cases=["small"], side_force=0.0)
    assert "modes = 199: one of 0, 1, 2, 3, 4, 5, 150 is wanted" in told.refusal()
    goal = stand.goal(
        "force_error", tmp_path, modes=[laws_of_others.FLOOR], cases=["small"], side_force=0.0
    )
    goal.result()
    found = load_result(tmp_path, "force_error")
    assert 0.0 < found.value("rms_floor_small") < 20.0
    assert found.settings["names"] == {str(laws_of_others.FLOOR): "FLOOR"}
    stand.check_put_back()
