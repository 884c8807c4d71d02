# SPDX-License-Identifier: Apache-2.0
"""Docs and lint: the reference has what the code has; a room that grows heavier is named."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, NamedTuple

import yaml

import docs_site
from screw_module_ros.graph import TOPICS
from screw_module_ros.programs import PROGRAMS
from screw_module_ros.settings import Setting
from screw_module_ros.therapy.measures import MEASURES

ROOT = Path(__file__).parents[2]


class Law(NamedTuple):
    stiffness: Annotated[float, Setting("spring", "N/m", 0.0, 5000.0, live=True)] = 100.0
    mode: Annotated[int, Setting("law", choices=(0, 1))] = 0
    inner: float = 1.0  # no setting, so no parameter


def _rows(page: str) -> list[list[str]]:
    lines = [line for line in page.splitlines() if line.startswith("| `")]
    return [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines]


def test_a_parameter_has_its_default_unit_range_and_time_of_change():
    page = docs_site.parameters_of([(Law, "law", {"without": (), "mode": 1})])
    assert _rows(page) == [
        ["`law.mode`", "1", "", "0, 1", "unconfigured", "law"],
        ["`law.stiffness`", "100.0", "N/m", "0 to 5000", "any time", "spring"],
    ]


def test_every_topic_and_measure_has_a_row():
    assert [row[0] for row in _rows(docs_site.topics())] == [f"`{name}`" for name in TOPICS]
    assert [row[0] for row in _rows(docs_site.measures())] == [f"`{m.name}`" for m in MEASURES]


class Inner(NamedTuple):
    low: Annotated[float, Setting("smallest", "m", 0.0, 1.0)]


class File(NamedTuple):
    serial: Annotated[str, Setting("of the module")]
    one: Inner
    many: tuple[Inner, ...]
    named: dict[str, Inner] = {}
    maybe: Inner | None = None
    count: Annotated[int, Setting("of targets", "", 1, 16)] = 8


def test_a_file_has_the_keys_of_the_records_in_it():
    smallest = ["", "m", "0 to 1", "smallest"]
    assert docs_site.keys_of(File) == [
        ["`serial`", "", "", "", "of the module"],
        ["`one.low`", *smallest], ["`many[].low`", *smallest], ["`named[].low`", *smallest],
        ["`maybe.low`", *smallest], ["`count`", "8", "", "1 to 16", "of targets"],
    ]  # fmt: skip


def test_every_message_is_there_as_it_is_defined():
    page = docs_site.messages()
    files = [*ROOT.glob("msg_defs/*/*.*")]
    assert len(files) > 20
    for file in files:
        assert f"## {file.stem}\n\n```\n{file.read_text('utf-8').strip()}\n```" in page


def test_every_program_with_options_shows_them():
    page = docs_site.commands()
    shown = set(re.findall(r"^## (\w+)$", page, re.M))
    nodes = {name for name, (module, _) in PROGRAMS.items() if module == f"nodes.{name}"}
    assert shown == set(PROGRAMS) - nodes - {"characterize"} | {"bringup", "robot_description"}
    assert page.count("Usage: ") + page.count("usage: ") >= len(shown)


def test_every_page_is_in_the_menu():
    named = set(re.findall(r"[\w/]+\.md", yaml.dump(yaml.safe_load(
        (ROOT / "mkdocs.yml").read_text("utf-8"))["nav"])))  # fmt: skip
    pages = {f"docs/{file.name}" for file in (ROOT / "docs").glob("*.md")}
    pages |= {f"reference/{name}.md" for name in docs_site.REFERENCE}
    assert pages <= named
