# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import sys
from pathlib import Path

import pytest

import packages
import steps

LISTING = """\
:env:.find-links='/one /two'
global.extra-index-url='\\nhttps://user:word@a.invalid/simple\\nhttps://b.invalid/simple'
global.index-url='https://c.invalid/simple'
global.timeout='15'
install.timeout='60'
freeze.timeout='1'
global.verbose='2'
"""


@pytest.fixture
def calls(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return the names of the installers that are run; uv fails."""
    seen: list[str] = []

    def run(name: str, *_: object) -> None:
        seen.append(name)
        if name == "uv":
            raise steps.StepFailed("uv failed")

    monkeypatch.setattr(packages, "run_logged", run)
    return seen


def test_uv_looks_where_pip_does() -> None:
    assert packages.uv_variables(LISTING) == {
        "UV_INDEX_STRATEGY": "unsafe-best-match",
        "UV_DEFAULT_INDEX": "https://c.invalid/simple",
        "UV_INDEX": "https://user:word@a.invalid/simple https://b.invalid/simple",
        "UV_FIND_LINKS": "/one,/two",
        "UV_HTTP_TIMEOUT": "60",
    }


def test_pips_settings_are_read(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PIP_FIND_LINKS", "/wheels")
    found = packages.uv_variables(packages.pip_settings(Path(sys.executable)))
    assert found["UV_FIND_LINKS"] == "/wheels"


def test_where_uv_fails_pip_installs(calls: list[str], tmp_path: Path) -> None:
    packages.install(Path(sys.executable), [], tmp_path / "log", steps.Silence())
    assert calls == ["uv", "pip"]


def test_without_uv_pip_installs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(packages, "pip", lambda _: ["true"])
    log, python = tmp_path / "log", tmp_path / "python"
    python.symlink_to(sys.executable)
    packages.get_uv(python, [], log, steps.Silence())
    packages.install(python, [], log, steps.Silence())
    assert "true --no-compile" in log.read_text()


def test_modules_are_compiled_but_not_their_tests(tmp_path: Path) -> None:
    modules = tmp_path / "tests/site-packages"
    (modules / "one/tests").mkdir(parents=True)
    (modules / "one/good.py").write_text("x = 1")
    (modules / "one/bad.py").write_text("x =")
    (modules / "one/tests/test_one.py").write_text("x = 1")
    python = Path(sys.executable)
    packages.compile_bytecode(python, modules, tmp_path / "log", steps.Silence())
    compiled = [file.name.split(".")[0] for file in modules.rglob("*.pyc")]
    assert compiled == ["good"]
