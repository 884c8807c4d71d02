# SPDX-License-Identifier: Apache-2.0
"""Settings of the bridge: its address, and the limits of a client. The numbers are ours."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from ..settings import Setting


class Listening(NamedTuple):
    """Address of the bridge, and the pages that may connect."""

    address: Annotated[
        str, Setting("IP address to listen on; any but this machine's own needs tls", at_start=True)
    ] = "127.0.0.1"
    port: Annotated[
        int, Setting("TCP port, 0 = any that is free", "", 0, 65535, at_start=True)
    ] = 8090
    hosts: Annotated[
        tuple[str, ...], Setting("further host names of the bridge", at_start=True)
    ] = ("",)
    origins: Annotated[
        tuple[str, ...],
        Setting("other pages that may connect, like https://games.example; null: those from a file",
                at_start=True),
    ] = ("",)  # fmt: skip
    certificate: Annotated[
        str, Setting("file with the TLS certificate (PEM), empty: no TLS", at_start=True)
    ] = ""
    key: Annotated[str, Setting("file with its private key (PEM)", at_start=True)] = ""
    token_file: Annotated[
        str, Setting("file of the tokens, created if missing; empty = beside the nodes' state",
                     at_start=True),
    ] = ""  # fmt: skip


class Limits(NamedTuple):
    """Limits of the clients."""

    clients: Annotated[int, Setting("clients at once, at most", "", 1, 100)] = 16
    rate: Annotated[float, Setting("newest samples per topic and client", "Hz", 1.0, 100.0)] = 60.0
    messages: Annotated[
        float, Setting("messages of a client that are carried out, on average at most; of more "
                       "the newest of each topic counts", "1/s", 5.0, 1000.0)
    ] = 100.0
    burst: Annotated[
        float, Setting("messages of a client that are carried out in a burst", "", 10.0, 1000.0)
    ] = 200.0
    flood: Annotated[
        float, Setting("messages of a client, on average, above which it is disconnected", "1/s",
                       100.0, 10000.0)
    ] = 500.0  # more than any screen shows pictures
    size: Annotated[int, Setting("largest message of a client", "bytes", 1024, 1_000_000)] = 16384
    patience: Annotated[
        float, Setting("time until a client that does not read is disconnected", "s", 0.2, 30.0)
    ] = 2.0
    answer: Annotated[float, Setting("time limit of a service call", "s", 0.5, 60.0)] = 5.0
