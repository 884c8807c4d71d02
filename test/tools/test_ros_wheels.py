# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

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
