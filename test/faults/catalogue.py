# SPDX-License-Identifier: Apache-2.0
"""All rows, and the page docs/faults.md made from them."""

from __future__ import annotations

import rows_arm
import rows_bus
import rows_commands
import rows_drives
import rows_frames
import rows_intruders
import rows_laws
import rows_machine
import rows_nodes
import rows_operator
import rows_requests
import rows_sensors
import rows_support
import rows_therapy
import rows_trials
from record import LARGEST_STEP
from row import (
    CLEAR,
    EITHER,
    ENABLE,
    GOES_ON,
    HOME,
    MODE,
    OFF,
    OUTCOMES,
    PLANE_CLEAR,
    PLANE_HOME,
    RESET,
    TARE,
    VERTICAL_OFF,
    Row,
)

from screw_module_ros.graph import MODULE, WHOLE, Entry

_FILES = (
    rows_nodes,
    rows_bus,
    rows_sensors,
    rows_drives,
    rows_commands,
    rows_operator,
    rows_arm,
    rows_machine,
    rows_intruders,
    rows_frames,
    rows_requests,
    rows_laws,
    rows_therapy,
    rows_support,
    rows_trials,
)
ROWS: list[Row] = [row for file in _FILES for row in file.ROWS]
GROUPS = tuple(dict.fromkeys(row.group for row in ROWS))
ARRANGEMENTS = {"apart": None, "composed": MODULE}
_EVERY = 10


def carried_out(arrangement: str | None = None) -> list[Row]:
    """Return the rows as `make faults` carries them out: some in one process, composed as well.

    arrangement: a name of ARRANGEMENTS, in which each row is carried out once, where it can be.
    """
    if arrangement:
        return [_in(row, ARRANGEMENTS[arrangement]) for row in ROWS]
    sample = [
        row._replace(name=f"{row.name}-composed", shared=MODULE)
        for group in GROUPS
        for row in [row for row in ROWS if row.group == group and row.shared is WHOLE][::_EVERY]
    ]
    return ROWS + sample


def _in(row: Row, shared: Entry | None) -> Row:
    needs_more = row.shared is None or row.name.startswith(MODULE.executable) and shared is None
    return row if needs_more else row._replace(shared=shared)


def page() -> str:
    """Return docs/faults.md."""
    states = "\n".join(f"- *{name}*: {text}" for name, text in OUTCOMES.items())
    calls = "\n".join(f"- *{word}*: `{service}`" for service, word in _CALLS.items())
    lines = [_HEAD.format(count=len(ROWS), every=_EVERY, step=LARGEST_STEP, states=states,
                          calls=calls)]  # fmt: skip
    for group in GROUPS:
        members = [row for row in ROWS if row.group == group]
        lines += ["", f"## {group.capitalize()} ({len(members)} rows)", "", _COLUMNS]
        lines += map(_line, members)
    return "\n".join(lines) + "\n"


def _line(row: Row) -> str:
    within = "" if row.outcome == GOES_ON else f"{row.within} / {row.plane_within or '–'}"
    report = row.report.text if row.report else _NO_REPORT[row.outcome]
    names = ", ".join(_CALLS[service] for service in row.services) or "none"
    services = names.replace(_BOTH, "enable")
    cells = (f"`{row.name}`", row.fault, row.mode_name, row.noticed_by, within, row.outcome, report,
             services)  # fmt: skip
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


_CALLS = {
    HOME: "home", TARE: "tare", CLEAR: "clear", PLANE_CLEAR: "plane clear",
    PLANE_HOME: "plane home", RESET: "reset", MODE: "mode", ENABLE[0]: "vertical enable",
    ENABLE[1]: "plane enable",
}  # fmt: skip
"""Service -> its word in the column of recoveries."""
_BOTH = "vertical enable, plane enable"
_NO_REPORT = {
    GOES_ON: "none",
    EITHER: "none while it continues, else any reason in safety_state",
    OFF: "none: requested by the operator",
    VERTICAL_OFF: "none: requested by the operator",
}
_HEAD = """<!-- made by `make test ARGS="test/faults --write"`; do not edit -->
# Fault catalogue

`make faults` carries out these {count} rows on running graphs with the simulated rig, in simulated
time at 1 kHz (the plane at 500 Hz) and with the limits of the safety contract, while the patient
moves the handle. Parameters are the defaults, but for the ramp of the torque: 0.25 s, half of the
default, so that a step on recovery is twice as large. All nodes run in one process (`whole`). In
rows about a process, or about a foreign sender on a topic within that one, the nodes of the
vertical axis share a process (`module`) and the others have their own; in rows about one of these
nodes, or about a topic between them, each node has its own. One in {every} of the rows in one
process, and at least one of each group, is carried out with `module` as well, with the same limits.
`make faults ARGS=--arrangement=composed` carries out all that can be with `module`, and
`--arrangement=apart` in separate processes. Each row can fail for a reason of its own; unit tests
cover what all nodes, modes, fields or parameters have in common. Each row is a test below
`test/faults/`: `make faults ARGS="-k encoder-freeze"` carries out one of them.

If the robot must stop, a row passes when

- the rig's motors (`sim/truth`) give no torque after the row's time,
- the alarm of the row appears on `/diagnostics` and in `safety_state`,
- no torque returns by itself after the cause has gone and all nodes are active again,
- the recovery leads to operation without a restart of the graph and needs no other service than
  those of the row (*clear* often only where the amplifier missed commands before the supervisor's
  stop), and
- the patient's resting hand feels no step above {step:g} N during the recovery: no larger change
  within 25 ms (a knock of 5 ms in the play between nut and handle does not count).

If the robot must continue, both drives stay enabled and give torque, and no torque exceeds its
limit, also after the cause has gone. If both outcomes are allowed, the row is judged by the actual
outcome; a stop is timed from the first drive that went off, and a reason must be reported.

Times are in samples of the vertical chain (1 ms) of simulated time: first the vertical axis, then
the plane. They do not depend on the machine's load, because time waits for every node. Time waits
for a stopped process (SIGSTOP) for 1 s of wall clock, and not for a killed one. Without the rig,
time stands still.

Safe states:
{states}

Services of a recovery, each only if it is needed; *enable* is both enables:
{calls}"""
_COLUMNS = (
    "| row | fault | mode | noticed by | within [samples] | safe state | alarm "
    "| recovery (at most) |\n"
    "|---|---|---|---|---|---|---|---|"
)
