# SPDX-License-Identifier: Apache-2.0
"""`make docs`: the pages as a site, with a reference made from the code.

The pages are copied as they lie in the repository, so that their links work there and on the site;
the reference is written beside them from the table of topics, the message definitions, the nodes'
parameters, the commands' options and the table of measures. Then MkDocs builds
`build/site/html`; a page or heading that a link names and that is not there is an error.
"""

from __future__ import annotations

import contextlib
import importlib
import inspect
import io
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import get_args, get_origin

import click

import isolation
from screw_module_ros import graph, session_command
from screw_module_ros.calibration.gain_limits import GainLimits
from screw_module_ros.calibration.module import ModuleCalibration
from screw_module_ros.profiles import Profile
from screw_module_ros.programs import PROGRAMS
from screw_module_ros.settings import fields
from screw_module_ros.therapy import export
from screw_module_ros.therapy.measures import MEASURES
from screw_module_ros.therapy.protocol import Protocol

ROOT = Path(__file__).resolve().parent.parent
PAGES, HTML = ROOT / "build/site/pages", ROOT / "build/site/html"
COPIED = (
    "README.md", "CONTRIBUTING.md", "CHANGELOG.md", "QUALITY_DECLARATION.md", "LICENSE",
    "CITATION.cff", "docs", "examples", "security",
)  # fmt: skip
MODULE_NAME = "screw_module_ros"


def table(titles: list[str], rows: list[list[str]]) -> str:
    """Return a table of Markdown."""
    lines = [titles, ["---"] * len(titles), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |"
                     for line in lines) + "\n"  # fmt: skip


def code(text: str) -> str:
    """Return text as code within a line, nothing for nothing."""
    return f"`{text}`" if text else ""


def topics() -> str:
    """Return the page of topics."""
    rows = [
        [
            code(topic.name), code(topic.type), topic.qos, code(topic.publisher) or "any",
            f"{topic.rate:g}" if topic.rate else "event",
            ", ".join(map(code, topic.subscribers)),
            f"{topic.clock}, every {topic.every}" if topic.clock else "",
        ]
        for topic in graph.TOPICS.values()
    ]  # fmt: skip
    titles = ["topic", "type", "quality", "publisher", "per s", "subscribers", "sequence counts"]
    return (
        "# Topics\n\nFrom `screw_module_ros/graph.py`. Quality of service of the publisher: "
        "`sample` best effort, depth 1; `command` reliable, depth 1; `state` reliable, depth 10. "
        "A rate is the default one.\n\n" + table(titles, rows)
    )


def messages() -> str:
    """Return the page of messages, services and actions, each as its definition."""
    parts = ["# Messages\n\nThe definitions of `screw_module_msgs`, with unit and frame.\n"]
    for kind in ("msg", "srv", "action"):
        for file in sorted((ROOT / "msg_defs" / kind).iterdir()):
            text = file.read_text("utf-8").strip()
            parts.append(f"## {file.stem}\n\n```\n{text}\n```\n")
    return "\n".join(parts)


def node_classes() -> Iterator[tuple[str, type]]:
    """Yield each node's name and class, in the order of the graph."""
    from screw_module_ros.nodes.support.node import Node

    for name in [*(entry.executable for entry in graph.GRAPH), *graph.BESIDE]:
        module = importlib.import_module(f"{MODULE_NAME}.{PROGRAMS[name][0]}")
        yield name, next(
            kind for kind in vars(module).values()
            if isinstance(kind, type) and issubclass(kind, Node)
            and kind.__module__ == module.__name__
        )  # fmt: skip


def parameters() -> str:
    """Return the page of parameters, from the settings that each node declares."""
    import rclpy

    parts = [
        "# Parameters\n\nOf each node: default, unit, range, and when it may change: *any time*, "
        "*unconfigured* (not while the node is configured or active), or only *at start*.\n"
    ]
    # In a domain of its own: a second `encoder` would stop a robot that runs.
    with isolation.own_domain() as domain, noted_declarations() as declared:
        os.environ.update(isolation.variables(domain))
        rclpy.init()
        for name, kind in node_classes():
            declared.clear()
            node = kind()
            parts.append(f"## {name}\n\n" + parameters_of(declared))
            node.destroy_node()
            node.clock.close()
        rclpy.try_shutdown()
    return "\n".join(parts)


@contextlib.contextmanager
def noted_declarations() -> Iterator[list[tuple[type, str, dict]]]:
    """Yield the list of the declarations that follow: settings, prefix, other arguments."""
    from screw_module_ros.nodes.support.parameters import Parameters

    declared: list[tuple[type, str, dict]] = []
    declare = Parameters.declare_with

    def noted(self, kind, prefix="", without=(), **defaults):
        declared.append((kind, prefix, dict(defaults, without=without)))
        declare(self, kind, prefix, without, **defaults)

    Parameters.declare_with = noted
    try:
        yield declared
    finally:
        Parameters.declare_with = declare


def parameters_of(declared: list[tuple[type, str, dict]]) -> str:
    """Return the table of one node's parameters. declared: arguments of each declaration."""
    rows: dict[str, list[str]] = {}
    for kind, prefix, given in declared:
        without = given.pop("without")
        for field in fields(kind).values():
            name = f"{prefix}.{field.name}" if prefix else field.name
            if field.setting.text and field.name not in without and name not in rows:
                value = given.get(field.name, kind._field_defaults[field.name])
                rows[name] = [code(name), shown(value), field.setting.unit, extent(field.setting),
                              changes(field.setting), field.setting.text]  # fmt: skip
    titles = ["parameter", "default", "unit", "range", "changes", "meaning"]
    return table(titles, [rows[name] for name in sorted(rows)])


def shown(value) -> str:
    """Return a default as a parameter file has it."""
    if isinstance(value, bool):
        return str(value).lower()
    return ", ".join(map(shown, value)) if isinstance(value, tuple) else f"{value}"


def extent(setting) -> str:
    """Return the values that are allowed."""
    if setting.choices:
        return ", ".join(str(choice) or "empty" for choice in setting.choices)
    if setting.low == float("-inf"):
        return "" if setting.high == float("inf") else f"to {setting.high:g}"
    return f"{setting.low:g} to {setting.high:g}"


def changes(setting) -> str:
    """Return when a parameter may change."""
    return "any time" if setting.live else "at start" if setting.at_start else "unconfigured"


def commands() -> str:
    """Return the page of commands: the make targets, and each program's help."""
    targets = re.findall(r"^([a-z-]+):.*## +(.*)$", (ROOT / "Makefile").read_text("utf-8"), re.M)
    rows = [[code(f"make {target}"), text] for target, text in targets]
    parts = ["# Commands\n\nIn the checkout:\n", table(["command", "does"], rows)]
    parts.append(
        "Programs: `ros2 run screw_module_ros NAME` in a workspace, `NAME` in `make shell`. A node "
        "takes ROS arguments alone (`--ros-args -p NAME:=VALUE --params-file FILE`): "
        "[parameters](parameters.md).\n"
    )
    for name, (module, function) in PROGRAMS.items():
        if text := help_of(name, importlib.import_module(f"{MODULE_NAME}.{module}"), function):
            parts.append(f"## {name}\n\n```\n{text.strip()}\n```\n")
    return "\n".join(parts)


def help_of(name: str, module, function: str) -> str:
    """Return the help of a program, empty for a node."""
    if module is session_command:
        texts = []
        for words in ([], ["info"], ["verify"], ["recover"], ["report"], ["replay"], ["export"]):
            with contextlib.redirect_stdout(io.StringIO()) as text, contextlib.suppress(SystemExit):
                session_command._parser().parse_args([*words, "--help"])
            texts.append(text.getvalue().strip())
        return "\n\n".join(texts)
    command = getattr(module, function)
    if not isinstance(command, click.Command):
        return ""
    return command.get_help(click.Context(command, info_name=name, max_content_width=90))


def measures() -> str:
    """Return the page of measures."""
    rows = [
        [code(each.name), each.label, each.unit, ", ".join(each.kinds), each.text]
        for each in MEASURES
    ]
    return (
        "# Measures\n\nOf a trial, from `screw_module_ros/therapy/measures.py`. The unit is that "
        "of the displays; files have SI units.\n\n"
        + table(["name", "label", "unit", "trials", "definition"], rows)
    )


FILES = (
    ("Protocol", Protocol, "A therapy session: `params/therapy` and the folder of "
     "[your own](../docs/therapy.md#protocols)."),
    ("Device profile", Profile, "What is known of a make: `params/devices`, "
     "[another robot](../docs/porting.md)."),
    ("Calibration", ModuleCalibration, "Of one module, written by "
     "[`characterize`](../docs/characterization.md); `friction` and `linearization` may also stand "
     "in files of their own."),
    ("Gain limits", GainLimits, "The largest force gains of one module in a linear model: "
     "[gain limits](../docs/characterization.md#gain-limits-of-a-linear-model). Version 3."),
)  # fmt: skip


def files() -> str:
    """Return the page of the file formats: the keys of each YAML file, and what is exported."""
    parts = [
        "# File formats\n\nA bag has [its own section](../docs/recording.md#what-is-in-a-bag), a "
        "parameter file [the parameters](parameters.md). The other files are YAML. All but "
        "protocols begin with `format` and `version`. A key without a default must be there, an "
        "unknown one is refused; `[]` is a list or a mapping of such records.\n"
    ]
    titles = ["key", "default", "unit", "range", "meaning"]
    for title, kind, text in FILES:
        told = f"{text}\n\n{inspect.getdoc(kind)}"
        parts.append(f"## {title}\n\n{told}\n\n{table(titles, keys_of(kind))}")
    columns = ", ".join(map(code, export.LEADING))
    parts.append(
        "## Export\n\n`session export` writes `trials.csv`, one row a trial, in SI units: "
        f"{columns}, and what `therapy/trial` has ([TrialResult](messages.md#trialresult)). "
        "`columns.csv` beside it says what the [measures](measures.md) among them mean.\n"
    )
    return "\n".join(parts)


def keys_of(kind: type, above: str = "") -> list[list[str]]:
    """Return the rows of a record's keys, those of the records in it after its own name."""
    rows = []
    for field in fields(kind).values():
        name = f"{above}{field.name}"
        inner, mark = record_in(field.kind)
        if inner is not None:
            rows += keys_of(inner, f"{name}{mark}.")
            continue
        default = kind._field_defaults.get(field.name)
        told = "" if default is None else shown(default) or "empty"
        rows.append([code(name), told, field.setting.unit, extent(field.setting),
                     field.setting.text])  # fmt: skip
    return rows


def record_in(kind) -> tuple[type | None, str]:
    """Return the record of a key's type, None if it has none, and `[]` if there are several."""
    if hasattr(kind, "_fields"):
        return kind, ""
    several = "[]" if get_origin(kind) in (tuple, dict) else ""
    inner = next((part for part in get_args(kind) if hasattr(part, "_fields")), None)
    return inner, several


def client() -> str:
    """Return the page of the Python client."""
    from screw_module_ros.operator.client import Client
    from screw_module_ros.operator.robot import Robot

    parts = [
        "# Python client\n\n`from screw_module_ros.operator.robot import Robot, RobotError`; an "
        f"example is [operate.py](../examples/operate.py).\n\n{inspect.getdoc(Client)}\n"
    ]
    for kind in (Robot, Client):
        for name, method in vars(kind).items():
            if inspect.isfunction(method) and not name.startswith("_"):
                parts.append(f"## {name}\n\n`{name}{_call(method)}`\n\n{inspect.getdoc(method)}\n")
    return "\n".join(parts)


def _call(method: Callable) -> str:
    """Return the arguments of a method as one writes them, without types."""
    signature = inspect.signature(method)
    names = [p.replace(annotation=p.empty) for p in signature.parameters.values()][1:]
    return str(inspect.Signature(names))


REFERENCE = {
    "topics": topics, "messages": messages, "parameters": parameters, "commands": commands,
    "measures": measures, "files": files, "client": client,
}  # fmt: skip


def write_pages() -> None:
    """Copy the pages and write the reference beside them."""
    shutil.rmtree(PAGES, ignore_errors=True)
    PAGES.mkdir(parents=True)
    for name in COPIED:
        copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
        copy(ROOT / name, PAGES / name)
    (PAGES / "reference").mkdir()
    for name, page in REFERENCE.items():
        (PAGES / "reference" / f"{name}.md").write_text(page(), encoding="utf-8")


def main() -> int:
    """Build the site; return MkDocs's exit code."""
    write_pages()
    mkdocs = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet"]
    done = subprocess.run(mkdocs, cwd=ROOT, check=False)
    if done.returncode == 0:
        print(f"The site is in {HTML.relative_to(ROOT)}: open index.html there.")
    return done.returncode


if __name__ == "__main__":
    sys.exit(main())
