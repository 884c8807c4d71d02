# SPDX-License-Identifier: Apache-2.0
"""Scores of a patient: no writer takes another one's away."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

from screw_module_ros.therapy.scores import Score, keep_scores, scores_in

AT = "2026-03-03T13:05:00+01:00"


def test_who_adds_scores_at_once_loses_none(tmp_path):
    """A session keeps what the patient tells while the therapist's page keeps a score."""
    given = [Score(AT, "FM_UE", float(number)) for number in range(60)]
    with ThreadPoolExecutor(6) as pool:
        list(pool.map(lambda score: keep_scores(tmp_path, "P-7K3QX", [score]), given))
    assert set(scores_in(tmp_path / "P-7K3QX_scores.json")) == set(given)
