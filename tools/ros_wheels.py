# SPDX-License-Identifier: Apache-2.0
"""Makes the ROS wheels usable for building: their CMake files name folders of the wheels' builder.

The exported targets of the message packages carry the include folders of the Python and the numpy
they were compiled with (`/opt/python/cp3XX-cp3XX/...`); CMake refuses a target whose include folder
does not exist. They are rewritten to the folders of the virtual environment in use. And CMake reads
the list of interface files as ASCII, which ends a path at its first other letter: it is told UTF-8.
The generators share what one of them has parsed (`parsed_idl.py`).
"""

from __future__ import annotations

import re
import shutil
import sysconfig
from pathlib import Path

_BUILDER = r"/opt/python/cp3\d+-cp3\d+"
_NUMPY_INCLUDE = re.compile(_BUILDER + r"/lib/python3\.\d+/site-packages/numpy/_?core/include")
_PYTHON_INCLUDE = re.compile(_BUILDER + r"/include/python3\.\d+")
_LIST_OF_FILES = 'file(STRINGS "${idl_output}" idl_tuples'  # of rosidl_adapter

_PARSED = "_screw_module_ros_parsed_idl"
_ONCE = f"""

from {_PARSED} import parsed_once

parse_idl_file = parsed_once(parse_idl_file)
"""


def with_local_paths(text: str, python_include: str, numpy_include: str) -> str:
    """Return the text of a CMake file with the builder's folders replaced, fit for any path."""
    text = _NUMPY_INCLUDE.sub(lambda _: numpy_include, text)
    text = _PYTHON_INCLUDE.sub(lambda _: python_include, text)
    return text.replace(f"{_LIST_OF_FILES})", f"{_LIST_OF_FILES} ENCODING UTF-8)")


def rewrite_cmake_files(venv: Path) -> int:
    """Rewrite every CMake file under the environment's `share`; return how many changed."""
    python_include = sysconfig.get_path("include")
    version = sysconfig.get_python_version()
    numpy_include = str(venv / f"lib/python{version}/site-packages/numpy/_core/include")
    changed = 0
    for file in (venv / "share").glob("*/cmake/*.cmake"):
        old = file.read_text(encoding="utf-8", errors="surrogateescape")
        new = with_local_paths(old, python_include, numpy_include)
        if new != old:
            _replace(file, new)
            changed += 1
    return changed


def parse_once(site_packages: Path) -> None:
    """Let the parser of interface files keep what it has parsed, where it is given a folder."""
    shutil.copy(Path(__file__).with_name("parsed_idl.py"), site_packages / f"{_PARSED}.py")
    parser = site_packages / "rosidl_parser/parser.py"
    if not (text := parser.read_text(encoding="utf-8")).endswith(_ONCE):
        _replace(parser, text + _ONCE)


def _replace(file: Path, text: str) -> None:
    # A new file in its place: the old one may be a link to the installer's cache.
    draft = file.with_suffix(".new")
    draft.write_text(text, encoding="utf-8", errors="surrogateescape")
    draft.replace(file)
