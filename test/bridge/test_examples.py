# SPDX-License-Identifier: Apache-2.0
"""The games in examples/ against the real server; the robot behind it is a fake."""

from __future__ import annotations

import itertools
import os
import re
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from fake_gateway import TOKENS, Served, make_server

from screw_module_ros.bridge.rights import PATIENT, PUBLISH, SUBSCRIBE, Rights

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture
def server(gateway):
    with Served(make_server(gateway, wishes=True)) as server:
        yield server


def test_the_python_game_plays(server, gateway, wait_until):
    address = f"{server.address.replace('http', 'ws')}/ws?token={TOKENS['patient']}"
    game = subprocess.Popen(
        [sys.executable, str(EXAMPLES / "web_game.py"), address],
        stdout=subprocess.PIPE, text=True, env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )  # fmt: skip
    said = []
    reader = threading.Thread(target=lambda: said.extend(game.stdout), daemon=True)
    reader.start()
    numbers = itertools.count()

    def caught_two():
        wishes = [content["position"] for _, content in gateway.published]
        hand = wishes[-1] if wishes else {"x": 0.0, "y": 0.0, "z": 0.18}
        gateway.tell("/endpoint_state", {"position": hand, "number": next(numbers)})
        return len(said) >= 2

    try:
        wait_until(caught_two, 60.0, "the game")
    finally:
        game.terminate()
        game.wait()
        reader.join(5.0)
        game.stdout.close()
    assert said[0].startswith("star 1 caught at")
    assert {topic for topic, _ in gateway.published} == {"/therapy/wish"}


def test_the_python_game_says_what_is_wrong(server):
    address = f"{server.address.replace('http', 'ws')}/ws?token=wrong"
    command = [sys.executable, str(EXAMPLES / "web_game.py"), address]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "It did not work" in done.stderr and "Traceback" not in done.stderr


def test_the_browser_game_asks_only_for_what_a_patient_may_have():
    text = (EXAMPLES / "browser_game.html").read_text("utf-8")
    found = re.findall(r'name: "(.+?)", messageType: "(.+?)"', text)
    assert [name for name, _ in found] == ["/endpoint_state", "/therapy/wish"]
    rights = Rights(["/"], wishes=True)
    assert rights.may(PATIENT, SUBSCRIBE, *found[0])
    assert rights.may(PATIENT, PUBLISH, *found[1])
