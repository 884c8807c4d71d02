# SPDX-License-Identifier: Apache-2.0
"""How messages travel between our processes: over UDP, not through shared memory.

A process that is stopped (SIGSTOP, Ctrl-Z, a debugger) while it holds the lock of its port in Fast
DDS's shared memory keeps every process waiting that sends to it: a frozen spectator could stop the
robot. A socket's buffer only fills. UDP is as fast here, and a killed process leaves nothing in
/dev/shm. Whoever subscribes may use what he likes.
"""

from __future__ import annotations

import os

_VARIABLE = "FASTDDS_BUILTIN_TRANSPORTS"
# As large as the usual limit for sockets: the recorder may be kept from reading for a while. A full
# buffer loses a message, it does not keep the sender waiting.
_UDP = "UDPv4?sockets_size=4MB&non_blocking=true"


def choose_transport() -> None:
    """Let Fast DDS use UDP in this process and its children, where nothing else was asked for.

    Call before a ROS context is made; other RMW implementations do not look at it.
    """
    os.environ.setdefault(_VARIABLE, _UDP)
