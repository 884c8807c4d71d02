# SPDX-License-Identifier: Apache-2.0
"""Access control of the bridge: by name of the host, origin of the page, and token.

The check of the name (Host) excludes pages whose own name resolves to this machine (DNS rebinding).
The check of the Origin excludes all other pages in a browser of this machine. The token excludes
everybody else.
"""

from __future__ import annotations

import ipaddress
import secrets
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple
from urllib.parse import urlsplit

_PORTS = {"http": 80, "https": 443}
_EVERYWHERE = ("0.0.0.0", "::", "")


class Refused(PermissionError):
    """Access is refused; the message says why."""


class Door(NamedTuple):
    """Checks name, origin and token of a request.

    names: allowed names of the bridge, without port. port: that it listens on. scheme: http or
    https. origins: of other pages that may connect, like `https://games.example`, or `null` for
    pages opened from a file. tokens: returns those of now, by whom they belong to; raises OSError.
    """

    names: tuple[str, ...]
    port: int
    scheme: str
    origins: tuple[str, ...]
    tokens: Callable[[], Mapping[str, str]]

    def check_host(self, host: str | None) -> None:
        """Raise Refused unless the request uses one of the bridge's names."""
        if _split(f"{self.scheme}://{host or ''}") not in self._own():
            raise Refused(
                "the bridge does not know itself by that name: open it by the address that it "
                "printed, or add the name to its parameter hosts"
            )

    def check_origin(self, origin: str | None) -> None:
        """Raise Refused for a page from another origin; only browsers send an origin."""
        if origin is None or origin in self.origins or _split(origin) in self._own():
            return
        raise Refused(
            "pages from there may not connect: add their origin to the bridge's parameter origins"
        )

    def whose(self, token: str | None) -> str:
        """Return whose token it is. Raises Refused for a missing or wrong one, OSError."""
        given = (token or "").encode(errors="backslashreplace")  # a header may hold any bytes
        for who, right in self.tokens().items():
            if secrets.compare_digest(given, right.encode()):
                return who
        what = "wrong token" if token else "no token"
        raise Refused(f"{what}: open the address that the bridge printed, which carries one")

    def _own(self) -> list[tuple]:
        return [(self.scheme, name.lower(), self.port) for name in self.names]


def _split(address: str) -> tuple | None:
    """Return scheme, host and port of an address, None if it is invalid or has other parts."""
    try:
        parts = urlsplit(address)
        port = parts.port or _PORTS.get(parts.scheme)
    except ValueError:
        return None
    if parts.path or parts.query or parts.fragment or "@" in parts.netloc:
        return None
    return parts.scheme, (parts.hostname or "").lower(), port


def is_loopback(address: str) -> bool:
    """Return whether only this machine can reach an address."""
    if address == "localhost":
        return True
    try:
        return ipaddress.ip_address(address).is_loopback
    except ValueError:
        return False


def names_of(address: str, hosts: Sequence[str]) -> tuple[str, ...]:
    """Return the allowed names of a bridge on an address."""
    own = () if address in _EVERYWHERE else (address,)
    return tuple(dict.fromkeys(("127.0.0.1", "localhost", "::1", *own, *filter(None, hosts))))


def token_in(query: Mapping[str, str], headers: Mapping[str, str]) -> str | None:
    """Return the token of a request: `Authorization: Bearer TOKEN`, or `?token=` for roslibjs."""
    scheme, _, token = headers.get("Authorization", "").partition(" ")
    if scheme.lower() == "bearer" and token:
        return token.strip()
    return query.get("token")
