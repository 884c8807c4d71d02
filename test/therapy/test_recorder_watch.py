# SPDX-License-Identifier: Apache-2.0
"""The watch reports and latches the end of a recording and a silent recorder."""

from screw_module_ros.therapy.recorder_watch import RecorderWatch, RecorderWatchSettings

S = 1_000_000_000


def watching():
    watch = RecorderWatch(RecorderWatchSettings(timeout=5.0))
    watch.hear(False, "not recording", 9 * S)  # what was before does not count
    watch.begin(10 * S)
    return watch


def test_it_lasts_as_long_as_the_recorder_reports_it():
    watch = watching()
    for second in range(11, 60):
        watch.hear(True, "all is well", second * S)
        assert watch.lost(second * S + S) == ""


def test_the_recorders_own_end_is_noticed_at_once_and_for_good():
    watch = watching()
    watch.hear(False, "the disk is full", 12 * S)
    assert watch.lost(12 * S) == "the recording has ended: the disk is full"
    watch.hear(True, "all is well", 13 * S)  # another recording
    assert watch.lost(13 * S) == "the recording has ended: the disk is full"


def test_silence_is_noticed():
    watch = watching()
    assert watch.lost(15 * S) == ""
    assert watch.lost(15 * S + 1) == "the session recorder has been silent for 5 s"


def test_a_new_recording_begins_anew():
    watch = watching()
    watch.hear(False, "", 11 * S)
    watch.begin(20 * S)
    assert watch.lost(21 * S) == ""
