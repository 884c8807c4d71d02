# SPDX-License-Identifier: Apache-2.0
"""Digest of a law's behaviour: blind to what has no effect, and to nothing else."""

import ast
import importlib
import subprocess
from pathlib import Path
from types import SimpleNamespace

import pytest

import screw_module_ros
from screw_module_ros.behaviour import canonical, digest
from screw_module_ros.calibration.plane_version import plane_law_version
from screw_module_ros.calibration.version import source_of
from screw_module_ros.control import plane_envelope, plane_law
from screw_module_ros.control.envelope import enveloped, initial_state
from screw_module_ros.control.laws import plane_impedance, thesis
from screw_module_ros.control.laws.plane_impedance import PLANE_IMPEDANCE

LAW = (
    enveloped, initial_state, thesis.foresee, thesis.ask, thesis.helps, thesis.rest,
    thesis.new_memory, thesis.own_numbers,
)  # fmt: skip
PLANE = (
    plane_envelope.enveloped, plane_envelope.initial_state, plane_impedance.needs, plane_law.spring,
    plane_impedance.helps, plane_impedance.rest, plane_impedance.new_memory,
    plane_law.settings_alone,
)  # fmt: skip
SHIPPED = digest(*LAW)
CONTROL = "screw_module_ros.control"
FILTERS = "screw_module_ros.filters"


def source(module: str) -> str:
    """Return a module's source."""
    with open(importlib.import_module(module).__file__, encoding="utf-8") as file:
        return file.read()


def changed(module: str, old: str, new: str) -> dict[str, str]:
    """Return a module's source with one text in place of another, which it must have."""
    text = source(module)
    assert text.count(old), f"{module} has no {old!r}"
    return {module: text.replace(old, new, 1)}


@pytest.mark.parametrize(
    ("module", "old", "new"),
    [
        (f"{CONTROL}.gain_guard", "resistance that the handle shall show", "the least resistance"),
        (f"{CONTROL}.envelope", "# as it is sent, after all limits", ""),
        (f"{CONTROL}.envelope", '"""Return whether the inputs can be real;', '"""Whether so;'),
        (f"{CONTROL}.observer", '"""Commands remembered; the observer', '"""Remembered; it'),
        (f"{CONTROL}.envelope", " share = dt / p.fade_time\n", "\n    share = (dt/p.fade_time)\n"),
        (f"{CONTROL}.gain_guard", "PASSIVE = 2.0", "PASSIVE = 2.00"),
        (f"{CONTROL}.envelope", "position: float) -> VerticalOutput", "position) -> object"),
        (f"{CONTROL}.envelope", "    base: float = 0.0", "    base: 'object' = 0.0"),
        # Never reached: the settings' ranges and defaults, the encoder's filter, the plane.
        (f"{CONTROL}.vertical_settings", "0.0, 50.0, live=True", "0.0, 60.0, live=True"),
        (FILTERS, "LONGEST_GAP = 10", "LONGEST_GAP = 11"),
        (f"{CONTROL}.gain_guard", 'f"chatter guard:', 'f"guard:'),
        (f"{CONTROL}.plane_envelope", "-p.half_width", "-0.5 * p.half_width"),
    ],
)
def test_what_has_no_effect_on_the_vertical_law_leaves_its_digest(module, old, new):
    """A corrected comment in `control` was another version of the law: its gains were refused."""
    assert digest(*LAW, texts=changed(module, old, new)) == SHIPPED


@pytest.mark.parametrize(
    ("module", "old", "new"),
    [
        (f"{CONTROL}.gain_guard", "PASSIVE = 2.0", "PASSIVE = 2.001"),
        (f"{CONTROL}.gain_guard", "PASSIVE = 2.0", "PASSIVE = 2"),
        (f"{CONTROL}.limits", "LONGEST_STEP =", "LONGEST_STEP = 2.0 *"),
        (f"{CONTROL}.envelope", "impedance + gravity + friction", "impedance - gravity + friction"),
        (f"{CONTROL}.envelope", "    base: float = 0.0", "    base: float = 1.0"),
        (f"{CONTROL}.observer", "stood: float = RESTING_TIME", "stood: float = 0.0"),
        (f"{CONTROL}.friction", "def hysteresis(", "@cached\ndef hysteresis("),
        (f"{CONTROL}.laws.thesis", "u.mode == OBSERVER", "u.mode >= OBSERVER"),
        (FILTERS, "warped / (1.0 + warped)", "warped / (1.1 + warped)"),
        (FILTERS, "recent: float = RECENT", "recent: float = 0.5"),
        (f"{CONTROL}.envelope", "smoothed, tune\n", "smoothed, rapid as tune\n"),
        (f"{CONTROL}.laws.thesis", "HELD = 0.8", "HELD = 0.8\nHELD += 0.1"),
        (f"{CONTROL}.vertical_settings", "2.0 * ratio * math.sqrt", "2.0 * ratio * math.exp"),
        (f"{CONTROL}.gain_guard", "import math\n", "import cmath as math\n"),
    ],
)
def test_what_the_vertical_law_reaches_changes_its_digest(module, old, new):
    assert digest(*LAW, texts=changed(module, old, new)) != SHIPPED


def test_it_is_the_version_of_the_shipped_law():
    assert source_of(thesis.THESIS) == SHIPPED


def test_each_law_has_its_own_and_the_plane_sees_its_own_change():
    plane = plane_law_version(PLANE_IMPEDANCE)
    assert plane != SHIPPED
    narrower = changed(f"{CONTROL}.plane_envelope", "-p.half_width", "-0.5 * p.half_width")
    assert digest(*PLANE) == plane != digest(*PLANE, texts=narrower)


def reached(text: str, other: str = "") -> str:
    """Return the digest of the vertical law's file when it holds a text alone, limits another."""
    return digest(
        SimpleNamespace(__module__=f"{CONTROL}.vertical", __name__="vertical_step"),
        texts={f"{CONTROL}.vertical": text, f"{CONTROL}.limits": other}
    )  # fmt: skip


@pytest.mark.parametrize(
    ("text", "other"),
    [
        ("from .limits import WIDTH\ndef vertical_step(p): return WIDTH", "WIDTH = {}"),
        ("from .limits import WIDTH as W\ndef vertical_step(p): return W", "WIDTH = {}"),
        ("from . import limits\ndef vertical_step(p): return limits.WIDTH", "WIDTH = {}"),
        ("def vertical_step(p):\n from .limits import f\n return f(p)", "def f(p): return {}"),
        ("from .limits import P\ndef vertical_step(p: P): return p.size",
         "class P:\n @property\n def size(self): return {}"),
        ("from .limits import f\ndef vertical_step(p): return f(p)",
         "if True:\n def f(p): return {}"),
        ("from .limits import T\ndef vertical_step(p): return T[0]", "T = [1]\nT[0] = {}"),
        ("from .limits import T\ndef vertical_step(p): return T[0]", "T = [1]\nT.append({})"),
        ("from .limits import A\ndef vertical_step(p): return A", "A = B = C + 1\nC = {}"),
    ],
)  # fmt: skip
def test_by_whatever_name_a_number_is_reached_it_counts(text, other):
    assert reached(text, other.format(1.0)) == reached(text, other.format("1.00"))
    assert reached(text, other.format(1.0)) != reached(text, other.format(1.001))


def test_the_same_two_functions_in_each_others_place_are_another_law():
    other = "def f(p): return 1.0\ndef g(p): return 2.0"
    step = "\ndef vertical_step(p): return a(p) - b(p)"
    one = reached(f"from .limits import f as a, g as b{step}", other)
    assert one != reached(f"from .limits import g as a, f as b{step}", other)


def test_names_that_cannot_be_followed_are_refused():
    with pytest.raises(ValueError, match=r"limits import \*"):
        reached("from .limits import *\ndef vertical_step(p): return WIDTH", "WIDTH = 1.0")


LAW_TEXT = """
def step(p: float, *, q=2.0, r) -> float:
    '''A text.'''
    return {**p, 'a': -q} if r else u'b'
class Empty:
    '''Nothing.'''
"""


def as_parsed_elsewhere(tree: ast.Module) -> ast.Module:
    """Return a tree as another Python makes it: fields that are missing, added or filled."""
    for node in ast.walk(tree):
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            if hasattr(node, "type_params"):
                del node.type_params  # before 3.12
            else:
                node._fields = (*node._fields, "type_params")
                node.type_params = []
        if isinstance(node, ast.FunctionDef):
            node._fields = (*reversed(node._fields), "of_a_later_version")
            node.of_a_later_version = None
        if isinstance(node, ast.Constant):
            node.kind = None if node.kind else "u"
    return tree


def test_trees_of_other_pythons_are_the_same_text():
    here = canonical(ast.parse(LAW_TEXT))
    assert canonical(as_parsed_elsewhere(ast.parse(LAW_TEXT))) == here
    assert len(canonical(as_parsed_elsewhere(ast.parse(source(f"{CONTROL}.envelope"))))) > 10_000


OF_ANOTHER_PYTHON = f"""
from types import SimpleNamespace
from screw_module_ros.behaviour import digest
law = {{"envelope": ("enveloped", "initial_state"),
       "laws.thesis": ("foresee", "ask", "helps", "rest", "new_memory", "own_numbers")}}
print(digest(*(SimpleNamespace(__module__=f"{CONTROL}.{{module}}", __name__=name)
               for module, names in law.items() for name in names)))
"""


@pytest.mark.parametrize("version", ["3.10", "3.11", "3.12", "3.13"])
def test_every_python_on_this_machine_finds_the_same(version):
    """The names of the law's functions alone are given: another Python has no numba, no numpy."""
    path = f"import sys; sys.path.insert(0, {str(Path(screw_module_ros.__path__[0]).parent)!r})"
    command = [f"python{version}", "-I", "-c", path + OF_ANOTHER_PYTHON]
    try:
        ran = subprocess.run(command, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        pytest.skip("it is not on the PATH")
    if ran.returncode == 127:  # a version manager's name for a Python that is not selected
        pytest.skip("it cannot be started")
    assert ran.stdout.strip() == SHIPPED, ran.stderr


@pytest.mark.parametrize(
    ("one", "other"),
    [("{**a, 1: b}", "{1: a, **b}"), ("1", "1.0"), ("1", "True"), ("'1'", "1"), ("b'a'", "'a'"),
     ("lambda *, a, b=1: 0", "lambda *, a=1, b: 0"), ("None", "()"), ("-a", "+a"),
     ("f(a, b)", "f((a, b))"), ("x[a:]", "x[:a]"), ("a < b", "a > b"), ("'\\u0430'", "'a'")],
)  # fmt: skip
def test_different_expressions_are_different_texts(one, other):
    assert canonical(ast.parse(f"x = {one}")) != canonical(ast.parse(f"x = {other}"))


def test_the_text_is_ascii_whatever_a_python_can_print():
    """Which characters `repr` prints depends on the Unicode tables of a version."""
    assert canonical(ast.parse("a = '\\u0430\\U0001fae8'")).isascii()
