# SPDX-License-Identifier: Apache-2.0
"""What a device says of its objects, by PDO or when asked (CiA 301), each value with its age.

A check that relies on such a value asks for its age too: a device that fell silent about it, or
never spoke, has not said that all is well.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

from .errors import BusError, NotAnswering, Refused
from .sdo import Sdo


class Reported:
    """The newest values of objects; each is unknown until it is heard.

    objects: their indexes, in the order in which they are asked for. signed: those of them with a
    sign. Values may come from several threads.
    """

    def __init__(self, objects: Collection[int], signed: Collection[int] = ()):
        self._objects, self._signed = tuple(objects), frozenset(signed)
        self.restart(0)

    def restart(self, now_ns: int) -> None:
        """Forget all values, and which objects are absent; ages count from now_ns [ns]."""
        self._begun_ns = now_ns
        self._heard: dict[int, tuple[int | None, int]] = {}
        self._absent: set[int] = set()

    def note(self, values: Mapping[int, int], now_ns: int) -> None:
        """Take over values that came at now_ns [ns]: index -> value."""
        for index, value in values.items():
            self._heard[index] = value, now_ns

    def forget(self, index: int, now_ns: int) -> None:
        """Take an object for unknown, as if it was never heard; its age counts from now_ns [ns]."""
        self._heard[index] = None, now_ns

    def value(self, index: int) -> int | None:
        """Return the newest value of an object, None while it is unknown."""
        heard = self._heard.get(index)
        return None if heard is None else heard[0]

    def age_ns(self, index: int, now_ns: int) -> int:
        """Return for how long an object was not heard, since the restart if never [ns]."""
        heard = self._heard.get(index)
        return now_ns - (self._begun_ns if heard is None else heard[1])

    def has(self, index: int) -> bool:
        """Return whether the device may have the object: it has not said that it is absent."""
        return index not in self._absent

    def due(self, now_ns: int, older_ns: int) -> list[int]:
        """Return the objects to ask for: not heard for older_ns [ns], all for 0, and not absent."""
        return [
            index
            for index in self._objects
            if index not in self._absent and self.age_ns(index, now_ns) >= older_ns
        ]

    def ask(self, sdo: Sdo, now_ns: int, older_ns: int) -> bool:
        """Ask for each object that is due, see there; blocking, not for the loop.

        Returns whether the device answered. An object that it refuses for another reason than that
        it is absent stays as old as it is.
        """
        for index in self.due(now_ns, older_ns):
            try:
                read = sdo.signed if index in self._signed else sdo.unsigned
                self.note({index: read(index)}, now_ns)
            except Refused as error:
                if error.absent:
                    self._absent.add(index)
            except (NotAnswering, BusError):
                return False
        return True
