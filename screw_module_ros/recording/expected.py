# SPDX-License-Identifier: Apache-2.0
"""Expected content of a bag, from the table of the graph and the parameters stored in the bag.

A stride estimated from the data hides a regular loss: without every second sample a topic looks
like one of half the rate. So the topics that follow a node's ticks (`clock` in `graph.Topic`) are
compared with their known stride and rate.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from typing import Any

from ..graph import ENCODER_DECIMATED, THERAPY_STATE, TOPICS
from .audit import NO_SEQUENCE, layout
from .metadata import decoded

_LEAST_S = 1.0  # a shorter recording does not determine a rate
_DECIMATED = "/" + ENCODER_DECIMATED.rpartition("/")[2]  # end of the names of thinned topics
_FASTEST_HZ = 1e9  # larger rates are invalid
_TOLERANCE = 0.05  # of the rate; ticks are exact, the ends of the recording are not

Parameters = Mapping[str, str]  # per node, its parameters as JSON


TICKED = {topic.type: topic for topic in TOPICS.values() if topic.clock}
"""Topics whose messages follow ticks, by type, as names can be remapped."""


_HEARD = (TOPICS[THERAPY_STATE].type,)
"""Types with the tick number of what their node has heard: it repeats and skips without a loss."""


def layout_of(type_name: str, definition: str) -> int:
    """Return where messages of a type have the number that counts them, as `audit.layout`."""
    return NO_SEQUENCE if type_name in _HEARD else layout(definition)


def stride_of(name: str, type_name: str, parameters: Parameters | None = None) -> int:
    """Return the ticks from one message of a topic to the next, 0 if unknown.

    parameters: those stored in the bag; a type whose stride is a parameter needs them.
    """
    ticked = TICKED.get(type_name)
    if ticked is None or name.endswith(_DECIMATED):  # of the same type, at a rate of its own
        return 0
    if isinstance(ticked.every, int):
        return ticked.every
    every = _values(parameters or {}, ticked.clock).get(ticked.every)
    return every if isinstance(every, int) and every > 0 else 0


def wrong_rate(type_name: str, ticks: int, duration: float, parameters: Parameters) -> str:
    """Return the difference of the tick rate from the node's parameter, empty if they agree.

    ticks: from the first message to the last. duration: between their stamps [s].
    """
    ticked = TICKED.get(type_name)
    if ticked is None or duration < _LEAST_S:
        return ""
    rate = _values(parameters, ticked.clock).get("rate")
    if not isinstance(rate, int | float) or not 0.0 < rate < _FASTEST_HZ:
        return ""
    if abs(ticks / duration - rate) <= _TOLERANCE * rate:
        return ""
    return (
        f"its sequence rises by {ticks / duration:.0f} in a second, "
        f"the rate of {ticked.clock} is {rate:g} Hz"
    )


def absent(types: Collection[str], parameters: Parameters) -> Iterator[str]:
    """Yield a sentence for each node with parameters in the bag, but without its topic."""
    for type_name, ticked in TICKED.items():
        nodes = [name for name in parameters if name.rpartition("/")[2] == ticked.publisher]
        if nodes and type_name not in types:
            yield f"{nodes[0]} was there, but no topic of type {type_name} is in the bag"


def _values(parameters: Parameters, node: str) -> dict[str, Any]:
    """Return the parameters of the only node of this name in any namespace, else none."""
    found = [text for name, text in parameters.items() if name.rpartition("/")[2] == node]
    if len(found) != 1:
        return {}
    return decoded(found[0])
