# SPDX-License-Identifier: Apache-2.0
"""Each default says where it is from, and what it takes from the thesis equals its figure there.

`screw_module_ros/thesis.py` explains the comments. Held here: each value of `params/plant.yaml`,
`params/patients.yaml` and `params/friction_thesis.yaml`, the physical ones of
`params/hardware.yaml` and `params/sim.yaml`, every default of the settings in `control/` and
`plant/`, and every other number of the package whose comment names a key.
"""

from __future__ import annotations

import ast
import functools
import io
import math
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import yaml

from screw_module_ros import thesis
from screw_module_ros.settings import SettingError

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "screw_module_ros"
REFERENCES = ROOT / "docs/references.md"
WHOLE = ("plant", "friction_thesis", "patients")  # params files of which every value has a source
ROBOTS = ("hardware", "sim")
NOT_PHYSICAL = {
    "rate", "node_id", "shoulder.node_id", "elbow.node_id", "master_id", "base_id", "can.bitrate",
    "realtime.priority", "mode", "direction", "shoulder.direction", "elbow.direction", "sign",
    "seed", "speed", "version",
}  # fmt: skip
"""Numbers of the parameter files that are addresses, rates of programs, choices and signs."""
MADE_ELSEWHERE = {
    "NAME.yaml", "params/devices/NAME.yaml", "report.md", "report.html", "results.yaml",
    "scores.json", "/config.json", "ROSBRIDGE_PROTOCOL.md", "columns.csv", "scores.csv",
    "sessions.csv", "trials.csv",
}  # fmt: skip
"""Files that comments name and the repository lacks: programs write them, or others have them."""

UNIT = re.compile(r"\s*\[([^\]]*)\]")
SOURCE = re.compile(
    r"\s*(?:thesis: (?P<key>\w+)(?:\[(?P<part>\d+)\])?(?: (?P<sign>[/x]) (?P<times>[\d.]+))?"
    r"|(?P<ours>ours)|(?:public program|work): (?P<program>\w+)|(?P<none>unsourced))(?=[;:,.]|$)"
)
NAMED = re.compile(r"\bthesis: ([a-z]\w*)")
FILE = re.compile(
    r"(?<![\w/.{}*<>~-])((?:\.{0,2}/)?[A-Za-z_][\w-]*(?:/[\w.-]+)*"
    r"\.(?:py|yaml|md|msg|srv|action|json|xacro|csv|jinja|eds|toml|txt|rst|js|html))\b(?![\w(*])"
)


class Value(NamedTuple):
    """A number, or a list of some, with its unit and the comment beside it."""

    place: str
    value: Any
    unit: str | None
    comment: str


def flaw(found: Value, must: bool = True) -> str:
    """Return what is wrong with the source of a value, empty if nothing; must: it needs one."""
    text = found.comment.removeprefix("#")
    unit = UNIT.match(text)
    source = SOURCE.match(text[unit.end() :] if unit else text)
    if not source:
        wrong = f"{found.place}: {text.strip()!r} begins with none of the five words"
        return wrong if must or NAMED.search(text) else ""
    if key := source["key"]:
        try:
            return _unlike(found, source, thesis.fact(key), unit[1] if unit else found.unit)
        except SettingError as error:
            return f"{found.place}: {error}"
    if source["program"] and source["program"] not in reference_keys():
        return f"{found.place}: {REFERENCES.name} has no {source['program']}"
    return ""


def _unlike(found: Value, source: re.Match, fact: thesis.Fact, unit: str | None) -> str:
    wanted = fact.value[int(source["part"])] if source["part"] else fact.value
    wanted = wanted if isinstance(wanted, list) else [wanted]
    ours = found.value if isinstance(found.value, list) else [found.value]
    times = float(source["times"] or 1.0)
    factor = 1.0 / times if source["sign"] == "/" else times
    wanted = [thesis.in_unit(factor * n, fact.unit, fact.unit if unit is None else unit)
              for n in wanted]  # fmt: skip
    if len(ours) == len(wanted) and all(map(_close, ours, wanted)):
        return ""
    shown = wanted if len(wanted) > 1 else wanted[0]
    return f"{found.place} = {found.value}, but {source['key']} gives {shown}"


def _close(ours: float, wanted: float) -> bool:
    return math.isclose(ours, wanted, rel_tol=1e-9)


def reference_keys() -> set[str]:
    """Return the keys of docs/references.md."""
    text = REFERENCES.read_text("utf-8") if REFERENCES.exists() else ""
    return set(re.findall(r"^- \*\*(\w+)\*\*", text, re.M))


# Values and their comments -------------------------------------------------------------------


def of_yaml(text: str, name: str) -> Iterator[Value]:
    """Yield the numbers of a YAML text; a comment stands at the end of the line or just above."""
    lines = text.splitlines()

    def walk(node: yaml.Node, path: str) -> Iterator[Value]:
        if isinstance(node, yaml.MappingNode):
            for key, value in node.value:
                yield from walk(value, f"{path}.{key.value}" if path else key.value)
            return
        numbers = yaml.safe_load(yaml.serialize(node))
        some = numbers if isinstance(numbers, list) else [numbers]
        if all(isinstance(n, (int, float)) and not isinstance(n, bool) for n in some):
            yield Value(f"{name}: {path}", numbers, None, _beside(lines, node.start_mark.line))

    yield from walk(yaml.compose(text, yaml.SafeLoader), "")


def _beside(lines: list[str], number: int) -> str:
    """Return the comment at the end of a line, else that of the line above it."""
    _, mark, comment = lines[number].partition("#")
    above = lines[number - 1].strip() if number else ""
    return comment if mark else above.removeprefix("#") if above.startswith("#") else ""


@functools.cache
def comments_of(text: str) -> dict[int, str]:
    """Return the comments of a Python text by line."""
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    return {token.start[0]: token.string for token in tokens if token.type == tokenize.COMMENT}


def of_python(text: str, name: str) -> Iterator[tuple[Value, bool]]:
    """Yield the numbers assigned in a Python text, and whether each is a default of a setting."""
    comments = comments_of(text)
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.AnnAssign) and node.value:
            target, setting = ast.unparse(node.target), _setting(node.annotation)
            first = node.annotation.end_lineno
        elif isinstance(node, ast.Assign):
            target, setting, first = ast.unparse(node.targets[0]), None, node.lineno
        else:
            continue
        try:
            value = ast.literal_eval(node.value)
        except ValueError:
            continue
        some = value if isinstance(value, (tuple, list)) else [value]
        if not some or not all(isinstance(n, (int, float)) and type(n) is not bool for n in some):
            continue
        beside = next((comments[n] for n in range(first, node.end_lineno + 1) if n in comments), "")
        whole = list(value) if isinstance(value, tuple) else value
        unit = setting.args[1].value if setting and len(setting.args) > 1 else None
        yield Value(f"{name}: {target}", whole, unit, beside), setting is not None


def _setting(annotation: ast.expr) -> ast.Call | None:
    for node in ast.walk(annotation):
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "Setting":
            return node
    return None


def yaml_flaws(text: str, name: str, whole: bool) -> list[str]:
    """Return what is wrong with the sources in a parameter file; whole: all of its values."""
    found = []
    for value in of_yaml(text, name):
        key = value.place.rpartition("ros__parameters.")[2].rpartition(": ")[2]
        if whole or key not in NOT_PHYSICAL:
            found.append(flaw(value, must=key not in NOT_PHYSICAL))
    return [each for each in found if each]


def python_flaws(text: str, name: str, settings: bool) -> list[str]:
    """Return what is wrong with the sources in a Python text; settings: all defaults need one."""
    found = [flaw(value, must=settings and default) for value, default in of_python(text, name)]
    return [each for each in found if each]


# What is held --------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [*WHOLE, *ROBOTS])
def test_every_number_of_a_parameter_file_says_where_it_is_from(name):
    text = (ROOT / f"params/{name}.yaml").read_text("utf-8")
    assert len(list(of_yaml(text, name))) > 10
    assert yaml_flaws(text, f"{name}.yaml", whole=name in WHOLE) == []


PYTHON = sorted(PACKAGE.rglob("*.py"))


def test_every_default_of_law_and_plant_says_where_it_is_from():
    wrong = []
    for file in PYTHON:
        room = file.relative_to(PACKAGE).parts[0]
        text = file.read_text("utf-8")
        name = str(file.relative_to(ROOT))
        wrong += python_flaws(text, name, settings=room in ("control", "plant", "geometry.py"))
    assert wrong == []


def test_every_key_that_a_comment_names_exists():
    named = {}
    for file in [*PYTHON, *(ROOT / "test").rglob("*.py"), *(ROOT / "params").rglob("*.yaml")]:
        text = file.read_text("utf-8")
        words = comments_of(text).values() if file.suffix == ".py" else re.findall("#.*", text)
        named |= {key: file.name for each in words for key in NAMED.findall(each)}
    assert len(named) > 50
    assert {key: file for key, file in named.items() if key not in thesis.facts()} == {}


@functools.cache
def written(file: Path) -> list[str]:
    """Return the comments and docstrings of a file."""
    text = file.read_text("utf-8")
    if file.suffix != ".py":
        return re.findall("#.*", text)
    return [*comments_of(text).values(), *(
        node.value.value for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )]  # fmt: skip


def missing_files(texts: list[str], there: set[str]) -> set[str]:
    """Return the files that texts name and that do not exist; there: endings of paths."""
    named = {name for text in texts for name in FILE.findall(text)} - MADE_ELSEWHERE
    return {name for name in named if name.lstrip("./") not in there}


def _endings() -> set[str]:
    """Return all endings of the paths of the repository's files: a comment names the last parts."""
    found = set()
    for folder, kinds in (
        (".", ("*.*",)), ("screw_module_ros", ("**/*.*",)), ("test", ("**/*.*",)),
        ("params", ("**/*.*",)), ("docs", ("**/*.*",)), ("msg_defs", ("**/*.*",)),
        ("tools", ("*.*",)), ("examples", ("*.*",)), ("launch", ("*.*",)), ("urdf", ("*.*",)),
        ("security", ("*.*",)), ("requirements", ("*.*",)), ("rviz", ("*.*",)),
        (".github", ("**/*.*",)),
    ):  # fmt: skip
        for kind in kinds:
            for file in (ROOT / folder).glob(kind):
                parts = file.relative_to(ROOT).parts
                found |= {"/".join(parts[n:]) for n in range(len(parts))}
    return found


def test_every_file_that_a_comment_names_exists():
    endings = _endings()
    files = [*PYTHON, *(ROOT / "test").rglob("*.py"), *(ROOT / "tools").glob("*.py"),
             *(ROOT / "params").rglob("*.yaml"), *(ROOT / "msg_defs").glob("*/*.*"),
             *(ROOT / "launch").glob("*.py"), *(ROOT / "examples").glob("*.py")]  # fmt: skip
    wrong = {
        str(file.relative_to(ROOT)): lost
        for file in files if (lost := missing_files(written(file), endings))
    }  # fmt: skip
    assert wrong == {}


YEARED = re.compile(r"\b[a-z]{2,}(?:19|20)\d\d[a-z]*\b")  # an author and a year
UNDATED = re.compile(r"\b(?:imtclock|inmotionpy|inmotionretest)\b")


def works_named(texts: list[str]) -> set[str]:
    """Return the keys of works that texts name."""
    return {key for text in texts for key in YEARED.findall(text) + UNDATED.findall(text)}


def test_every_work_that_is_named_has_an_entry_and_every_entry_is_named():
    files = [*PYTHON, *(ROOT / "params").rglob("*.yaml"), *(ROOT / "docs").glob("*.md"),
             ROOT / "README.md", ROOT / "CITATION.cff"]  # fmt: skip
    texts = [text for file in files if file != REFERENCES for text in _prose(file)]
    page, _, further = REFERENCES.read_text("utf-8").partition("## Further reading")
    entries = re.compile(r"^- \*\*(\w+)\*\*", re.M)
    named = works_named(texts)
    assert named - reference_keys() == set()
    assert set(entries.findall(page)) - named == set(), "named nowhere: Further reading"
    assert set(entries.findall(further)) & named == set()


def _prose(file: Path) -> list[str]:
    return written(file) if file.suffix == ".py" else [file.read_text("utf-8")]


def test_every_key_of_the_page_of_contradictions_exists():
    keys = re.findall(r"; `(\w+)`[);]", (ROOT / "docs/contradictions.md").read_text("utf-8"))
    assert len(keys) > 20
    assert set(keys) - set(thesis.facts()) == set()


@pytest.mark.parametrize("name", ["clock_adaptive", "elevator", "evaluation", "reach_3d", "lift"])
def test_a_protocol_names_the_source_of_what_it_took_over(name):
    text = (ROOT / f"params/therapy/{name}.yaml").read_text("utf-8")
    values = list(of_yaml(text, f"{name}.yaml"))
    assert [wrong for value in values if (wrong := flaw(value, must=False))] == []
    assert not re.search(r"#.*\b(published|literature)\b", text)


# It can fail ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("lead: 0.01905  # [m] thesis: lead", ""),
        ("lead: 19.05  # [mm] thesis: lead", ""),
        ("half: 0.1905  # [m] thesis: workspace_width / 2; from the centre", ""),
        ("mass: 0.3  # thesis: simulated_reduction[1] x 0.15", ""),
        ("# [N] thesis: up_low_speed\nlow: [0.754, 0.15]", "cannot be given in N"),
        ("# thesis: up_low_speed\nlow: [0.754, 0.15]", ""),
        ("# thesis: up_low_speed\nlow: [0.754, 0.16]", "but up_low_speed gives [0.754, 0.15]"),
        ("lead: 0.0190  # [m] thesis: lead", "but lead gives 0.01905"),
        ("lead: 0.01905  # [mm] thesis: lead", "but lead gives 19.05"),
        ("lead: 0.01905  # [kg] thesis: lead", "cannot be given in kg"),
        ("lead: 0.01905  # [m] thesis: laed", "no key 'laed'; lead is there"),
        ("lead: 0.01905  # [m] thesis 2.3", "none of the five words"),
        ("lead: 0.01905  # [m] see thesis: lead", "none of the five words"),
        ("lead: 0.01905", "none of the five words"),
        ("lead: 0.01905  # [m] ours: it fits", ""),
        ("lead: 0.01905  # [m] unsourced", ""),
        ("lead: 0.01905  # [m] oursome", "none of the five words"),
        ("lead: 0.01905  # [m] public program: nobodys", "has no nobodys"),
    ],
)  # fmt: skip
def test_a_wrong_source_is_told(line, said):
    found = yaml_flaws(line, "made.yaml", whole=True)
    assert len(found) == bool(said) and said in "".join(found)


@pytest.mark.parametrize(
    ("pattern", "wrong", "said"),
    [
        (r"0\.01905", "0.01906", "vertical.lead = 0.01906, but lead gives 0.01905"),
        (r"thesis: lead\b", "thesis: leed", "no key 'leed'"),
        (r"thesis: lead\b", "measured", "vertical.lead: '[m] measured' begins with none"),
        (r"0\.2334", "0.2335", "friction.against.trend = "),
    ],
)
def test_a_wrong_plant_file_is_told(pattern, wrong, said):
    text = (ROOT / "params/plant.yaml").read_text("utf-8")
    found = yaml_flaws(re.sub(pattern, wrong, text, count=1), "plant.yaml", whole=True)
    assert len(found) == 1 and said in found[0]


def test_a_wrong_default_of_a_law_is_told():
    text = (PACKAGE / "control/vertical_settings.py").read_text("utf-8")
    right = "] = 65.0  # thesis: force_up"
    for wrong, said in (("] = 66.0  # thesis: force_up", "but force_up gives 65.0"),
                        ("] = 65.0", "none of the five words")):  # fmt: skip
        assert text.count(right) == 1
        found = python_flaws(text.replace(right, wrong), "vertical_settings.py", settings=True)
        assert len(found) == 1 and said in found[0]


def test_a_work_without_an_entry_is_told():
    found = works_named(["a wall (nobody1999), of imtclock", "since 2001, in test2000.py's 1990s"])
    assert found - reference_keys() == {"nobody1999", "test2000"}


def test_a_missing_file_is_told():
    texts = ["see plant/friction.py and identification/endpoint_inertia.py", "NAME.yaml"]
    assert missing_files(texts, _endings()) == {"identification/endpoint_inertia.py"}
