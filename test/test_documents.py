# SPDX-License-Identifier: Apache-2.0
"""What README and docs tell people to type names what there is."""

from __future__ import annotations

import ast
import importlib
import re
import shlex
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
import yaml
from catalogue import ROWS
from screw_module_msgs.msg import ForceCommand

from screw_module_ros import profiles, session_command
from screw_module_ros.bridge.rights import SERVICES as BRIDGE_SERVICES
from screw_module_ros.control.laws import all_names, names, thesis
from screw_module_ros.control.modes import OBSERVER
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.identification.experiments import EXPERIMENTS
from screw_module_ros.nodes import bringup
from screw_module_ros.therapy import protocol_file

ROOT = Path(__file__).parents[1]
DOCUMENTS = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
BLOCK = re.compile(r"^```sh\n(.*?)^```", re.MULTILINE | re.DOTALL)


def _commands() -> list[list[str]]:
    """Return the words of each command in a block of shell, comments taken away."""
    lines = []
    for document in DOCUMENTS:
        for block in BLOCK.findall(document.read_text(encoding="utf-8")):
            lines += block.replace("\\\n", " ").splitlines()
    parts = [part for line in lines for part in line.split(" && ")]
    return [words for part in parts if (words := shlex.split(part, comments=True))]


COMMANDS = _commands()


def beginning(*words: str) -> list[list[str]]:
    """Return what follows these words in each command that begins with them; some must."""
    found = [c[len(words):] for c in COMMANDS if c[: len(words)] == list(words)]
    assert found, words
    return found


def _literal(file: str, name: str) -> Any:
    """Return a constant of a test's module without running it."""
    tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
    for node in tree.body:
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == name:
            return ast.literal_eval(node.value)
    raise KeyError(name)


SERVICES = _literal("test/nodes/test_graph.py", "SERVICES")  # of the design, found in the graph
SERVICES |= {f"/{name}": kind for name, kind in BRIDGE_SERVICES.items()}  # found by their tests
EXECUTABLES = {
    path.name for path in (ROOT / "install/screw_module_ros/lib/screw_module_ros").glob("*")
} or None  # colcon installs elsewhere


def _fill(message: Any, values: dict) -> None:
    """Set fields by name as `ros2 service call` does; raise for one that there is not."""
    for name, value in values.items():
        part = getattr(message, name)
        if isinstance(value, dict):
            _fill(part, value)
        else:
            setattr(message, name, value if isinstance(value, list) else type(part)(value))


def request_class(kind: str) -> type:
    package, folder, name = kind.split("/")
    found = getattr(importlib.import_module(f"{package}.{folder}"), name)
    return found.Goal if folder == "action" else found.Request


@pytest.mark.parametrize("words", beginning("ros2", "service", "call"), ids=" ".join)
def test_service_calls(words):
    name, kind, *values = words
    assert SERVICES[name] == kind
    for text in values:
        _fill(request_class(kind)(), yaml.safe_load(text))


@pytest.mark.parametrize("words", beginning("ros2", "action", "send_goal"), ids=" ".join)
def test_goals(words):
    flag, name, kind, values = words
    assert (flag, name) == ("--feedback", "/characterize/run")
    _fill(request_class(kind)(), yaml.safe_load(values))


@pytest.mark.parametrize("words", beginning("ros2", "run", "screw_module_ros"), ids=" ".join)
def test_executables(words):
    assert EXECUTABLES is None or words[0] in EXECUTABLES
    if words[0] == "session":
        assert session_command._parser().parse_args(words[1:])


@pytest.mark.parametrize(
    "words", beginning("ros2", "launch", "screw_module_ros"), ids=" ".join
)
def test_launch_arguments(words):
    file, *arguments = words
    text = (ROOT / "launch" / file).read_text(encoding="utf-8")
    known = re.findall(r'_argument\("(\w+)"', text)
    assert {argument.partition(":=")[0] for argument in arguments} <= set(known)


@pytest.mark.parametrize("words", beginning("bringup"), ids=" ".join)
def test_bringup_options(words):
    assert bringup.command.make_context("bringup", list(words)).params


def test_every_experiment_is_in_the_table():
    text = (ROOT / "docs/characterization.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\|(.*?)\|", text, re.MULTILINE)
    told = [name for row in rows for name in re.findall(r"`(\w+)`", row) if name != "settings"]
    assert sorted(told) == sorted(EXPERIMENTS)


def test_the_damping_that_the_page_names_is_enough_for_mode_observer():
    text = (ROOT / "docs/control.md").read_text(encoding="utf-8")
    damping, stiffness = map(float, re.search(r"([\d.]+) Ns/m\s+at (\d+) N/m", text).groups())
    law = VerticalSettings(stiffness=stiffness, damping=damping)
    assert thesis.refusal(law, OBSERVER) == ""
    assert thesis.refusal(law._replace(damping=damping - 0.1), OBSERVER)


def test_every_field_of_a_message_says_what_it_is():
    files = [*(ROOT / "msg_defs").glob("msg/*"), *(ROOT / "msg_defs").glob("srv/*"),
             *(ROOT / "msg_defs").glob("action/*")]  # fmt: skip
    fields = {file.name: re.findall(r"^[a-z]\S* +[a-z]\w*\b(.*)", file.read_text("utf-8"), re.M)
              for file in files}  # fmt: skip
    assert sum(map(len, fields.values())) > 200
    assert [name for name, rest in fields.items() if not all("# " in one for one in rest)] == []


def test_every_mode_is_where_a_reader_looks_for_it():
    modes = {f"{number} {name}" for number, name in names().items()}
    for page, told in (("first_run", modes), ("control", modes - {"0 OFF"})):
        text = (ROOT / f"docs/{page}.md").read_text(encoding="utf-8")
        assert set(re.findall(r"^\| (\d [A-Z_]+) \|", text, re.M)) == told, page
    text = (ROOT / "msg_defs/srv/SetControlMode.srv").read_text(encoding="utf-8")
    assert {f"{number} {name}" for name, number in re.findall(r"([A-Z_]+) (\d)", text)} == modes
    assert all(getattr(ForceCommand, name) == number for number, name in all_names().items())


def test_make_targets():
    text = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = set(re.findall(r"^([a-z-]+):", text, re.MULTILINE))
    assert {words[0] for words in beginning("make")} <= targets


def _arguments(target: str) -> list[list[str]]:
    """Return the words in ARGS="..." of each `make TARGET`."""
    options = [option for words in beginning("make", target) for option in words]
    return [shlex.split(o.removeprefix("ARGS=")) for o in options if o.startswith("ARGS=")]


def test_the_fault_rows_of_the_examples_exist():
    examples = [words for words in _arguments("faults") if words[0] == "-k"]
    assert examples
    for _, name in examples:
        assert any(name in row.name for row in ROWS)


def test_the_tests_of_the_examples_exist():
    examples = _arguments("test")
    assert examples
    for file, _, word in examples:
        assert re.search(rf"^def test_\w*{word}", (ROOT / file).read_text("utf-8"), re.MULTILINE)


@pytest.mark.parametrize("document", [*DOCUMENTS, ROOT / "CHANGELOG.md"], ids=lambda d: d.name)
def test_no_mark_of_a_merge_was_left(document):
    assert not re.search(r"^(<{7}|={7}|>{7})", document.read_text("utf-8"), re.MULTILINE)


def test_links_lead_somewhere():
    broken = []
    for document in [*DOCUMENTS, ROOT / "QUALITY_DECLARATION.md", ROOT / "CHANGELOG.md"]:
        for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", document.read_text("utf-8")):
            if not (document.parent / target).exists():
                broken.append(f"{document.name}: {target}")
    assert broken == []


@pytest.mark.parametrize("folder", ["", "msg_defs"])
def test_a_package_names_author_and_licence_and_no_address_that_leads_nowhere(folder):
    """The repository is unpublished: an invented address could become somebody else's."""
    package = ElementTree.parse(ROOT / folder / "package.xml").getroot()
    (maintainer,) = package.findall("maintainer")
    assert maintainer.get("email").endswith(".invalid")
    assert package.findall("url") == []
    assert package.findtext("author")
    assert (ROOT / folder / "LICENSE").read_text("utf-8").strip().startswith("Apache License")
    assert package.findtext("version") == "0.1.0"


def test_all_that_names_the_version_names_the_same():
    versions = {
        ElementTree.parse(ROOT / file).getroot().findtext("version")
        for file in ("package.xml", "msg_defs/package.xml")
    }
    versions.add(re.search(r'version="(.+?)"', (ROOT / "setup.py").read_text("utf-8"))[1])
    versions.add(yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))["version"])
    versions.add(re.search(r"^## \[(\d.+?)\]", (ROOT / "CHANGELOG.md").read_text("utf-8"), re.M)[1])
    versions.add(re.search(r"^(\d\S+) \(", (ROOT / "msg_defs/CHANGELOG.rst").read_text(), re.M)[1])
    assert versions == {"0.1.0"}


def test_the_page_of_releases_agrees_with_changelog_and_citation():
    """Each release of the changelog, newest first, by version and date; the newest is cited."""
    changelog = (ROOT / "CHANGELOG.md").read_text("utf-8")
    released = re.findall(r"^## \[(\d\S+)\] - (\S+)$", changelog, re.M)
    page = (ROOT / "docs/release.md").read_text("utf-8")
    assert re.findall(r"^\| (\d\S+) \| (\S+) \|", page, re.M) == released
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    assert (citation["version"], str(citation["date-released"])) == released[0]


def test_no_page_gives_an_address_that_the_owner_has_not_made():
    """No tag, DOI or address of this software is told before it is there (docs/release.md)."""
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    told = [key for key in ("doi", "repository-code", "url", "identifiers") if key in citation]
    page = (ROOT / "docs/release.md").read_text("utf-8")
    releases = re.findall(r"^\| \d.*\|$", page, re.M)
    assert bool(told) == any("none yet" not in release for release in releases)
    for file in [*DOCUMENTS, ROOT / "CITATION.cff"]:
        assert not re.search(r"https?://\S*screw[_-]module", file.read_text("utf-8")), file


def test_each_claim_of_what_nobody_else_has_names_its_proof():
    page = (ROOT / "docs/unique.md").read_text("utf-8")
    claims = re.findall(r"^\| (.+) \| (.+) \|$", page.partition("|---|")[2], re.M)
    assert len(claims) > 10
    assert [claim for claim, proof in claims if not re.search(r"\]\(|`make ", proof)] == []


def test_the_container_files_build_as_the_pages_do():
    debian = (ROOT / "containers/Containerfile").read_text("utf-8")
    assert "RUN make build" in debian and "NOT TRIED" not in debian
    jazzy = (ROOT / "containers/Containerfile.jazzy").read_text("utf-8")
    assert "NOT TRIED" in jazzy
    for step in ("ln -s screw_module_ros/msg_defs src/screw_module_msgs", "colcon build",
                 "rosdep install --from-paths src --ignore-src -y"):  # fmt: skip
        assert step in jazzy and step in (ROOT / "docs/ros.md").read_text("utf-8")


def test_every_ros_package_that_is_imported_is_declared():
    """The list of what only some rooms may import is in pyproject.toml, by import-linter."""
    root = ElementTree.parse(ROOT / "package.xml").getroot()
    declared = {each.text for each in root.findall("exec_depend")}
    files = [*(ROOT / "screw_module_ros").rglob("*.py"), *(ROOT / "launch").glob("*.py")]
    found = {
        name
        for file in files
        for name in re.findall(r"^\s*(?:from|import) (\w+)", file.read_text("utf-8"), re.M)
    }
    ros = {name for name in found if name.endswith("_msgs") or name.startswith(("rcl", "launch"))}
    assert {"rclpy", "screw_module_msgs", "launch_ros"} <= ros
    assert ros | {"rmw_fastrtps_cpp"} <= declared


def test_what_the_page_for_therapists_quotes_is_said_there():
    """Each sentence in italics begins as one of the page, of the session or of the hand does."""
    places = ("therapy/*.py", "nodes/*.py", "bridge/pages/static/js/*.js")
    files = [file for each in places for file in (ROOT / "screw_module_ros").glob(each)]
    said = "\n".join(file.read_text("utf-8") for file in files)
    table = (ROOT / "docs/therapist.md").read_text("utf-8").partition("| the page says")[2]
    quoted = re.findall(r"\*([^*]+)\*", table)
    assert len(quoted) > 8
    for sentence in quoted:
        for part in re.sub(r" for \d+ s$", "", sentence).split(": "):
            assert part in said, sentence


def test_the_profile_of_the_porting_page_is_read(tmp_path):
    """Its example names a guard that it lacks and what stands in for it."""
    text = (ROOT / "docs" / "porting.md").read_text(encoding="utf-8")
    file = tmp_path / "mine.yaml"
    file.write_text(re.search(r"^```yaml\n(.*?)^```", text, re.M | re.S)[1], encoding="utf-8")
    assert profiles.load(str(file), profiles.DRIVE).drive.substitutes


@pytest.mark.parametrize(
    ("folder", "names", "page"),
    [("devices", profiles.NAMES, "hardware"), ("therapy", protocol_file.SHIPPED, "therapy")],
)
def test_what_ships_has_its_name_in_the_list_and_on_its_page(folder, names, page):
    files = sorted((ROOT / "params" / folder).glob("*.yaml"))
    assert [file.stem for file in files] == sorted(names)
    told = (ROOT / f"docs/{page}.md").read_text(encoding="utf-8")
    assert [name for name in names if f"`{name}`" not in told] == []


def test_a_protocol_that_ships_is_named_as_its_file():
    for file in (ROOT / "params/therapy").glob("*.yaml"):
        assert yaml.safe_load(file.read_text("utf-8"))["name"] == file.stem
