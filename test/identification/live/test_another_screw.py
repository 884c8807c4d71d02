# SPDX-License-Identifier: Apache-2.0
"""A robot whose screw has a lead of 12.7 mm, from parameters alone: experiments on its graph."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from test_characterize import Stand, operated

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
    words = [word for each in said for word in ("-p", each)]
    extra = [*words, *recordings_in(folder / "bags")]
    with GraphRun(extra=extra, without=["endpoint_state"], composed=True) as graph:
        given = ["--ros-args", "-p", "use_sim_time:=true", "-p", f"folder:={folder}"]
        process = Process("characterize", given)
        try:
            with operated(graph) as (robot, client):
                yield Stand(robot, client, process)
        finally:
            process.stop()


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
