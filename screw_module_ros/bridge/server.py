# SPDX-License-Identifier: Apache-2.0
"""The server: pages and websocket on one port, in its own thread, so that no other thread waits.

A client that does not read is disconnected after `patience`; until then it delays only itself. The
log never contains a token.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import ssl
import threading
from collections.abc import Callable
from typing import Any

from aiohttp import WSCloseCode, WSMessage, WSMsgType, web

from ..clock import Clock
from .client import Client, CutOff, Gateway
from .door import Door, Refused, names_of, token_in
from .pages import FOLDER, PAGES, SECURITY_HEADERS
from .rights import KEPT, THERAPIST, Denied, Rights
from .rosbridge import status
from .settings import Limits, Listening
from .tokens import Tokens

_HEARTBEAT_S = 10.0  # of the websocket: finds a client whose machine has gone
_BUFFER = 65536  # bytes on the way to a client, beside the kernel's
_END_S = 3.0
_FOR_THERAPISTS = 2  # places that other pages cannot take: a therapist can always stop the robot


class Connection:
    """A websocket with its client.

    sending_since_ns: start of the present transmission, None while the server sends nothing.
    """

    def __init__(self, socket: web.WebSocketResponse, transport: Any):
        self.socket, self.transport = socket, transport
        self.wake = asyncio.Event()
        self.sending_since_ns: int | None = None
        self.client: Client | None = None


class Server:
    """Serves until `close`. log: takes a sentence. config: content of /config.json."""

    def __init__(
        self,
        listening: Listening,
        limits: Limits,
        tokens: Tokens,
        rights: Rights,
        gateway: Gateway,
        clock: Clock,
        config: dict,
        log: Callable[[str], None] = lambda sentence: None,
    ):
        self.limits = limits
        self._listening, self._tokens, self._rights = listening, tokens, rights
        self._gateway, self._clock, self._config, self._log = gateway, clock, config, log
        self._connections: set[Connection] = set()
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, name="bridge", daemon=True)
        self._door: Door | None = None
        self._runner: web.AppRunner | None = None
        self.cut_off = self.refused = 0

    # From other threads --------------------------------------------------------------------

    def start(self) -> None:
        """Listen. Raises OSError or ssl.SSLError if that fails."""
        self._thread.start()
        future = asyncio.run_coroutine_threadsafe(self._listen(), self._loop)
        try:
            future.result()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close every connection, and the thread."""
        if self._loop.is_closed():
            return
        if self._thread.is_alive():
            future = asyncio.run_coroutine_threadsafe(self._end(), self._loop)
            with contextlib.suppress(TimeoutError, asyncio.TimeoutError):
                future.result(_END_S)
            self._loop.call_soon_threadsafe(self._loop.stop)
            self._thread.join(_END_S)
        if not self._thread.is_alive():
            self._loop.close()

    def look(self) -> None:
        """Send new messages and check times; call it regularly. Cheap without clients."""
        if self._connections and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._look)

    @property
    def address(self) -> str:
        """Address of the pages, like http://127.0.0.1:8090."""
        door, name = self._door, self._listening.address
        name = door.names[0] if name not in door.names else name
        return f"{door.scheme}://{f'[{name}]' if ':' in name else name}:{door.port}"

    @property
    def clients(self) -> int:
        """Number of connected clients."""
        return len(self._connections)

    # In the server's thread ----------------------------------------------------------------

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        self._loop.run_forever()

    async def _listen(self) -> None:
        listening = self._listening
        context = None
        if listening.certificate:
            context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
            context.load_cert_chain(listening.certificate, listening.key or None)
        app = web.Application(middlewares=[self._guard], client_max_size=self.limits.size)
        app.add_routes([web.get("/ws", self._websocket), web.get("/config.json", self._configured)])
        app.add_routes([web.get("/history.json", self._history)])
        app.add_routes([web.get(path, _page(name)) for path, name in PAGES.items()])
        app.router.add_static("/static/", FOLDER, follow_symlinks=False)
        app.on_response_prepare.append(_add_headers)
        self._runner = web.AppRunner(app, access_log=None, handle_signals=False)
        await self._runner.setup()
        site = web.TCPSite(
            self._runner, listening.address, listening.port, ssl_context=context, backlog=16
        )
        await site.start()
        port = self._runner.addresses[0][1]
        names = names_of(listening.address, listening.hosts)
        origins = tuple(filter(None, listening.origins))
        scheme = "https" if context else "http"
        self._door = Door(names, port, scheme, origins, self._tokens)

    async def _end(self) -> None:
        for connection in list(self._connections):
            with contextlib.suppress(ConnectionError):
                await asyncio.wait_for(
                    connection.socket.close(code=WSCloseCode.GOING_AWAY, message=b"bridge ends"),
                    timeout=0.5,
                )
            connection.transport.abort()
        if self._runner is not None:
            await self._runner.cleanup()

    @web.middleware
    async def _guard(self, request: web.Request, handler: Callable) -> web.StreamResponse:
        """Refuse requests with a foreign host name or from a foreign page."""
        try:
            self._door.check_host(request.headers.get("Host"))
            self._door.check_origin(request.headers.get("Origin"))
            return await handler(request)
        except Refused as error:
            self.refused += 1
            raise web.HTTPForbidden(text=f"{error}\n") from None

    async def _configured(self, request: web.Request) -> web.Response:
        """Return a page's role, robots and protocols; requires a token, like the websocket."""
        role = self._door.role_of(token_in(request.query, request.headers))
        config = {**self._config, "role": role, "wishes": self._rights.wishes or role != "patient"}
        return web.Response(text=json.dumps(config), content_type="application/json")

    async def _history(self, request: web.Request) -> web.Response:
        """Return earlier messages to a page: /history.json?topic=/therapy/trial."""
        role = self._door.role_of(token_in(request.query, request.headers))
        try:
            place, _ = self._rights.hears(role, request.query.get("topic", ""))
        except Denied as error:
            raise Refused(str(error)) from None
        texts = self._gateway.history(place.full) if place.name in KEPT else []
        return web.Response(text=f"[{','.join(texts)}]", content_type="application/json")

    async def _websocket(self, request: web.Request) -> web.StreamResponse:
        role = self._door.role_of(token_in(request.query, request.headers))
        if len(self._connections) >= self._room_for(role):
            raise web.HTTPServiceUnavailable(
                text=f"{self._room_for(role)} clients are connected, the most there may be for a "
                f"{role}'s page\n"
            )
        socket = web.WebSocketResponse(
            max_msg_size=self.limits.size, heartbeat=_HEARTBEAT_S, compress=False
        )
        connection = Connection(socket, request.transport)
        self._connections.add(connection)
        writer = None
        try:
            await socket.prepare(request)
            request.transport.set_write_buffer_limits(high=_BUFFER)
            connection.client = Client(
                role, self._rights, self._gateway, self.limits, self._clock.now_ns(),
                connection.wake.set, self._from_other_threads,
            )  # fmt: skip
            writer = asyncio.create_task(self._write(connection))
            await self._read(connection)
        finally:
            self._connections.discard(connection)
            if writer is not None:
                writer.cancel()
        return socket

    def _room_for(self, role: str) -> int:
        """Return how many clients may be connected before one of this role."""
        kept = 0 if role == THERAPIST else min(_FOR_THERAPISTS, self.limits.clients - 1)
        return self.limits.clients - kept

    def _from_other_threads(self, answered: Callable) -> Callable:
        def answer(*given: Any) -> None:
            with contextlib.suppress(RuntimeError):  # the loop has been closed since
                self._loop.call_soon_threadsafe(answered, *given)

        return answer

    async def _read(self, connection: Connection) -> None:
        async for message in connection.socket:
            if message.type is not WSMsgType.TEXT:
                await self._cut_off(connection, self._unwanted(message))
                return
            try:
                connection.client.take(message.data, self._clock.now_ns())
                connection.wake.set()  # a new subscriber gets the newest message at once
            except CutOff as error:
                await self._cut_off(connection, str(error))
                return

    def _unwanted(self, message: WSMessage) -> str:
        """Return what is wrong with a message that is no text."""
        if message.type is not WSMsgType.ERROR:
            return "JSON texts are wanted, no binary messages"
        if getattr(message.data, "code", None) == WSCloseCode.MESSAGE_TOO_BIG:
            return f"a message had more than the {self.limits.size} bytes that are allowed"
        return f"it does not keep to the websocket protocol: {message.data}"

    async def _cut_off(self, connection: Connection, sentence: str) -> None:
        """Send a client the reason of its disconnection, if it reads, and close."""
        self.cut_off += 1
        self._log(f"cut off a {connection.client.role}'s page: {sentence}")
        socket = connection.socket

        async def farewell() -> None:
            await socket.send_str(status("error", sentence))
            await socket.close(code=WSCloseCode.POLICY_VIOLATION, message=sentence.encode()[:120])

        with contextlib.suppress(asyncio.TimeoutError, ConnectionError):
            await asyncio.wait_for(farewell(), self.limits.patience)
        connection.transport.abort()

    async def _write(self, connection: Connection) -> None:
        try:
            while True:
                await connection.wake.wait()
                connection.wake.clear()
                for text in connection.client.due(self._clock.now_ns()):
                    connection.sending_since_ns = self._clock.now_ns()
                    await connection.socket.send_str(text)
                    connection.sending_since_ns = None
        except ConnectionError:
            pass  # the reading task also notices
        except Exception as error:  # otherwise a page without news looks like a robot at rest
            self._log(f"cut off a {connection.client.role}'s page: {type(error).__name__}: {error}")
            connection.transport.abort()

    def _look(self) -> None:
        """Wake the clients that wait for messages; disconnect those that do not read."""
        now_ns, patience_ns = self._clock.now_ns(), self.limits.patience * 1e9
        for connection in list(self._connections):
            since_ns = connection.sending_since_ns
            if since_ns is not None and now_ns - since_ns > patience_ns:
                self.cut_off += 1
                connection.sending_since_ns = None  # it lasts a moment until the connection ends
                self._log(f"cut off a {connection.client.role}'s page: it does not read")
                connection.transport.abort()
            else:
                connection.wake.set()


def _page(name: str) -> Callable:
    async def serve(request: web.Request) -> web.FileResponse:
        return web.FileResponse(FOLDER / name)

    return serve


async def _add_headers(request: web.Request, response: web.StreamResponse) -> None:
    response.headers.update(SECURITY_HEADERS)
