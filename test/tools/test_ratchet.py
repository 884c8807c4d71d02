# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from collections import Counter

import ratchet


def test_statements_count_and_docstrings_do_not(tmp_path):
    (tmp_path / "loop").mkdir()
    (tmp_path / "loop" / "one.py").write_text(
        '"""Text."""\n\n\ndef f():\n    """Text."""\n    a = 1; b = 2\n    return a + b\n'
    )
    (tmp_path / "top.py").write_text("import math\n# a comment\n")
    assert ratchet.weights(tmp_path) == {"loop": 4, ".": 1}


def test_a_heavier_room_and_a_new_one_are_named():
    limits = ratchet.allowed("# rooms\nloop 10\n. 3\n")
    assert ratchet.too_heavy(Counter({"loop": 10, ".": 2}), limits) == []
    found = ratchet.too_heavy(Counter({"loop": 11, "annex": 1}), limits)
    assert [sentence.split()[0] for sentence in found] == ["annex", "loop"]
    assert "loop weighs 11 statements, 10 are allowed" in found[1]
