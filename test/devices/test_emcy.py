# SPDX-License-Identifier: Apache-2.0
"""Emergencies decoded by name."""

from __future__ import annotations

import pytest

from screw_module_ros.devices import emcy


def test_layout_by_hand():
    found = emcy.decode(bytes.fromhex("30 81 11 DE AD 00 00 01"))
    assert found == (0x8130, 0x11, b"\xde\xad\x00\x00\x01")
    assert found.text == (
        "0x8130 life guard or heartbeat error; register: generic, communication; "
        "vendor data de ad 00 00 01"
    )


@pytest.mark.parametrize("data", ["", "00", "30 81 11 00 00 00 00"])
def test_wrong_length_is_none(data):
    assert emcy.decode(bytes.fromhex(data)) is None


@pytest.mark.parametrize(
    ("code", "name"),
    [
        (0x0000, "error reset or no error"),
        (0x1000, "generic error"),
        (0x2310, "continuous overcurrent, motor side"),
        (0x2312, "continuous overcurrent, motor side"),
        (0x3220, "DC link undervoltage"),
        (0x4310, "excess temperature, drive"),
        (0x7305, "incremental sensor 1 fault"),
        (0x73FF, "sensor"),
        (0x8250, "RPDO timeout"),
        (0x8611, "following error"),
        (0x8FFF, "monitoring"),
        (0xFF42, "device specific"),
        (0x0100, "unknown error"),
        (0xE000, "unknown error"),
    ],
)
def test_names(code, name):
    assert emcy.code_name(code) == name


def test_every_code_has_a_name():
    assert all(emcy.code_name(code) for code in range(0x10000))


def test_reset():
    assert emcy.decode(bytes(8)).is_reset
    assert not emcy.decode(bytes.fromhex("00 10 01 00 00 00 00 00")).is_reset
