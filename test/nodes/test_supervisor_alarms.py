# SPDX-License-Identifier: Apache-2.0
"""A sensor with an error withholds the permission for as long as it has one; no graph."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from screw_module_msgs.msg import ForceSample

S = 1_000_000_000


@pytest.fixture
def supervisor(make_node):
    node = make_node("supervisor")
    yield node
    node.close()


def report(node, now_ns, **sample):
    """Return what the supervisor makes of a force sensor's sample that has just come."""
    newest = SimpleNamespace(message=ForceSample(**sample), arrival_ns=now_ns)
    return node._report("force_sensor", newest, now_ns)


def diagnose(node, level, message):
    status = DiagnosticStatus(name="force_sensor", level=level, message=message)
    node._note_diagnostics(DiagnosticArray(status=[status]))


def test_the_status_in_the_sample_decides_without_any_diagnostics(supervisor):
    assert not report(supervisor, S).error
    found = report(supervisor, S, status=1 << 4)
    assert found.error and found.reason == "force sensor: supply too high (status bit 4)"


def test_an_alarm_stands_until_the_node_says_otherwise(supervisor):
    """It expired after 3 s without diagnostics, while the faulty sensor went on sending."""
    diagnose(supervisor, DiagnosticStatus.ERROR, "the gauges have not changed for 0.5 s")
    for seconds in (1, 10, 1000):
        assert report(supervisor, seconds * S).reason == "the gauges have not changed for 0.5 s"
    diagnose(supervisor, DiagnosticStatus.OK, "sampling")
    assert not report(supervisor, 1001 * S).error
