# SPDX-License-Identifier: Apache-2.0
"""The computer: right to real-time priority, kernel, isolated cores, SocketCAN interfaces.

Each function reads below `root`, so that a test can show it another machine.
"""

from __future__ import annotations

import json
import platform
import resource
import shutil
import subprocess
from pathlib import Path
from typing import Any

from ..can_io.bus import BusSettings
from .finding import Finding

LEAST_PRIORITY = 50
"""Highest priority that params/*.yaml ask for."""
LEAST_QUEUE = 100
_IP_S = 5.0


def machine(root: Path = Path("/"), limit: int | None = None) -> list[Finding]:
    """Return what the computer allows. limit: RLIMIT_RTPRIO, None for this process's."""
    if limit is None:
        limit = resource.getrlimit(resource.RLIMIT_RTPRIO)[0]
    unlimited = limit == resource.RLIM_INFINITY
    realtime = "" if unlimited or limit >= LEAST_PRIORITY else (
        "add `@realtime - rtprio 99` to /etc/security/limits.d/, yourself to the group, log in "
        "anew; a container needs --cap-add=sys_nice --ulimit rtprio=99"
    )  # fmt: skip
    found = [Finding("real-time priority", "unlimited" if unlimited else f"up to {limit}",
                     f"at least {LEAST_PRIORITY}", realtime)]  # fmt: skip
    version = _text(root / "proc/version") or platform.version()
    preemptive = "PREEMPT_RT" in version or _text(root / "sys/kernel/realtime") == "1"
    quick = "PREEMPT_RT" if preemptive else "low latency" if "lowlatency" in version else ""
    todo = "install a low-latency or PREEMPT_RT kernel for 1 kHz on a busy machine"
    found.append(Finding("kernel", quick or "an ordinary kernel", "PREEMPT_RT or low latency",
                         "" if quick else todo))  # fmt: skip
    isolated = _text(root / "sys/devices/system/cpu/isolated")
    none = "none (optional: isolcpus=... on the kernel's command line, then realtime.cores)"
    found.append(Finding("isolated cores", isolated or none))
    return found


def interface(settings: BusSettings, root: Path = Path("/"), shown: Any = None) -> list[Finding]:
    """Return the state of a SocketCAN interface; nothing for the other interfaces of python-can.

    shown: what `ip -details -json link show` says, None to ask it.
    """
    if settings.interface != "socketcan":
        return []
    name = settings.channel
    folder = root / "sys/class/net" / name
    up = f"sudo ip link set {name} up type can bitrate {settings.bitrate} restart-ms 100"
    if not folder.is_dir():
        todo = f"load the adapter's driver and plug it in; then {up}"
        return [Finding(name, "there is no such interface", "a CAN adapter", todo)]
    flags = int(_text(folder / "flags") or "0", 16)
    found = [Finding(name, "up" if flags & 1 else "down", "up", "" if flags & 1 else up)]
    queue = int(_text(folder / "tx_queue_len") or "0")
    longer = f"sudo ip link set {name} txqueuelen 1000 (with 10, sends fail with ENOBUFS)"
    found.append(Finding(f"{name} txqueuelen", str(queue), f"at least {LEAST_QUEUE}",
                         "" if queue >= LEAST_QUEUE else longer))  # fmt: skip
    return found + _controller(name, settings, up, _asked(name) if shown is None else shown)


def _controller(name: str, settings: BusSettings, up: str, shown: Any) -> list[Finding]:
    """Return bit rate and error state of the controller."""
    try:
        data = shown[0]["linkinfo"]["info_data"]
        rate, state = data["bittiming"]["bitrate"], data.get("state", "unknown")
    except (KeyError, IndexError, TypeError):
        todo = f"look at it with `ip -details link show {name}` (iproute2)"
        return [Finding(f"{name} bit rate", "not known", str(settings.bitrate), todo, known=False)]
    other = f"sudo ip link set {name} down; {up}" if rate != settings.bitrate else ""
    healthy = state == "ERROR-ACTIVE"
    cause = "" if healthy else (
        "check cable, 120 ohm at both ends, and that every device has this bit rate; then down and "
        "up again"
    )  # fmt: skip
    return [
        Finding(f"{name} bit rate", f"{rate}", f"{settings.bitrate} (can.bitrate)", other),
        Finding(f"{name} controller", state, "ERROR-ACTIVE", cause),
    ]


def _asked(name: str) -> Any:
    """Return what iproute2 says of the interface, None without it."""
    if shutil.which("ip") is None:
        return None
    words = ["ip", "-details", "-json", "link", "show", name]
    try:
        done = subprocess.run(words, capture_output=True, timeout=_IP_S, check=False)
        return json.loads(done.stdout)
    except (OSError, ValueError, subprocess.TimeoutExpired):
        return None


def _text(path: Path) -> str:
    try:
        return path.read_text().strip()
    except OSError:
        return ""
