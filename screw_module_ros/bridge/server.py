# SPDX-License-Identifier: Apache-2.0
"""The server: pages and websocket on one port, all in one asyncio thread, without a lock.

A client that does not read is disconnected after `patience`; until then it delays only itself. The
log contains nothing of a request, and so no token.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from aiohttp import WSCloseCode, WSMessage, WSMsgType, web

from ..clock import Clock
from .client import Client, CutOff, Gateway
from .door import Door, Refused, names_of, token_in
from .listener import Listener
from .pages import FOLDER, GAME_POLICY, PAGES, POLICY, SECURITY_HEADERS
from .record_desk import RecordDesk
from .rights import THERAPIST, Rights
from .settings import Limits, Listening
from .tokens import TokenError, role_of

_HEARTBEAT_S = 10.0  # heartbeat of the websocket: finds a client whose machine has gone
_BUFFER = 65536  # bytes on the way to a client, beside the kernel's
_END_S = 0.5
_WATCH_NS = 1_000_000_000  # how soon a token that was taken away ends
_FOR_THERAPISTS = 2  # places that other pages cannot take: a therapist can always stop the robot

_GAMES = "/games/"  # their pages; who sees one has no right yet

_SILENT = logging.getLogger(f"{__name__}.aiohttp")  # its errors quote the request
_SILENT.disabled = True


@dataclass(eq=False)
class Connection:
    """A websocket with its client and token; wake: set when there may be something to send."""

    token: str
    socket: web.WebSocketResponse
    transport: asyncio.Transport
    client: Client
    wake: asyncio.Event


class Server:
    """Serves from `start` to `close`, in the asyncio loop that runs both, while `turn` is called.

    tokens: returns those of now, by whom they belong to; raises TokenError. record: closed with it.
    log: takes a sentence. config: content of /config.json. games: folder of their pages. cut_off:
    number of disconnected clients. refused: number of refused requests.
    """

    def __init__(
        self, listening: Listening, limits: Limits, tokens: Callable[[], Mapping[str, str]],
        rights: Rights, gateway: Gateway, record: RecordDesk, clock: Clock, config: dict,
        log: Callable[[str], None] = lambda sentence: None, games: Path | None = None,
    ):  # fmt: skip
        origins = [each.get("origin", "") for each in config["protocols"]]
        own = " ".join([SECURITY_HEADERS[POLICY], *filter(None, origins)])
        self._games, self._headers = games, {**SECURITY_HEADERS, POLICY: own}
        self.limits = limits
        self._listening, self._tokens, self._rights = listening, tokens, rights
        self._gateway, self._clock, self._config, self._log = gateway, clock, config, log
        self._record, self._watch_ns = record, 0
        self._asked: set[asyncio.BaseTransport | None] = set()  # of answers from the record
        self._connections: set[Connection] = set()
        self._listener: Listener  # both from `start` on
        self._door: Door
        self._runner: web.AppRunner | None = None
        self.cut_off = self.refused = 0

    async def start(self) -> None:
        """Listen. Raises OSError or ssl.SSLError if that fails."""
        listening = self._listening
        listener = self._listener = Listener(listening, self._is_client, self._log)
        app = web.Application(middlewares=[self._guard], client_max_size=self.limits.size)
        app.add_routes([web.get("/ws", self._websocket), web.get("/config.json", self._configured)])
        app.add_routes([web.get(path, _page(name)) for path, name in PAGES.items()])
        for path in ("/record/{what}", "/record/{patient}/{what}"):
            app.router.add_route("*", path, self._recorded)
        app.router.add_static("/static/", FOLDER, follow_symlinks=False)
        if self._games is not None and self._games.is_dir():
            app.router.add_static(_GAMES, self._games, follow_symlinks=False)
        app.on_response_prepare.append(self._add_headers)
        self._runner = web.AppRunner(
            app, access_log=None, logger=_SILENT, handle_signals=False, shutdown_timeout=_END_S
        )
        await self._runner.setup()
        names = names_of(listening.address, listening.hosts)
        origins = tuple(filter(None, listening.origins))
        self._door = Door(names, listener.port, listener.scheme, origins, self._tokens)
        asyncio.get_running_loop().set_exception_handler(self._unexpected)
        assert self._runner.server is not None, "it is set up"
        listener.start(self._runner.server)

    async def turn(self, idle_s: float) -> None:
        """Serve for a sampling period, `idle_s` without clients; then send what is new."""
        await asyncio.sleep(1.0 / self.limits.rate if self._connections else idle_s)
        self._gateway.poll()
        for connection in self._connections:
            connection.wake.set()
        now_ns = self._clock.now_ns()
        if now_ns >= self._watch_ns:
            self._watch_ns = now_ns + _WATCH_NS
            self._record.look(now_ns)
            self._end_revoked()

    def _end_revoked(self) -> None:
        """Disconnect pages whose token was taken away; who is in stays while none can be read."""
        with contextlib.suppress(TokenError):
            tokens = self._tokens().values()
            for connection in self._connections:
                if connection.token not in tokens:
                    self._count_cut_off(connection, "its token was taken away")
                    connection.transport.abort()

    async def close(self) -> None:
        """Close every connection, and the record."""
        self._record.close()
        for connection in list(self._connections):
            with contextlib.suppress(ConnectionError, asyncio.TimeoutError):
                await asyncio.wait_for(
                    connection.socket.close(code=WSCloseCode.GOING_AWAY, message=b"bridge ends"),
                    timeout=_END_S,
                )
            connection.transport.abort()
        if self._runner is not None:
            await self._listener.close()
            await self._runner.cleanup()

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

    @property
    def unfinished(self) -> int:
        """Number of connections that were closed without a request."""
        return self._listener.unfinished

    def _is_client(self, transport: asyncio.BaseTransport) -> bool:
        known = [connection.transport for connection in self._connections]
        return transport in self._asked or transport in known

    def _unexpected(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """Log an error of asyncio without its text, which may quote a request."""
        self._log(f"{context['message']}: {type(context.get('exception')).__name__}")

    # Requests ------------------------------------------------------------------------------

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
        except TokenError as error:
            self._log(str(error))
            raise web.HTTPServiceUnavailable(text="no token can be read: see the log\n") from None
        except web.HTTPException:
            raise
        except Exception as error:
            self._log(f"a request failed: {type(error).__name__}")
            raise

    async def _configured(self, request: web.Request) -> web.Response:
        """Return a page's role, robots, protocols and measures; it needs a token as `/ws` does."""
        role = role_of(self._door.whose(token_in(request.query, request.headers)))
        config = {**self._config, "role": role, "wishes": self._rights.wishes or role == THERAPIST}
        return web.Response(text=json.dumps(config), content_type="application/json")

    async def _recorded(self, request: web.Request) -> web.Response:
        """Answer from the patients' record; it needs a therapist's token, in the header alone."""
        who = self._door.whose(token_in({}, request.headers))
        if role_of(who) != THERAPIST:
            raise Refused("the patient's page may not read the record")
        self._asked.add(request.transport)
        try:
            return await self._record.answer(request, who)
        finally:
            self._asked.discard(request.transport)

    async def _websocket(self, request: web.Request) -> web.StreamResponse:
        token = token_in(request.query, request.headers) or ""
        role = role_of(self._door.whose(token))
        if len(self._connections) >= self._room_for(role):
            raise web.HTTPServiceUnavailable(
                text=f"{self._room_for(role)} clients are connected, the most there may be for a "
                f"{role}'s page\n"
            )
        ws = web.WebSocketResponse(
            max_msg_size=self.limits.size, heartbeat=_HEARTBEAT_S, compress=False
        )
        transport = request.transport
        if transport is None:
            raise ConnectionResetError("the client has gone")
        wake, now_ns = asyncio.Event(), self._clock.now_ns()
        client = Client(role, self._rights, self._gateway, self.limits, now_ns, wake.set)
        connection = Connection(token, ws, transport, client, wake)
        self._connections.add(connection)
        try:
            await ws.prepare(request)
            transport.set_write_buffer_limits(high=_BUFFER)
            writer = asyncio.create_task(self._write(connection))
            try:
                await self._read(connection)
            finally:
                writer.cancel()
        finally:
            self._connections.discard(connection)
        return ws

    def _room_for(self, role: str) -> int:
        """Return how many clients may be connected before one of this role."""
        kept = 0 if role == THERAPIST else min(_FOR_THERAPISTS, self.limits.clients - 1)
        return self.limits.clients - kept

    async def _read(self, connection: Connection) -> None:
        async for message in connection.socket:
            try:
                if message.type is not WSMsgType.TEXT:
                    raise CutOff(self._message_flaw(message))
                connection.client.take(message.data, self._clock.now_ns())
                connection.wake.set()  # a new subscriber gets the newest message at once
            except CutOff as error:
                await self._cut_off(connection, str(error))
                return

    def _message_flaw(self, message: WSMessage) -> str:
        """Return what is wrong with a message that is no text."""
        if message.type is not WSMsgType.ERROR:
            return "JSON texts are wanted, no binary messages"
        if getattr(message.data, "code", None) == WSCloseCode.MESSAGE_TOO_BIG:
            return f"a message had more than the {self.limits.size} bytes that are allowed"
        return "it does not keep to the websocket protocol"

    async def _write(self, connection: Connection) -> None:
        """Send what is new, until the client ends or does not read."""
        why = "it does not read"
        try:
            while True:
                await connection.wake.wait()
                connection.wake.clear()
                for text in connection.client.texts(self._clock.now_ns()):
                    await asyncio.wait_for(
                        connection.socket.send_str(text), timeout=self.limits.patience
                    )
        except ConnectionError:
            return  # the reading task also notices
        except asyncio.TimeoutError:
            pass
        except Exception as error:  # otherwise a page without news looks like a robot at rest
            why = f"{type(error).__name__}: {error}"
        self._count_cut_off(connection, why)
        connection.transport.abort()

    async def _cut_off(self, connection: Connection, sentence: str) -> None:
        """Send a client the reason of its disconnection, if it reads, and close."""
        self._count_cut_off(connection, sentence)
        ws = connection.socket

        async def farewell() -> None:
            await ws.send_json({"op": "status", "level": "error", "msg": sentence})
            await ws.close(code=WSCloseCode.POLICY_VIOLATION, message=sentence.encode()[:120])

        with contextlib.suppress(asyncio.TimeoutError, ConnectionError):
            await asyncio.wait_for(farewell(), self.limits.patience)
        connection.transport.abort()

    async def _add_headers(self, request: web.Request, response: web.StreamResponse) -> None:
        response.headers.update(self._headers)
        if request.path.startswith(_GAMES):
            response.headers[POLICY] = GAME_POLICY
        if not isinstance(response, web.WebSocketResponse):
            response.force_close()  # so what stays open has made no request
            response.headers["Connection"] = "close"  # aiohttp has decided on this one before

    def _count_cut_off(self, connection: Connection, why: str) -> None:
        self.cut_off += 1
        self._log(f"cut off a {connection.client.role}'s page: {why}")


def _page(name: str) -> Callable:
    async def serve(request: web.Request) -> web.FileResponse:
        return web.FileResponse(FOLDER / name)

    return serve
