# SPDX-License-Identifier: Apache-2.0
"""After its first message, a therapist's page must keep publishing its attendance."""

from __future__ import annotations

from screw_module_ros.therapy.attendance import Attendance, AttendanceSettings

MS = 1_000_000


def test_without_any_page_a_session_may_go_on():
    assert Attendance().pause_reason(10**15) == ""


def test_a_page_that_is_silent_for_two_seconds_is_missed():
    attendance = Attendance()
    attendance.hear(1000 * MS)
    assert attendance.pause_reason(3000 * MS) == ""
    assert attendance.pause_reason(3001 * MS) == "the therapist's page has been silent for 2 s"
    attendance.hear(3500 * MS)
    assert attendance.pause_reason(4000 * MS) == ""


def test_a_start_forgets_the_page_of_the_session_before():
    attendance = Attendance(AttendanceSettings(0.5))
    attendance.hear(0)
    attendance.begin(False, 600 * MS)
    assert attendance.pause_reason(10**12) == ""


def test_a_page_that_starts_a_session_is_missed_though_it_was_never_heard():
    """It may be lost before its first word arrives: nobody would attend the session."""
    attendance = Attendance(AttendanceSettings(0.5))
    attendance.begin(True, 600 * MS)
    assert attendance.pause_reason(1100 * MS) == ""
    assert attendance.pause_reason(1101 * MS)


def test_an_attended_session_stays_so_when_it_goes_on():
    attendance = Attendance(AttendanceSettings(0.5))
    attendance.resume(0)
    assert attendance.pause_reason(10**12) == "", "nobody has ever attended it"
    attendance.hear(0)
    attendance.resume(5000 * MS)
    assert attendance.pause_reason(5500 * MS) == ""
    assert attendance.pause_reason(5501 * MS)
