# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from pathlib import Path

import ros_wheels

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


def test_a_second_time_changes_nothing() -> None:
    once = ros_wheels.with_local_paths(EXPORTED, "/a", "/b")
    assert ros_wheels.with_local_paths(once, "/c", "/d") == once


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
