# SPDX-License-Identifier: Apache-2.0
"""A node's entry on /diagnostics: level, message and named values."""

from __future__ import annotations

from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


class Health(NamedTuple):
    """One diagnostics entry: level, message and named values."""

    level: bytes
    message: str
    values: dict


def status_message(health: Health, node: str, hardware_id: str) -> DiagnosticStatus:
    """Return the entry as a message; node: its full name."""
    return DiagnosticStatus(
        level=health.level,
        name=node.lstrip("/"),
        message=health.message,
        hardware_id=hardware_id,
        values=[KeyValue(key=key, value=str(value)) for key, value in health.values.items()],
    )
