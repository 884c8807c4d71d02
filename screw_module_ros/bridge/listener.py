# SPDX-License-Identifier: Apache-2.0
"""The bridge's socket: who makes no request in time, or is one too many, is closed.

Half a request, or half a TLS handshake, needs no token and would keep every page out once the
process has no handle left (1024 by default). asyncio and aiohttp have no limit for either.
"""

from __future__ import annotations

import asyncio
import socket
import ssl
from collections.abc import Callable

from aiohttp import web

from .settings import Listening

_OPENING_S = 10.0  # a page loads within it
_MOST_OPENING = 64  # connections that are no client's; beyond, the oldest is closed
_BACKLOG = 16
_AGAIN_S = 0.02


class Listener:
    """Accepts connections for aiohttp's `protocols`, from `start` to `close`.

    is_client: returns whether a connection is a client's, and so stays. log: takes a sentence.
    unfinished: number of the connections that were closed. Raises OSError, ssl.SSLError.
    """

    def __init__(
        self, listening: Listening, is_client: Callable[[asyncio.BaseTransport], bool],
        log: Callable[[str], None],
    ):  # fmt: skip
        self._is_client, self._log = is_client, log
        self._context: ssl.SSLContext | None = None
        if listening.certificate:
            self._context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
            self._context.load_cert_chain(listening.certificate, listening.key or None)
        place = listening.address or None, listening.port
        found = socket.getaddrinfo(*place, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
        family, *_, address = found[0]
        self._socket = socket.create_server(address[:2], family=family, backlog=_BACKLOG)
        self._socket.setblocking(False)
        self.port: int = self._socket.getsockname()[1]
        self.scheme = "https" if self._context else "http"
        self._opening: dict[asyncio.Task, None] = {}  # in the order in which they came
        self._closing = False
        self.unfinished = 0

    def start(self, protocols: web.Server) -> None:
        """Accept connections from now on."""
        self._accepting = asyncio.ensure_future(self._accept(protocols))

    async def close(self) -> None:
        """Accept no more connections, and close those that are no client's."""
        self._closing = True
        tasks = [self._accepting, *self._opening]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        self._socket.close()

    async def _accept(self, protocols: web.Server) -> None:
        loop = asyncio.get_running_loop()
        while True:
            try:
                accepted, _ = await loop.sock_accept(self._socket)
            except OSError:  # it has gone already, or there is no handle for it
                await asyncio.sleep(_AGAIN_S)
                continue
            opening = loop.create_task(self._open(accepted, protocols))
            self._opening[opening] = None
            opening.add_done_callback(lambda ended: self._opening.pop(ended, None))
            if len(self._opening) > _MOST_OPENING:
                oldest = next(iter(self._opening))
                del self._opening[oldest]  # now: it ends only after the next one has come
                oldest.cancel()
            await asyncio.sleep(0)  # others go on, also while many wait to be accepted

    async def _open(self, accepted: socket.socket, protocols: web.Server) -> None:
        """Serve a connection; close it unless it becomes a client's in time."""
        transport: asyncio.BaseTransport | None = None
        try:
            transport, _ = await asyncio.get_running_loop().connect_accepted_socket(
                protocols, accepted, ssl=self._context,
                ssl_handshake_timeout=_OPENING_S if self._context else None,
            )  # fmt: skip
            await asyncio.sleep(_OPENING_S)
        except OSError:  # no TLS, or it has gone: asyncio has closed it
            pass
        finally:
            # One that has had its answer is closing: the server keeps none alive after it.
            if transport is None or not (transport.is_closing() or self._is_client(transport)):
                self._count_unfinished()
                if isinstance(transport, asyncio.WriteTransport):
                    transport.abort()

    def _count_unfinished(self) -> None:
        self.unfinished += 1
        if self.unfinished == 1 and not self._closing:
            self._log(
                f"closed a connection that made no request within {_OPENING_S:g} s, or was in the "
                "way of newer ones; further ones are only counted, in the diagnostics"
            )
