# SPDX-License-Identifier: Apache-2.0
"""All rows, and the page docs/faults.md made from them."""

from __future__ import annotations

from collections.abc import Iterable

from . import (
    rows_bus,
    rows_commands,
    rows_drive,
    rows_foreign_frames,
    rows_intruders,
    rows_machine,
    rows_nodes,
    rows_operator,
    rows_patient,
    rows_sensors,
    rows_storms,
    rows_therapy,
)
from .measures import LARGEST_STEP
from .row import EITHER, GOES_ON, OFF, SAFE_STATES, VERTICAL_OFF, Row

_MODULES = (
    rows_nodes,
    rows_bus,
    rows_sensors,
    rows_drive,
    rows_commands,
    rows_operator,
    rows_patient,
    rows_machine,
    rows_intruders,
    rows_foreign_frames,
    rows_storms,
    rows_therapy,
)
PAGE = "docs/faults.md"


def all_rows() -> list[Row]:
    """Return all rows in the order of their execution."""
    return [row for module in _MODULES for row in module.rows()]


def chosen(groups: Iterable[str] = (), names: Iterable[str] = ()) -> list[Row]:
    """Return the rows of these groups whose name contains one of `names`; empty = no filter.

    Raises ValueError naming the unknown group or name.
    """
    rows, groups, names = all_rows(), list(groups), list(names)
    known = list(dict.fromkeys(row.group for row in rows))
    for group in groups:
        if group not in known:
            raise ValueError(f"no group {group!r}; there are {', '.join(known)}")
    for name in names:
        if not any(name in row.name for row in rows):
            raise ValueError(f"no row with {name!r} in its name; `faults --list` lists all rows")
    found = [
        row
        for row in rows
        if (not groups or row.group in groups)
        and (not names or any(name in row.name for name in names))
    ]
    if not found:
        raise ValueError("no row of these groups has such a name; `faults --list` lists all rows")
    return found


def page() -> str:
    """Return docs/faults.md."""
    rows = all_rows()
    lines = [_HEAD.format(count=len(rows), **_FIGURES)]
    for group in dict.fromkeys(row.group for row in rows):
        members = [row for row in rows if row.group == group]
        lines += ["", f"## {group.capitalize()} ({len(members)} rows)", "", _COLUMNS]
        lines += [_line(row) for row in members]
    return "\n".join(lines) + "\n"


def _line(row: Row) -> str:
    within = "" if row.safe == GOES_ON else f"{row.within} / {row.plane_within or '–'}"
    alarm = row.alarm.text if row.alarm else _NO_ALARM[row.safe]
    cells = (
        f"`{row.name}`", row.fault, row.mode_name, row.noticed_by, within, row.safe, alarm,
        row.recovery,
    )  # fmt: skip
    return "| " + " | ".join(str(cell).replace("|", "\\|") for cell in cells) + " |"


_NO_ALARM = {
    GOES_ON: "none",
    EITHER: "none while it continues, else any reason in safety_state",
    OFF: "none: requested by the operator",
    VERTICAL_OFF: "none: requested by the operator",
}
_FIGURES = {
    "step": LARGEST_STEP,
    "states": "\n".join(f"- *{name}*: {text}" for name, text in SAFE_STATES.items()),
}
_HEAD = """<!-- made by `faults --table`; do not edit -->
# Fault catalogue

`make faults` carries out these {count} rows on running graphs with the simulated rig, in simulated
time at 1 kHz (the plane at 500 Hz) and with the limits of the safety contract, while the patient
moves the handle. The nodes of the vertical axis run as one process (`module`), or separately in the
rows about one of them or about a topic between them. Each row can fail for a reason of its own;
unit tests cover what all nodes, modes, fields or parameters have in common.

If the robot must stop, a row passes when

- the rig's motors (`sim/truth`) give no torque after the row's time,
- the alarm of the row appears on `/diagnostics` and in `safety_state`,
- no torque returns by itself after the cause has gone and all nodes are active again,
- the recovery leads to operation without a restart of the graph and needs no service that the row
  does not name, and
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
{states}"""
_COLUMNS = (
    "| row | fault | mode | noticed by | within [samples] | safe state | alarm | recovery |\n"
    "|---|---|---|---|---|---|---|---|"
)
