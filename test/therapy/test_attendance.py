# SPDX-License-Identifier: Apache-2.0
"""After its first message, a therapist's page must keep publishing its attendance."""

from __future__ import annotations

from screw_module_ros.therapy.attendance import Attendance, AttendanceSettings

MS = 1_000_000


def test_without_any_page_a_session_may_go_on():
    assert Attendance().missed(10**15) == ""


def test_a_page_that_is_silent_for_two_seconds_is_missed():
    attendance = Attendance()
    attendance.hear(1000 * MS)
    assert attendance.missed(3000 * MS) == ""
    assert attendance.missed(3001 * MS) == "the therapist's page has been silent for 2 s"
    attendance.hear(3500 * MS)
    assert attendance.missed(4000 * MS) == ""


def test_who_begins_without_the_page_is_not_held_up_by_it():
    attendance = Attendance(AttendanceSettings(0.5))
    attendance.hear(0)
    attendance.begin(600 * MS)
    assert attendance.missed(10**12) == ""


def test_beginning_does_not_forget_a_page_that_is_there():
    attendance = Attendance(AttendanceSettings(0.5))
    attendance.hear(0)
    attendance.begin(400 * MS)
    assert attendance.missed(600 * MS)
