# SPDX-License-Identifier: Apache-2.0
"""What `bench --bridge` adds to the graph: `web_bridge`, and a client that reads what the patient's
page reads. The client is a thread of `bench`; a browser would take more of the processor.
"""

from __future__ import annotations

import asyncio
import json
import socket
import threading
from collections.abc import Sequence

import aiohttp

from screw_module_ros.bridge.tokens import tokens_in
from screw_module_ros.graph import ENDPOINT_STATE, THERAPY_STATE
from screw_module_ros.nodes import bringup
from screw_module_ros.operator.robot import Robot, RobotError

from ..graph_run import GraphRun
from ..therapy import BRIDGE, bridge_arguments, token_file

SUBSCRIBED = (ENDPOINT_STATE, THERAPY_STATE)
"""Topics of the patient's page, see bridge/pages/static/js/patient/main.js."""
_HEARD_S = 20.0
_LOOK_S = 0.2
_END_S = 5.0


class PageReader:
    """Subscribes to the patient's topics and reads them in a thread, from entering to leaving.

    received: publications read so far. error: what ended the connection early, None without.
    """

    def __init__(self, address: str, token: str, topics: Sequence[str] = SUBSCRIBED):
        """Prepare; address: of the bridge, like http://127.0.0.1:8090."""
        self.received = 0
        self.error: Exception | None = None
        self._address, self._token, self._topics = address, token, topics
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._run, name="page", daemon=True)

    def __enter__(self) -> PageReader:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ends.set()
        self._thread.join(_END_S)

    def _run(self) -> None:
        try:
            asyncio.run(self._read())
        except (aiohttp.ClientError, OSError) as error:
            self.error = error

    async def _read(self) -> None:
        headers = {"Authorization": f"Bearer {self._token}"}
        async with (
            aiohttp.ClientSession() as http,
            http.ws_connect(f"{self._address}/ws", headers=headers) as connection,
        ):
            for topic in self._topics:
                await connection.send_json({"op": "subscribe", "topic": topic})
            while not self._ends.is_set():
                try:
                    message = await connection.receive(timeout=_LOOK_S)
                except asyncio.TimeoutError:
                    continue
                self._take(message)

    def _take(self, message: aiohttp.WSMessage) -> None:
        if message.type is not aiohttp.WSMsgType.TEXT:
            raise ConnectionError("the bridge closed the page's connection")
        content = json.loads(message.data)
        if content["op"] == "status":
            raise ConnectionError(f"the bridge refused the page: {content['msg']}")
        self.received += content["op"] == "publish"


class PageBeside:
    """`web_bridge` and one page beside a running graph, from entering to leaving."""

    def __init__(self, graph: GraphRun):
        """Prepare; start nothing yet."""
        self._graph = graph
        self._bridge: bringup.Process | None = None
        self._reader: PageReader | None = None

    def __enter__(self) -> PageBeside:
        self._port = _free_port()
        arguments = bridge_arguments(self._graph, self._port, file_games=False)
        self._bridge = bringup.Process(BRIDGE, arguments)
        return self

    def __exit__(self, *exception: object) -> None:
        if self._reader is not None:
            self._reader.__exit__(*exception)
        self._bridge.stop()

    @property
    def pids(self) -> dict[str, int]:
        """Process id of the bridge, by its name."""
        return {BRIDGE: self._bridge.pid}

    @property
    def received(self) -> int:
        """Publications that the page has read. Raises RobotError once it is disconnected."""
        if self._reader.error is not None:
            raise RobotError(f"the page beside the graph: {self._reader.error}")
        return self._reader.received

    def connect(self, robot: Robot) -> None:
        """Connect the page, and wait until it reads. Raises RobotError."""
        robot.wait_until_ready([BRIDGE])
        token = tokens_in(token_file(self._graph)).patient
        self._reader = PageReader(f"http://127.0.0.1:{self._port}", token).__enter__()
        robot.wait_until(lambda: self.received, _HEARD_S, "the page beside the graph reads nothing")


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]
