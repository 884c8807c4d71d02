# SPDX-License-Identifier: Apache-2.0
"""A game without ROS: receives the hand's position and requests set points, by websocket.

tools/run python examples/web_game.py 'ws://127.0.0.1:8090/ws?token=THE_PATIENTS_TOKEN'
"""

from __future__ import annotations

import asyncio
import math
import random
import sys

import aiohttp

NEAR = 0.03  # [m] within which a star is caught


def new_star() -> tuple[float, float, float]:
    """Return somewhere in the workspace: x, y from its centre, z from the bottom [m]."""
    return random.uniform(-0.12, 0.12), random.uniform(-0.1, 0.1), random.uniform(0.1, 0.26)


async def play(address: str) -> None:
    """Catch stars until the bridge ends."""
    star, caught = new_star(), 0
    async with aiohttp.ClientSession() as session, session.ws_connect(address) as bridge:
        topic = "/endpoint_state"
        await bridge.send_json({"op": "subscribe", "topic": topic, "throttle_rate": 50})
        async for text in bridge:
            if text.type is not aiohttp.WSMsgType.TEXT:
                break
            message = text.json()
            if message["op"] != "publish":
                print(message.get("msg", message), flush=True)  # a status: the error
                continue
            hand = [message["msg"]["position"][axis] for axis in "xyz"]
            if None in hand:
                continue  # an axis is not homed
            if math.dist(hand, star) < NEAR:
                caught += 1
                print(f"star {caught} caught at {star}", flush=True)
                star = new_star()
            wish = {"position": dict(zip("xyz", star, strict=True))}
            await bridge.send_json({"op": "publish", "topic": "/therapy/wish", "msg": wish})


if __name__ == "__main__":
    try:
        asyncio.run(play(sys.argv[1]))
    except KeyboardInterrupt:
        pass
    except (IndexError, aiohttp.ClientError) as error:
        sys.exit(f"{__doc__}\nIt did not work: {error}")
