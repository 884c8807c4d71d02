# SPDX-License-Identifier: Apache-2.0
"""The file in which the supervisor keeps what was stopped: whatever is in it, no stop is lost."""

from __future__ import annotations

import json
import os
import random
from collections import Counter
from pathlib import Path

from file_damage import BYTES
from runner import sentence

from screw_module_ros.files import STATE_VARIABLE
from screw_module_ros.nodes.support.place import SavedState
from screw_module_ros.safety import supervision
from screw_module_ros.safety.supervision import SupervisorState

_ODD = (
    "null", "[]", "{}", "0", "1e999", "NaN", '"x"', "true", " " * 70_000,
    '{"estopped": 1, "locked": false, "latched": []}', '{"estopped": null}', "\ufeff{}", "\x00",
    '{"estopped": false, "locked": false, "latched": [1]}', "9" * 5000,
)  # fmt: skip


class KeptState:
    """One case: a file as the supervisor left it, damaged, and read by the next supervisor."""

    def __init__(self, folder: Path):
        self.counts: Counter[str] = Counter()
        self._before = os.environ.get(STATE_VARIABLE)
        os.environ[STATE_VARIABLE] = str(folder)

    def close(self) -> None:
        """Give the environment back."""
        os.environ.pop(STATE_VARIABLE)
        if self._before is not None:
            os.environ[STATE_VARIABLE] = self._before

    def case(self, rng: random.Random) -> None:
        """Damage the memory of a stop, a lock or both, and start from it."""
        left = SupervisorState(
            latched=tuple(rng.sample(("amplifier: fault", "encoder: ü\n"), rng.randrange(3))),
            estopped=rng.random() < 0.5, locked=rng.random() < 0.5,
        )  # fmt: skip
        if not (left.latched or left.estopped or left.locked):
            left = left._replace(estopped=True)
        kept = SavedState("/supervisor")
        kept.write(supervision.kept(left))
        whole = kept.path.read_bytes()
        if rng.random() < 0.2:
            content = rng.choice(_ODD).encode()
        else:
            content = rng.choice(BYTES)(rng, whole)
        kept.path.write_bytes(content)
        try:
            found = supervision.restored(SavedState("/supervisor").read())
        except (OSError, ValueError) as error:  # what the node takes for an emergency stop
            sentence(error)
            self.counts["unreadable: stopped"] += 1
            return
        self.counts["the same" if content == whole else "readable"] += 1
        said = supervision.kept(found)
        assert said, f"nothing is stopped after {content[:80]!r}"
        # A text may be another one; that there was a stop or a lock may not go.
        assert found.estopped == left.estopped and found.locked == left.locked, json.dumps(said)
        assert bool(found.latched) == bool(left.latched)
