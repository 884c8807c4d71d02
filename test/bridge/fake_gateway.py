# SPDX-License-Identifier: Apache-2.0
"""A robot for the bridge without ROS, and the thread in which a server runs."""

from __future__ import annotations

import asyncio
import json
import threading
from concurrent.futures import Future
from pathlib import Path

from screw_module_ros.bridge.record_desk import RecordDesk
from screw_module_ros.bridge.rights import KEPT, Rights
from screw_module_ros.bridge.server import Server
from screw_module_ros.bridge.settings import Limits, Listening
from screw_module_ros.clock import WallClock

TOKENS = {"patient": "p" * 32, "therapist": "t" * 32, "therapist:T7": "7" * 32}
CONFIG = {"robots": ["/"], "protocols": []}


def make_server(
    gateway, limits=None, log=print, config=CONFIG, wishes=False, port=0, folder=Path("/none"),
    tokens=lambda: TOKENS, games=None, **listening,
):  # fmt: skip
    """Return a server for a robot that is played; folder: of the record; tokens: those of now."""
    return Server(
        Listening(port=port, **listening), limits or Limits(), tokens,
        Rights(config["robots"], wishes), gateway, RecordDesk(folder, log), WallClock(), config,
        log, games,
    )  # fmt: skip


class FakeGateway:
    """Topics that are set by hand (`tell`), calls that are kept with the future of their answer."""

    def __init__(self):
        self.published: list[tuple[str, dict]] = []
        self.calls: list[tuple] = []
        self.actions: list[tuple] = []
        self.told: dict[str, list[tuple[int, str]]] = {}

    def tell(self, topic, content):
        messages = self.told.setdefault(topic, [])
        messages.append((len(messages) + 1, json.dumps(content)))

    def poll(self):
        """What `tell` has set is there already."""

    def begin(self, topic):
        return 0

    def after(self, topic, number):
        messages = self.told.get(topic, [])
        kept = messages if topic.endswith(tuple(KEPT)) else messages[-1:]
        return [each for each in kept if each[0] > number]

    def publish(self, topic, content):
        if not isinstance(content, dict) or "bad" in content:
            raise ValueError("bad: unknown field")
        self.published.append((topic, content))

    def act(self, robot, page, action, refused=False):
        self.actions.append((robot, page, action, refused))

    async def call(self, service, arguments):
        if "bad" in arguments:
            raise ValueError("bad: unknown field")
        answer = asyncio.get_running_loop().create_future()
        self.calls.append((service, arguments, answer))
        return await answer


class Served:
    """Runs a server in a thread, as the node's loop does, from entering to leaving."""

    def __init__(self, server):
        self.server = server
        self._ending = threading.Event()
        self._started: Future = Future()
        self._thread = threading.Thread(target=self._run, name="bridge", daemon=True)

    def __enter__(self):
        self._thread.start()
        self._started.result()
        return self.server

    def __exit__(self, *_):
        self._ending.set()
        self._thread.join()

    def _run(self):
        loop = asyncio.new_event_loop()
        try:
            loop.run_until_complete(self.server.start())
        except Exception as error:
            self._started.set_exception(error)
        else:
            self._started.set_result(None)
            while not self._ending.is_set():
                loop.run_until_complete(self.server.turn(0.01))
        loop.run_until_complete(self.server.close())
        for call in asyncio.all_tasks(loop):  # that nobody has answered
            call.cancel()
        loop.run_until_complete(asyncio.sleep(0))
        loop.close()
