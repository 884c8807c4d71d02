# SPDX-License-Identifier: Apache-2.0
"""Only regular files of a bounded size are read."""

from __future__ import annotations

import os

import pytest

from screw_module_ros.regular_file import NotRegular, read_regular


def test_a_file_up_to_the_limit_is_read(tmp_path):
    (tmp_path / "file").write_bytes(b"12345")
    assert read_regular(tmp_path / "file", 5) == b"12345"
    with pytest.raises(NotRegular, match="larger than 4 bytes"):
        read_regular(tmp_path / "file", 4)


@pytest.mark.timeout(10)
def test_what_is_no_file_is_neither_read_nor_waited_for(tmp_path):
    os.mkfifo(tmp_path / "fifo")
    (tmp_path / "link").symlink_to("/dev/zero")
    for path in (tmp_path / "fifo", tmp_path / "link", "/dev/zero", tmp_path):
        with pytest.raises(NotRegular, match="folder, FIFO or device"):
            read_regular(path, 100)


def test_a_file_that_says_it_is_empty_is_bounded_too():
    """The kernel's own files have no size."""
    with pytest.raises(NotRegular, match="larger than 10 bytes"):
        read_regular("/proc/self/maps", 10)


def test_nothing_there_is_an_error_of_the_system(tmp_path):
    with pytest.raises(FileNotFoundError):
        read_regular(tmp_path / "none", 1)
