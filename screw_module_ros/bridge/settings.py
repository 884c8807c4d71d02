# SPDX-License-Identifier: Apache-2.0
"""What decides how the bridge listens and what a client may cost it. The numbers are ours."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from ..settings import Setting


class Listening(NamedTuple):
    """Where the bridge listens, and for whom."""

    address: Annotated[
        str, Setting("IP address to listen on; any but this machine's own needs tls", at_start=True)
    ] = "127.0.0.1"
    port: Annotated[
        int, Setting("TCP port, 0 = any that is free", "", 0, 65535, at_start=True)
    ] = 8090
    hosts: Annotated[
        tuple[str, ...], Setting("further names by which it may be called", at_start=True)
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
        str, Setting("with both tokens, made if it is not there; empty: beside what nodes keep",
                     at_start=True),
    ] = ""  # fmt: skip


class Limits(NamedTuple):
    """What a client may cost."""

    clients: Annotated[int, Setting("connected at once", "", 1, 100)] = 16
    rate: Annotated[float, Setting("newest samples per topic and client", "Hz", 1.0, 100.0)] = 60.0
    messages: Annotated[
        float, Setting("that a client may send in the long run", "1/s", 5.0, 1000.0)
    ] = 100.0
    burst: Annotated[float, Setting("that it may send at once", "", 10.0, 1000.0)] = 200.0
    size: Annotated[int, Setting("of a message from a client", "bytes", 1024, 1_000_000)] = 16384
    patience: Annotated[
        float, Setting("with a client that does not read what it is sent", "s", 0.2, 30.0)
    ] = 2.0
    answer: Annotated[float, Setting("to wait for a service's answer", "s", 0.5, 60.0)] = 5.0
