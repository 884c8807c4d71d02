# SPDX-License-Identifier: Apache-2.0
"""A program in place of a therapist's page: starts a session through the bridge and attends it, or
floods the bridge."""

from __future__ import annotations

import asyncio
import contextlib
import json
import threading
from pathlib import Path

import aiohttp

from screw_module_ros import graph
from screw_module_ros.bridge.tokens import tokens_in

_ATTEND_S = 0.02  # wall clock; simulated time may pass faster than real time
_CLOSING_S = 5.0
_FLOOD = 50  # messages between two pauses
_WORD = {"op": "publish", "topic": f"/{graph.THERAPY_ATTENDANCE}", "msg": {}}


class AttendingPage:
    """Publishes attendance from a thread until `close`.

    sent: number of messages; floods: set it to send without a pause; asks: set it to a service and
    its arguments; answer: its response, or why there is none, None before; end: reason of the end
    of the connection, empty before.
    """

    def __init__(self, address: str, token_file: str):
        self.sent, self.floods, self.end = 0, False, ""
        self.asks: tuple[str, dict] | None = None
        self.answer: dict | str | None = None
        self._url = f"{address}/ws?token={tokens_in(Path(token_file))['therapist']}"
        self._closing = threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._attend()), daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Close the connection."""
        self._closing.set()
        self._thread.join(_CLOSING_S)

    async def _attend(self) -> None:
        try:
            async with aiohttp.ClientSession() as session, session.ws_connect(self._url) as socket:
                reading = asyncio.create_task(self._read(socket))
                while not self._closing.is_set() and not reading.done():
                    with contextlib.suppress(ConnectionError):  # `_read` notes the reason
                        await self._ask(socket)
                        for _ in range(_FLOOD if self.floods else 1):
                            await socket.send_json(_WORD)
                    self.sent += 1
                    await asyncio.sleep(0.0 if self.floods else _ATTEND_S)
                reading.cancel()
        except (aiohttp.ClientError, ConnectionError) as error:
            self.end = self.end or f"{type(error).__name__}: {error}"

    async def _ask(self, socket: aiohttp.ClientWebSocketResponse) -> None:
        if self.asks is not None:
            (service, arguments), self.asks = self.asks, None
            call = {"op": "call_service", "service": f"/{service}", "args": arguments}
            await socket.send_json(call)

    async def _read(self, socket: aiohttp.ClientWebSocketResponse) -> None:
        """Note the answers, and the bridge's last message before it closes the connection."""
        async for message in socket:
            if message.type is aiohttp.WSMsgType.TEXT:
                content = json.loads(message.data)
                self.end = content.get("msg", "")
                if content.get("op") == "service_response":
                    self.answer = content["values"]
        self.end = self.end or "the connection was closed"
