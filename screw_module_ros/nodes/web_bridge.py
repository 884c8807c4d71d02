# SPDX-License-Identifier: Apache-2.0
"""`web_bridge`: pages for patient and therapist, and the robot for games written with roslibjs.

One port serves the pages and a websocket. `bridge/`, which is independent of ROS, decides on the
rights of each client. The node takes no part in simulated time. It neither moves nor stops the
robot: `therapy_session` pauses a session when the therapist's page is silent for any reason.
"""

from __future__ import annotations

import asyncio
import ssl
from functools import partial
from pathlib import Path
from typing import Annotated, NamedTuple

from rclpy.exceptions import InvalidNamespaceException
from rclpy.validate_namespace import validate_namespace

from screw_module_ros.bridge.door import is_loopback
from screw_module_ros.bridge.record_desk import RecordDesk
from screw_module_ros.bridge.rights import Rights
from screw_module_ros.bridge.server import Server
from screw_module_ros.bridge.settings import Limits, Listening
from screw_module_ros.bridge.tokens import token_file, tokens_in
from screw_module_ros.clock import WallClock
from screw_module_ros.settings import Setting
from screw_module_ros.therapy.measures import MEASURES
from screw_module_ros.therapy.protocol_file import GAME_FOLDER, protocols_for_screens

from .bridge_gateway import BridgeGateway
from .support.node import Node
from .support.place import root_folder
from .support.states import OK, Health

_POLL_S = 0.05


class BridgeSettings(NamedTuple):
    """Robots of the pages, and the rights of the patient's token."""

    robots: Annotated[
        tuple[str, ...], Setting("namespaces of the robots, empty = the bridge's", at_start=True)
    ] = ("",)
    folder: Annotated[
        str, Setting("folder of your own protocols and games, as in therapy_session; ~ is the home "
                     "folder", at_start=True),
    ] = "~/protocols"  # fmt: skip
    recordings: Annotated[
        str, Setting("folder of all bags, as `folder` of session_recorder: the record of patients",
                     at_start=True),
    ] = "~/sessions"  # fmt: skip
    wishes: Annotated[
        bool, Setting("the patient's token may also publish therapy/wish", live=True)
    ] = False


class WebBridgeNode(Node):
    """The loop's thread runs the server's asyncio loop, a sampling period at a time."""

    def __init__(self) -> None:
        super().__init__("web_bridge")
        self.parameters.declare(BridgeSettings, Listening, limits=Limits)

    # Lifecycle -----------------------------------------------------------------------------

    def connect(self) -> None:
        """Check address, certificate and tokens; make the topics."""
        self._listens_at, settings = self._listening(), self.parameters.read(BridgeSettings)
        self._rights = Rights(self._robots(settings.robots), settings.wishes)
        tokens_in(self._token_file())
        self._folder = root_folder(settings.recordings)
        self._limits = self.parameters.read(Limits, "limits")
        self._gateway = BridgeGateway(self, self._rights, self._limits.answer)
        self.opened.callback(self._gateway.close)
        self._loop = asyncio.new_event_loop()
        self.opened.callback(self._loop.close)
        own = root_folder(settings.folder)
        self._games = own / GAME_FOLDER
        protocols = protocols_for_screens(own, self.get_logger().warning)
        robots, measures = list(self._rights.robots), measures_for_screens()
        self._config = {"robots": robots, "protocols": protocols, "measures": measures}

    def begin(self) -> None:
        """Listen."""
        self._server = Server(
            self._listens_at, self._limits, partial(tokens_in, self._token_file(), makes=False),
            self._rights, self._gateway, RecordDesk(self._folder, self.get_logger().warning),
            WallClock(), self._config, self.get_logger().warning, self._games,
        )  # fmt: skip
        try:
            self._loop.run_until_complete(self._server.start())
        except ssl.SSLError as error:
            raise OSError(f"certificate and key cannot be used: {error}") from None
        except OSError as error:
            where = self._listens_at
            raise OSError(
                f"cannot listen on {where.address} port {where.port}: {error.strerror or error}; "
                "end the program that listens there, or choose another port"
            ) from None
        self.get_logger().info(
            f"pages at {self._server.address}; the tokens are in {self._token_file()}"
        )

    def end(self) -> None:
        """Disconnect every page, and give up what is under way."""
        self._loop.run_until_complete(_ended(self._server))

    def _listening(self) -> Listening:
        """Return the address to listen on. Raises ValueError if others could eavesdrop there."""
        listening = self.parameters.read(Listening)
        if not is_loopback(listening.address) and not listening.certificate:
            raise ValueError(
                f"address {listening.address}: other machines reach it, and so tokens and forces "
                "would go over the network for all to read: name a certificate and its key, or "
                "listen on 127.0.0.1"
            )
        for name in ("certificate", "key"):
            file = getattr(listening, name)
            if file and not Path(file).is_file():
                raise ValueError(f"{name} {file}: there is no such file")
        return listening

    def _robots(self, names: tuple[str, ...]) -> list[str]:
        """Return full namespaces. Raises ValueError for an invalid or repeated one."""
        found = []
        for name in names or ("",):
            full = f"/{name.strip('/')}" if name.strip("/") else self.get_namespace()
            try:
                validate_namespace(full)
            except InvalidNamespaceException as error:
                why = str(error).splitlines()[0].rstrip(":")
                raise ValueError(f"robots: {name!r} is no namespace: {why}") from None
            if full in found:
                raise ValueError(f"robots: {full} is named twice")
            found.append(full)
        return found

    def _token_file(self) -> Path:
        if self._listens_at.token_file:
            return Path(self._listens_at.token_file).expanduser()
        return token_file()

    def changed(self, kind: type) -> None:
        """Apply live parameters."""
        if kind is BridgeSettings and self.configured:
            self._rights.wishes = self.parameters.read(BridgeSettings).wishes

    # Loop ----------------------------------------------------------------------------------

    def step(self) -> None:
        """Serve for a moment; by wall clock, as in browsers."""
        self.clock.idle()
        self._loop.run_until_complete(self._server.turn(_POLL_S))

    def health(self) -> Health:
        """Report the connected clients."""
        server = self._server
        values = {
            "address": server.address, "clients": server.clients, "cut off": server.cut_off,
            "refused": server.refused, "unfinished": server.unfinished,
        }  # fmt: skip
        return Health(OK, f"pages at {server.address}", values)


def measures_for_screens() -> list[dict[str, str | float]]:
    """Return name, label, unit and factor from SI of each measure."""
    keys = ("name", "label", "unit", "factor")
    return [{key: getattr(measure, key) for key in keys} for measure in MEASURES]


async def _ended(server: Server) -> None:
    await server.close()
    calls = asyncio.all_tasks() - {asyncio.current_task()}  # also of clients that have gone
    for call in calls:
        call.cancel()
    await asyncio.gather(*calls, return_exceptions=True)
