# SPDX-License-Identifier: Apache-2.0
"""A therapist's page as a program: attends a session through the bridge, or floods it."""

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
_WORD = {"op": "publish", "topic": f"/{graph.THERAPY_ATTENDANCE}", "msg": {}}


class Page:
    """Attends in a thread of its own until `close`.

    sent: messages so far; floods: may be set; end: why the connection has ended, empty before.
    """

    def __init__(self, address: str, token_file: str):
        self.sent, self.floods, self.end = 0, False, ""
        self._url = f"{address}/ws?token={tokens_in(Path(token_file)).therapist}"
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
                    with contextlib.suppress(ConnectionError):  # what reads tells why
                        await socket.send_json(_WORD)
                    self.sent += 1
                    await asyncio.sleep(0.0 if self.floods else _ATTEND_S)
                reading.cancel()
        except (aiohttp.ClientError, ConnectionError) as error:
            self.end = self.end or f"{type(error).__name__}: {error}"

    async def _read(self, socket: aiohttp.ClientWebSocketResponse) -> None:
        """Note what the bridge says before it closes the connection."""
        async for message in socket:
            if message.type is aiohttp.WSMsgType.TEXT:
                self.end = json.loads(message.data).get("msg", "")
        self.end = self.end or "the connection was closed"
