# SPDX-License-Identifier: Apache-2.0
"""What a machine that is not ours needs: a clear sentence, or a repair."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest

import parsed_idl
import prerequisites
import ros_wheels
import shebangs


@pytest.fixture
def prefix(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "share/rclpy").mkdir(parents=True)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    monkeypatch.setattr(prerequisites, "_works", lambda *_: True)
    return tmp_path


def test_a_sourced_jazzy_is_used(prefix: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DISTRO", "jazzy")
    assert prerequisites.ros_prefix() == prefix


def test_an_environment_with_wheels_is_no_ros(prefix: Path) -> None:
    (prefix / "pyvenv.cfg").touch()
    assert prerequisites.ros_prefix() is None


def test_another_distribution_is_refused(prefix: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DISTRO", "humble")
    with pytest.raises(prerequisites.Missing, match="humble"):
        prerequisites.ros_prefix()


def test_a_ros_of_another_python_is_refused(prefix: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DISTRO", "jazzy")
    monkeypatch.setattr(prerequisites, "_works", lambda *_: False)
    with pytest.raises(prerequisites.Missing, match="PYTHON="):
        prerequisites.ros_prefix()


def test_a_missing_compiler_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CXX", raising=False)
    monkeypatch.setattr(shutil, "which", lambda name: "/usr/bin/make" if name == "make" else None)
    with pytest.raises(prerequisites.Missing, match=r"^c\+\+ .* apt install g\+\+$"):
        prerequisites.check_compiler()


def test_a_machine_without_wheels_is_sent_to_a_ros(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(platform, "machine", lambda: "aarch64")
    with pytest.raises(prerequisites.Missing, match=r"aarch64.*source a ROS 2 Jazzy"):
        prerequisites.check_wheels_fit()


def test_a_full_disk_is_said_before_it_is_full(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usage = shutil.disk_usage(tmp_path)._replace(free=100_000_000)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage)
    with pytest.raises(prerequisites.Missing, match=r"0\.1 GB free"):
        prerequisites.check_disk(tmp_path)


@pytest.mark.parametrize("path", ["/home/a b/x", "/home/Zoë/ü", "/a/c++_d-e.f@1"])
def test_a_path_with_spaces_or_letters_of_any_language_is_fine(path: str) -> None:
    assert prerequisites.check_path(Path(path), ros=None) is None


@pytest.mark.parametrize("letter", [*":;,$(%='\"#\n", "\udcff", "\u00a0"])
def test_a_path_that_the_tools_do_not_take_is_refused_at_once(letter: str) -> None:
    with pytest.raises(prerequisites.Missing, match="move the checkout to a path without") as told:
        prerequisites.check_path(Path(f"/a{letter}b/c"), ros=None)
    assert str(told.value).isascii()
    assert "\n" not in str(told.value)


def test_a_sourced_ros_takes_only_ascii(prefix: Path) -> None:
    prerequisites.check_path(Path("/a b"), ros=prefix)
    with pytest.raises(prerequisites.Missing, match=r"\\xfc"):
        prerequisites.check_path(Path("/ü"), ros=prefix)


EXPORTED = (
    'INTERFACE_INCLUDE_DIRECTORIES "${_IMPORT_PREFIX}/include/std_msgs;'
    "/opt/python/cp312-cp312/include/python3.12;"
    '/opt/python/cp312-cp312/lib/python3.12/site-packages/numpy/_core/include"'
)


def test_the_builders_folders_become_the_local_ones() -> None:
    text = ros_wheels.with_local_paths(EXPORTED, r"/usr/include/python3.12", r"/venv/\1/numpy")
    assert text == (
        'INTERFACE_INCLUDE_DIRECTORIES "${_IMPORT_PREFIX}/include/std_msgs;'
        r'/usr/include/python3.12;/venv/\1/numpy"'
    )
    assert ros_wheels.with_local_paths(text, "/c", "/d") == text, "a second time"


def test_the_list_of_interface_files_is_read_as_utf_8() -> None:
    read = 'file(STRINGS "${idl_output}" idl_tuples)'
    mended = ros_wheels.with_local_paths(read, "/a", "/b")
    assert mended == 'file(STRINGS "${idl_output}" idl_tuples ENCODING UTF-8)'
    assert ros_wheels.with_local_paths(mended, "/a", "/b") == mended


def test_a_file_shared_with_the_installers_cache_is_not_written_to(tmp_path: Path) -> None:
    folder = tmp_path / "venv/share/std_msgs/cmake"
    folder.mkdir(parents=True)
    cached = tmp_path / "cached.cmake"
    cached.write_text(EXPORTED)
    (folder / "export.cmake").hardlink_to(cached)
    assert ros_wheels.rewrite_cmake_files(tmp_path / "venv") == 1
    assert cached.read_text() == EXPORTED
    assert "/opt/python" not in (folder / "export.cmake").read_text()


CODE = "import sys\nprint(sys.executable, sys.argv[1:])\n"


def test_the_parser_of_interface_files_is_told_once_to_keep_what_it_has_parsed(
    tmp_path: Path,
) -> None:
    parser = tmp_path / "rosidl_parser/parser.py"
    parser.parent.mkdir()
    (parser.parent / "__init__.py").touch()
    parser.write_text("def parse_idl_file(locator):\n    return locator.upper()\n")
    for _ in range(2):
        ros_wheels.parse_once(tmp_path)
    assert parser.read_text().count("parse_idl_file = ") == 1
    command = "from rosidl_parser.parser import parse_idl_file; print(parse_idl_file('a'))"
    assert python("-c", command, PYTHONPATH=str(tmp_path)) == "A\n"


class Located(NamedTuple):
    """What names an interface file to the parser."""

    path: Path

    def get_absolute_path(self) -> Path:
        """Return the path."""
        return self.path


@pytest.fixture
def parses(tmp_path: Path) -> tuple[Callable[[], str], Path, list[str]]:
    """Return what parses a file as each generator does, the file, and what was parsed."""
    file, parsed = tmp_path / "A.idl", []

    def parse(locator: Located) -> str:
        parsed.append(locator.path.read_text())
        return parsed[-1].upper()

    file.write_text("one")
    return lambda: parsed_idl.parsed_once(parse)(Located(file)), file, parsed


def test_what_one_generator_has_parsed_no_other_parses(
    parses: tuple, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    parse, file, parsed = parses
    monkeypatch.setenv(parsed_idl.FOLDER, str(tmp_path))
    assert [parse(), parse()] == ["ONE", "ONE"]
    file.write_text("another")
    assert [parse(), parse()] == ["ANOTHER", "ANOTHER"]
    assert parsed == ["one", "another"]


def test_without_a_folder_each_generator_parses(parses: tuple) -> None:
    parse, _, parsed = parses
    assert [parse(), parse()] == ["ONE", "ONE"]
    assert parsed == ["one", "one"]


@pytest.fixture(params=["a b", "x ü", "n" * 140])
def odd_python(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """Return a Python whose path is no fit first line."""
    folder = tmp_path / request.param
    folder.mkdir()
    (folder / "python").symlink_to(sys.executable)
    return folder / "python"


@pytest.mark.parametrize("first", ["#!{}", '#!"{}"', '#!"{}" -x'])
def test_an_executable_starts_in_any_folder(odd_python: Path, first: str) -> None:
    node = odd_python.parent / "node"
    node.write_text(f"{first.format(odd_python)}\n{CODE}")
    node.chmod(0o755)
    assert shebangs.repair(odd_python.parent, odd_python) == 1
    run = subprocess.run([node, "a b", "*"], capture_output=True, text=True, check=True)
    assert run.stdout == f"{odd_python} ['a b', '*']\n"


LIBRARIES, PREFIXES, WHEELS_DONE = (
    "LD_LIBRARY_PATH",
    "AMENT_PREFIX_PATH",
    "_ROS_WHEELS_BOOTSTRAP_COMPLETE",
)
# Creating a publisher loads the middleware's support of the message, a library found by name.
PUBLISHER = """
import rclpy
from screw_module_msgs.msg import SimTruth
rclpy.init()
node = rclpy.create_node("probe")
node.create_publisher(SimTruth, "truth", 1)
print(node.get_name())
node.destroy_node()
rclpy.shutdown()
"""
with_wheels = pytest.mark.skipif(
    not Path(sys.prefix, "share/rclpy").is_dir(), reason="a sourced ROS is in use"
)


def python(*arguments: str, **changes: str | None) -> str:
    env = {**os.environ, **changes}
    given = {name: value for name, value in env.items() if value is not None}
    command = [sys.executable, *arguments]
    return subprocess.run(command, env=given, capture_output=True, text=True, check=True).stdout


@with_wheels
@pytest.mark.parametrize("done", [None, "1"])
def test_ros_and_messages_are_found_whatever_was_inherited(done: str | None) -> None:
    left = {"LD_LIBRARY_PATH": None, "AMENT_PREFIX_PATH": None, WHEELS_DONE: done}
    assert python("-c", PUBLISHER, **left) == "probe\n"


@with_wheels
def test_what_was_set_is_kept_behind() -> None:
    code = f"import os; print(os.environ['{LIBRARIES}'], os.environ['{PREFIXES}'], sep='|')"
    printed = python("-c", code, LD_LIBRARY_PATH="/mine", AMENT_PREFIX_PATH="/theirs")
    libraries, prefixes = printed.rstrip().split("|")
    assert libraries.split(":")[-1] == "/mine"
    assert f"{sys.prefix}/lib" in libraries.split(":")
    assert prefixes.split(":")[-2:] == [sys.prefix, "/theirs"]


def test_arguments_and_input_survive_the_restart() -> None:
    code = "import sys; print(sys.argv[1:], sys.flags.optimize, sys.executable)"
    printed = python("-O", "-c", code, "a b", "*", LD_LIBRARY_PATH=None)
    assert printed == f"['a b', '*'] 1 {sys.executable}\n"


def test_colcons_setup_scripts_see_what_they_were_given(tmp_path: Path) -> None:
    script = tmp_path / "_local_setup_util_sh.py"
    script.write_text("import os; print(os.environ.get('AMENT_PREFIX_PATH'))")
    assert python(str(script), AMENT_PREFIX_PATH=None, **{WHEELS_DONE: "1"}) == "None\n"
