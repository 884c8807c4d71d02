# SPDX-License-Identifier: Apache-2.0
"""Laws of other packages: what is taken, and the sentence for what is not."""

from __future__ import annotations

import math
import signal
import sys
from dataclasses import dataclass, replace
from functools import partial
from importlib import metadata
from typing import Annotated, NamedTuple

import pytest

from screw_module_ros import plugins
from screw_module_ros.calibration.version import law_version
from screw_module_ros.control import laws
from screw_module_ros.control.envelope import enveloped, initial_state
from screw_module_ros.control.law import LINEAR, Law, Margin, Variant, pulls
from screw_module_ros.control.laws import plane
from screw_module_ros.control.plane_law import PlaneLaw
from screw_module_ros.control.vertical import VerticalInput
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.settings import Setting, SettingError


class Own(NamedTuple):
    """Settings of a law."""

    gain: Annotated[float, Setting("of the hand's force", "", 0.0, 10.0)] = 1.0


class Signed(NamedTuple):
    """Settings of a law whose gain has any sign."""

    gain: Annotated[float, Setting("of the hand's force", "", -10.0, 10.0)] = 1.0


class Tabled(NamedTuple):
    """Settings of a law that also reads a file."""

    gain: Annotated[float, Setting("of the hand's force", "", 0.0, 10.0)] = 1.0
    table: str = ""


def beginning(value, text="a gain", hint=None):
    """Return a class of settings whose gain begins with a value."""

    class Settings(NamedTuple):
        gain: float = value

    limited = Annotated[float, Setting(text, "", 0.0, 1.0)]
    Settings.__annotations__["gain"] = hint or limited
    return Settings


MINE = Law("mine", {100: Variant("MINE", ("gain",))}, Own)
OTHER = Law("mine", {100: Variant("OTHER")}, Own)
SAME_TITLE = Law("another", {101: Variant("MINE")}, Own)
SAME_MODE = Law("another", {100: Variant("ANOTHER")}, Own)
PLANE = PlaneLaw("flat", Own)
SAME_RESULT = Law(
    "third", {110: Variant("THIRD", ("gain",))}, Own, judged=LINEAR,
    margins=(Margin("gain", "feedback", (), ()),),
)  # fmt: skip
NO_LAW = 3.0


@dataclass
class Seen:
    """Memory of a law."""

    seen: float = 0.0


def path(name: str) -> str:
    """Return the path of a law in this file."""
    return f"{__name__}:{name}"


def test_a_law_is_found_by_module_and_name_and_by_entry_point(monkeypatch):
    assert laws.load(path("MINE")) is MINE
    point = metadata.EntryPoint("floor", path("MINE"), laws.GROUP)
    monkeypatch.setattr(plugins, "entry_points", lambda group: [point])
    assert laws.load("floor") is MINE


@pytest.mark.parametrize(
    ("named", "said"),
    [
        ("floor", "neither package.module:NAME nor an entry point of screw_module_ros.laws"),
        ("no_such_module:LAW", "no_such_module:LAW: ModuleNotFoundError: No module named"),
        (path("MISSING"), "AttributeError: module .* has no attribute 'MISSING'"),
        (path("NO_LAW"), "is no screw_module_ros.control.law.Law"),
    ],
)
def test_what_is_no_law_is_told_in_a_sentence(named, said):
    with pytest.raises(SettingError, match=said) as caught:
        laws.load(named)
    assert str(caught.value).startswith(f"law {named}: ")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"name": "my law"}, "'my law', is also the prefix of its parameters"),
        ({"variants": {7: Variant("SEVEN")}}, "those of other packages are 100 to 199"),
        ({"name": "self"}, "is also the prefix of its parameters"),
        ({"ask": None}, "its ask is no function"),
        ({"variants": [100]}, "are no dict of numbers to Variant"),
        ({"variants": {"100": Variant("A")}}, "are no dict of numbers to Variant"),
        ({"variants": {100: "A"}}, "a Variant with a tuple of gains is wanted"),
        ({"variants": {100: Variant("A", "gain")}}, "a Variant with a tuple of gains is wanted"),
        ({"variants": {100: Variant("IMPEDANCE")}}, "the name of a mode of this package"),
        ({"settings": VerticalSettings}, "are those of a law of this package"),
        ({"settings": Own()}, "its settings are no NamedTuple"),
        ({"variants": {}}, "those of other packages are 100 to 199"),
        ({"variants": {100: Variant("A"), 102: Variant("B")}}, "they must follow each other"),
        ({"heeds": True}, "the envelope does that"),
        ({"settings": dict}, "its settings are no NamedTuple"),
        ({"settings": NamedTuple("Bare", [("gain", float)])}, "its setting gain has no default"),
        ({"shown": tuple("abcdefghi")}, "is no tuple of 8 names at most"),
        ({"shown": (1, 2)}, "is no tuple of 8 names at most"),
        ({"shown": ("depth", "depth")}, "has a name twice"),
        ({"name": "größe"}, "is also the prefix of its parameters"),
        ({"name": "n" * 61}, "is also the prefix of its parameters"),
        ({"variants": {100: Variant("no\ud800pe")}}, "a short name is wanted"),
        ({"variants": {100: Variant(None)}}, "a short name is wanted"),
        ({"variants": {100: Variant("A"), 101: Variant("A")}}, "two of its modes have one name"),
        ({"variants": {100: Variant("A", (["gain"],))}}, "TypeError: unhashable type"),
        ({"settings": beginning(2.0)}, "gain = 2.0: above the largest allowed, 1"),
        ({"settings": beginning(1)}, "its setting gain begins as 1, no float"),
        ({"settings": beginning([1.0])}, "its setting gain begins as [1.0], no float"),
        ({"settings": beginning(math.nan)}, "gain = nan: a finite number is wanted"),
        ({"settings": beginning(1.0, "\ud800")}, "UnicodeEncodeError"),
        ({"settings": beginning(1.0, hint="flaot")}, "NameError: name 'flaot' is not defined"),
        ({"margins": "gain"}, "AttributeError"),
        ({"variants": {100: Variant("A", ("force",))}}, "its gain force is none of its settings"),
        ({"judged": LINEAR, "settings": Signed}, "its gain gain may be negative"),
        ({"judged": LINEAR, "settings": Tabled}, "its setting table, on which its gain limits d"),
    ],
    ids=str,
)
def test_a_law_that_others_may_not_bring_is_refused(change, said):
    assert not laws.flaw(MINE)
    assert said in laws.flaw(replace(MINE, **change))


@pytest.mark.parametrize(
    ("second", "said"),
    [
        ("OTHER", "another one is called mine too"),
        ("SAME_MODE", "mode 100 is mine's"),
        ("SAME_TITLE", "mine has a mode MINE too"),
        ("SAME_RESULT", "its gain in results, feedback, is thesis's: choose another name"),
    ],
)
def test_two_laws_with_one_name_mode_or_gain_in_results_are_refused(second, said):
    assert laws.loaded(["", path("MINE")]) == (*laws.LAWS, MINE)
    with pytest.raises(SettingError, match=said):
        laws.loaded([path("MINE"), path(second)])


def test_an_error_in_a_law_s_own_refusal_is_its_refusal():
    def objects(settings, mode):
        raise ZeroDivisionError("no such gain")

    assert laws.refusal(MINE, Own(), 100) == ""
    assert laws.refusal(replace(MINE, refusal=lambda settings, mode: None), Own(), 100) == ""
    assert "no sentence" in laws.refusal(replace(MINE, refusal=lambda s, mode: True), Own(), 100)
    said = laws.refusal(replace(MINE, refusal=objects), Own(), 100)
    assert said == "law mine: refusal: ZeroDivisionError: no such gain"


def test_a_refusal_is_one_line_whatever_it_says_or_raises():
    def leaves(settings, mode):
        raise SystemExit("bye\nbye")

    class Unreadable:
        def __repr__(self):
            raise ValueError("no text")

    assert laws.refusal(replace(MINE, refusal=leaves), Own(), 100) == (
        "law mine: refusal: SystemExit: bye bye"
    )
    said = laws.refusal(replace(MINE, refusal=lambda s, mode: "\ud800" * 1000), Own(), 100)
    assert said.isprintable() and len(said) == 300
    said = laws.refusal(replace(MINE, refusal=lambda s, mode: Unreadable()), Own(), 100)
    assert said == "law mine: refusal: ValueError: no text"


@pytest.fixture
def imported(tmp_path, monkeypatch):
    """Return what imports a module of a text as a law's."""
    monkeypatch.syspath_prepend(str(tmp_path))

    def load(text):
        (tmp_path / "brought.py").write_text(text)
        try:
            return laws.load("brought:LAW")
        finally:
            sys.modules.pop("brought", None)

    return load


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("import sys; sys.exit('no')", "SystemExit: no"),
        ("raise GeneratorExit", "GeneratorExit"),
        ("raise ValueError('\\ud800\\n')", r"ValueError: ?"),
        ("LAW = ", "SyntaxError: invalid syntax"),
    ],
)
def test_a_module_that_cannot_be_imported_is_a_sentence(imported, text, said):
    with pytest.raises(SettingError) as caught:
        imported(text)
    assert str(caught.value).startswith(f"law brought:LAW: {said}")


def test_a_law_whose_module_handles_signals_leaves_them_to_the_node(imported):
    """A node ends in order by them: torque off, a last zero."""

    def ends(number, frame):
        pass

    before = signal.signal(signal.SIGTERM, ends)
    try:
        with pytest.raises(SettingError, match="no attribute 'LAW'"):
            imported("import signal; signal.signal(signal.SIGTERM, signal.SIG_IGN)")
        assert signal.getsignal(signal.SIGTERM) is ends
    finally:
        signal.signal(signal.SIGTERM, before)


def test_the_version_of_a_law_of_others_is_its_source_and_the_envelope():
    version = law_version(replace(MINE, ask=lambda own, m, sample, motion: pulls(1.0)))
    assert len(version) == 12 and version != law_version() != law_version(MINE)
    assert law_version(replace(MINE, ask=partial(max, 1.0))) == "unknown", "it is no Python"
    gone = lambda own, m, sample, motion: pulls(1.0)  # noqa: E731
    gone.__module__ = "no.such.module"
    assert law_version(replace(MINE, ask=gone)) == "unknown", "its file is gone"
    assert law_version(replace(MINE, ask="".join)) == "unknown", "it is of no module"


def test_a_law_without_functions_is_the_robot_s_spring():
    settings, own = VerticalSettings(stiffness=200.0), Own()
    step, memory = enveloped(MINE), initial_state(settings, MINE, own)
    inp = VerticalInput(100, 0.10, 0.0, 0.0, 0.13, 0.0, True)
    for _ in range(3000):
        output = step(settings, own, memory, inp, 1e-3)
    assert output.force == pytest.approx(200.0 * 0.03 + settings.gravity)
    assert math.isclose(output.impedance, 6.0, rel_tol=1e-6)


def misspells(own, m, sample, motion):
    """Ask for what no field of the motion is."""
    return pulls(motion.position)


def fails(own, *told):
    """Make nothing."""
    raise ArithmeticError("no such number")


def exits(own, *told):
    """End the process."""
    sys.exit(3)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"ask": misspells}, r"its ask fails: AttributeError: .*'position' \(test_loading_laws.py"),
        ({"ask": lambda own, m, sample: pulls(0.0)}, "its ask fails: TypeError: .* arguments"),
        ({"ask": lambda own, m, sample, motion: 3.0},
         r"its ask answers 3.0: return pulls\(force\)"),
        ({"help": lambda own, m, sample, motion, pressed: pressed},
         r"its help answers 0.0: return feeds\(force, pressed\)"),
        ({"foresee": lambda own, m, sample: None}, "its foresee answers None: a number of N"),
        ({"rest": fails}, "its rest fails: ArithmeticError: no such number"),
        ({"memory": fails}, "its memory fails: ArithmeticError: no such number"),
        ({"own": fails}, "its own fails: ArithmeticError: no such number"),
        ({"ask": exits}, "its ask fails: SystemExit: 3"),
        ({"foresee": lambda own, m, sample: 10**400}, "OverflowError: int too large"),
        ({"memory": lambda own: Seen(), "shown": ("depth",)},
         "it shows depth, which its memory has not"),
    ],
)  # fmt: skip
def test_a_function_that_fails_when_it_is_called_once_is_told_at_the_start(
    monkeypatch, change, said
):
    monkeypatch.setitem(globals(), "CALLED", replace(MINE, **change))
    with pytest.raises(SettingError, match=said):
        laws.load(path("CALLED"))


def test_each_mode_is_called_and_leaves_no_memory_to_the_next(monkeypatch):
    """Of two modes, at the default settings, from a memory of its own."""
    seen = []

    def ask(own, m, sample, motion):
        seen.append((sample.mode, own.gain, m.seen))
        m.seen = 1.0
        return pulls(0.0)

    both = {mode: Variant(f"CALLED_{mode}", ("gain",)) for mode in (100, 101)}
    law = replace(MINE, variants=both, memory=lambda own: Seen(), ask=ask, shown=("seen",))
    monkeypatch.setitem(globals(), "CALLED", law)
    assert laws.load(path("CALLED")) is law
    assert seen == [(100, 1.0, 0.0), (101, 1.0, 0.0)]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"needs": lambda own, m, sample, stiffness: (1.0, 1.0)}, "its needs answers .* Needs"),
        ({"ask": misspells}, r"its ask fails: AttributeError: .* \(test_loading_laws.py, line"),
        ({"ask": lambda own, m, sample, motion: 3.0}, "its ask answers 3.0: two numbers of N"),
        ({"help": lambda own, m, sample, motion, pressed: pressed}, "its help fails: TypeError"),
        ({"help": exits}, "its help fails: SystemExit: 3"),
        ({"ask": lambda *told: (0.0, 10**400)}, "OverflowError: int too large"),
        ({"help": lambda *told: (0.0, None)}, r"its help answers \(0.0, None\): two numbers"),
        ({"rest": fails}, "its rest fails: ArithmeticError: no such number"),
        ({"shown": ("depth",)}, "it shows depth, which its memory has not"),
    ],
)
def test_functions_of_a_law_of_the_plane_are_called_once_too(monkeypatch, change, said):
    monkeypatch.setitem(globals(), "CALLED", replace(PLANE, **change))
    with pytest.raises(SettingError, match=said):
        plane.load(path("CALLED"))


def test_a_law_of_the_plane_whose_functions_answer_is_taken():
    assert plane.load(path("PLANE")) is PLANE
