# SPDX-License-Identifier: Apache-2.0
"""One word, one thing: what CONTRIBUTING says on names and comments holds in the package."""

import ast
import re
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parent.parent / "screw_module_ros"
SOURCES = sorted(PACKAGE.rglob("*.py"))

#: A comment that begins so goes on with the name before it, and is read twice.
PREPOSITIONS = (
    "about above after against and as at because before below beside between beyond but by during "
    "for from if in into of on or over per since so than that through till to toward towards under "
    "until up when where which while with within without"
).split()

#: Words with one meaning each, and the meanings that had them too.
GONE = {
    r"\b\w*Bench\b": "an experiment has a Stand; bench is the speed of the simulation",
    r"\bGUARDS = \(": "the permit has CONDITIONS; a guard is a drive's own",
    r"^class Guard\b": "the force gains have a GainGuard",
    r"\bself\.make\b": "a driver has a profile",
    r"\btold_limit\b": "what the drive was told is its drive_limit",
    r"\b_IDLE_S\b": "a node that is not active looks every _POLL_S",
}

#: Acts that return why they were refused are called by what they do.
ACTS = {
    "enable", "disable", "home", "tare", "clear_fault", "write", "apply_enable", "apply_clear",
    "_start", "_changed", "_substituted",
}  # fmt: skip


def _constants(text: str) -> list[tuple[str, str]]:
    found = re.findall(r"(?m)^\s*([A-Z_][A-Z0-9_]*)(?:: [^=\n]+)? = .*?  # (.*)$", text)
    return [(name, comment) for name, comment in found if comment not in ("fmt: skip",)]


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_the_comment_of_a_constant_is_a_whole_phrase(path):
    for name, comment in _constants(path.read_text()):
        assert comment.split()[0] not in PREPOSITIONS, f"{name}: {comment}"


def test_words_that_meant_two_things_are_gone():
    for path in SOURCES:
        for pattern, instead in GONE.items():
            assert not re.search(pattern, path.read_text(), re.MULTILINE), f"{path}: {instead}"


def _sentences(path: Path) -> list[str]:
    """Return the functions whose text is a sentence, empty if all is well."""
    return [
        each.name
        for each in ast.walk(ast.parse(path.read_text()))
        if isinstance(each, ast.FunctionDef)
        and isinstance(each.returns, ast.Name)
        and each.returns.id == "str"
        and re.match(r"(Return w|W)hy .*empty (if|when)", ast.get_docstring(each) or "")
    ]


def test_a_sentence_that_is_empty_if_all_is_well_is_a_flaw_a_refusal_or_a_fault():
    seen = []
    for path in SOURCES:
        for name in _sentences(path):
            seen.append(name)
            ending = re.search(r"(^|_)(flaw|refusal|fault|reason)$", name)
            assert ending or name in ACTS, f"{path}: {name}"
    assert len(seen) > 15, "the docstrings say it in other words now"
