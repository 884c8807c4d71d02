# SPDX-License-Identifier: Apache-2.0
"""The machine in pictures: its parts for the pages, and the drawing at the top of README.

    tools/run python tools/picture.py            # writes both; needs Node

Both come from the URDF. `parts.js` is what the pages and the demo draw from; the drawing is made
by the same JavaScript, so there is one way of drawing. A test compares both files with what this
makes.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

from screw_module_ros.bridge.pages import FOLDER
from screw_module_ros.geometry import MANUS, PlanarArm
from screw_module_ros.nodes.robot_description import robot_description

ROOT = Path(__file__).resolve().parents[1]
PARTS = FOLDER / "js/machine/parts.js"
DRAWING = ROOT / "docs/machine.svg"
_SCRIPT = Path(__file__).with_suffix(".mjs")
_LICENCE = "// SPDX-License-Identifier: Apache-2.0\n"


def _numbers(text: str) -> list[float]:
    return [float(word) for word in text.split()]


def machine_of(urdf: str, arm: PlanarArm = MANUS) -> dict:
    """Return arm [m], joints and solids of a URDF as plain values.

    Joints stand in the URDF's order, parents first; `of`, `ratio`: the joint whose value one has,
    and how often. A solid has its link, its pose in it, sizes [m] and colour.
    """
    root = ElementTree.fromstring(urdf)
    colours = {
        each.get("name"): _numbers(each.find("color").get("rgba"))[:3]
        for each in root.findall("material")
    }
    joints, children = [], set()
    for joint in root.iter("joint"):
        mimic, axis = joint.find("mimic"), joint.find("axis")
        origin = joint.find("origin")
        children.add(joint.find("child").get("link"))
        joints.append({
            "type": joint.get("type"),
            "parent": joint.find("parent").get("link"),
            "child": joint.find("child").get("link"),
            "xyz": _numbers(origin.get("xyz")),
            "rpy": _numbers(origin.get("rpy", "0 0 0")),
            "axis": [0.0, 0.0, 1.0] if axis is None else _numbers(axis.get("xyz")),
            "of": joint.get("name") if mimic is None else mimic.get("joint"),
            "ratio": 1.0 if mimic is None else float(mimic.get("multiplier")),
        })
    solids = []
    for link in root.iter("link"):
        for visual in link.iter("visual"):
            (shape,) = visual.find("geometry")
            size = (_numbers(shape.get("size")) if shape.tag == "box"
                    else [float(shape.get("radius")), float(shape.get("length"))])
            solids.append({
                "link": link.get("name"), "kind": shape.tag, "size": size,
                "at": _numbers(visual.find("origin").get("xyz")),
                "rpy": _numbers(visual.find("origin").get("rpy")),
                "rgb": colours[visual.find("material").get("name")],
            })
    (base,) = {link.get("name") for link in root.iter("link")} - children
    lengths = {name: getattr(arm, name) for name in ("upper_arm", "forearm", "base_x", "base_y")}
    return {"root": base, "arm": {**lengths, "turn": arm.turn}, "joints": joints, "solids": solids}


def parts_text(machine: dict) -> str:
    """Return `parts.js` of a machine: one joint or solid a line."""
    def lines(key: str) -> str:
        return ",\n".join(f"  {json.dumps(each)}" for each in machine[key])

    return (
        f"{_LICENCE}// The machine's parts, made from its URDF by tools/picture.py.\n\n"
        f"export const MACHINE = {{\n\"root\": {json.dumps(machine['root'])},\n"
        f"\"arm\": {json.dumps(machine['arm'])},\n\"joints\": [\n{lines('joints')}\n],\n"
        f"\"solids\": [\n{lines('solids')}\n]}};\n"
    )


def drawing(node: str = "node") -> str:
    """Return the drawing as SVG; node: the program. Raises CalledProcessError where it fails."""
    ended = subprocess.run(
        [node, str(_SCRIPT), str(FOLDER / "js/machine")], check=True, capture_output=True, text=True
    )
    return ended.stdout


if __name__ == "__main__":
    PARTS.write_text(parts_text(machine_of(robot_description())), encoding="utf-8")
    DRAWING.write_text(drawing(*sys.argv[1:2]), encoding="utf-8")
