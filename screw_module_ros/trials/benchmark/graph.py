# SPDX-License-Identifier: Apache-2.0
"""One run of the graph for `bench`: start, enable, measure for some seconds, stop.

Amplifier and encoder publish their histograms in their diagnostics, once a second.
"""

from __future__ import annotations

import os
from contextlib import ExitStack

from diagnostic_msgs.msg import DiagnosticArray
from screw_module_msgs.msg import AmplifierState, ForceCommand

from screw_module_ros.graph import COMPOSED as MODULE
from screw_module_ros.graph import DIAGNOSTICS
from screw_module_ros.nodes.support.states import histogram_key
from screw_module_ros.operator.robot import Robot, RobotError, arm
from screw_module_ros.safety.timing import histogram_of

from ..graph_run import GraphRun
from .figures import COMPOSED, PAGE, Case, Counts, Run, figures, processor_shares
from .page import PageBeside

_SETTLE_S = 2.0
_ENTRY_S = 10.0  # the longest wait for diagnostics
_HEIGHT = 0.27
_SPRING = 400.0
_TICKS_PER_SECOND = os.sysconf("SC_CLK_TCK")


def measure(case: Case, seconds: float) -> Run:
    """Start the whole graph, enable the vertical axis, measure for `seconds` [s], stop it.

    It runs in real time with the default limits of the guards. If the machine is too slow for
    them, the torque goes off, and the measurement continues with commands of zero force. Raises
    RobotError if the graph does not start or a node ends, Interrupted after Ctrl-C.
    """
    load = os.getloadavg()[0]
    extra = [*_rates(case.rate), "--disable-stdout-logs"]
    composed = case.processes == COMPOSED
    with ExitStack() as stack:
        graph = stack.enter_context(GraphRun(extra=extra, composed=composed, wall_clock=True))
        page = stack.enter_context(PageBeside(graph)) if case.page else None
        robot = stack.enter_context(Robot("bench", watch=graph.watch))
        graph.wait_until_ready(robot)
        listener = _Listener(robot)
        enabled = _enable(robot)
        pids = dict(graph.pids)
        if page is not None:
            page.connect(robot)
            pids |= page.pids
        robot.pause(_SETTLE_S)
        begin, read = listener.counts(pids), page.received if page else 0
        robot.pause(seconds)
        end, read = listener.counts(pids), (page.received if page else 0) - read
        state = robot.state(AmplifierState)
        enabled = enabled and state is not None and state.enabled
    found = figures(begin, end)
    if page is not None:
        found[PAGE] = read / (end.seconds - begin.seconds)
    return Run(found, processor_shares(begin, end), load, enabled)


def _rates(rate: int) -> list[str]:
    return [word for node in MODULE.parts for word in ("-p", f"{node}:rate:={float(rate)}")]


def _enable(robot: Robot) -> bool:
    """Enable the axis with a spring and a relaxed hand; return whether that succeeded."""
    try:
        robot.clear_faults()
        robot.home()
        robot.tare()
        robot.permit()
        robot.set_mode(ForceCommand.IMPEDANCE)
        robot.set_impedance(_SPRING, 0.0)
        robot.set_arm(arm(kind="relaxed"))
        robot.set_setpoint(z=_HEIGHT)
        robot.enable()
    except RobotError:
        return False  # commands of zero force take the same time
    return True


class _Listener:
    """Subscribes to the diagnostics of encoder and amplifier."""

    def __init__(self, robot: Robot):
        self._robot = robot
        self._values: dict[str, dict[str, str]] = {}
        robot.node.create_subscription(DiagnosticArray, DIAGNOSTICS, self._hear, 50)

    def _hear(self, array: DiagnosticArray) -> None:
        for status in array.status:
            node = status.name.rpartition("/")[2]
            self._values[node] = {value.key: value.value for value in status.values}

    def counts(self, pids: dict[str, int]) -> Counts:
        """Return the counts of the next diagnostics. Raises RobotError if none arrive."""
        self._values.clear()
        self._robot.wait_until(
            lambda: all("rate [1/s]" in self._values.get(n, {}) for n in ("encoder", "amplifier")),
            _ENTRY_S,
            "no diagnostics of encoder and amplifier",
        )
        encoder, amplifier = self._values["encoder"], self._values["amplifier"]
        return Counts(
            histogram_of(amplifier[histogram_key("latency")]),
            histogram_of(encoder[histogram_key("answer")]),
            histogram_of(amplifier[histogram_key("own")]),
            int(amplifier["late"]),
            int(amplifier["lost"]),
            {name: processor_time(pid) for name, pid in pids.items()},
            self._robot.clock.now_ns() * 1e-9,
        )


def processor_time(pid: int) -> float:
    """Return the processor time of a process so far [s], from /proc."""
    with open(f"/proc/{pid}/stat") as file:
        fields = file.read().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / _TICKS_PER_SECOND
