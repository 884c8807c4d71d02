# SPDX-License-Identifier: Apache-2.0
"""Settings of a CiA 402 drive."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from ..geometry import COUNTS_PER_TURN
from ..profiles import GENERIC_402, GUARDS, MASTER_HEARTBEAT, DriveProfile
from ..settings import Setting

COAST, BRAKE = "coast", "brake"
WAIVABLE = tuple(name for name in GUARDS if name != MASTER_HEARTBEAT)
_BEATS_PER_TIMEOUT = 4


class DriveSettings(NamedTuple):
    """One drive: its node id, its units, and its guards for a program that stops."""

    node_id: Annotated[int, Setting("CANopen node id", "", 1, 127)] = 1
    master_id: Annotated[int, Setting("node id of our own heartbeat", "", 1, 127)] = 112
    rate: Annotated[float, Setting("ticks (torque commands) per second", "Hz", 1.0, 4000.0)] = (
        1000.0
    )
    sync_divider: Annotated[
        int, Setting("statusword at every n-th SYNC; 2 where the SYNC is twice as fast", "", 1, 240)
    ] = 1
    rated_torque: Annotated[
        float, Setting("rated torque, checked against object 6076", "Nm", 1e-4, 1e4)
    ] = 0.42
    rated_command: Annotated[
        int, Setting("torque command at the rated torque (a current, for instance), for a make "
                     "whose profile asks for it; else 0", "", 0, 32767)
    ] = 0
    max_torque: Annotated[
        float, Setting("largest torque written, also the drive's own limit, object 6072", "Nm",
                       0.0, 1e5)
    ] = 1.6
    excess_torque: Annotated[
        float, Setting("torque (6077) in excess of the command that stops the drive",
                       "of rated", 0.05, 100.0)
    ] = 0.25
    lasting_torque: Annotated[
        float, Setting("torque (6077) in excess of the command that is tolerated for long",
                       "of rated", 0.005, 10.0)
    ] = 0.05
    counts_per_turn: Annotated[
        int, Setting("counts of the position (6064) per turn of the screw or the joint", "counts",
                     4, 2**31)
    ] = COUNTS_PER_TURN
    direction: Annotated[
        int, Setting("1 when the drive's positive direction is the robot's, else -1",
                     choices=(1, -1))
    ] = 1
    stop_reaction: Annotated[
        str, Setting("reaction to a stop: coast lets the patient move out, and a hanging arm fall; "
                     "brake does so after the drive's ramp",
                     choices=(COAST, BRAKE))
    ] = COAST
    profile: Annotated[
        str, Setting("make of the drive: a file of params/devices, or the path of one of yours")
    ] = GENERIC_402
    waived: Annotated[
        str, Setting("DANGER: guards that the drive may lack, by name, with commas between; of "
                     + ", ".join(WAIVABLE))
    ] = ""
    allow_no_heartbeat: Annotated[
        bool, Setting("DANGER: enable a drive that does not watch our heartbeat (1016) and goes "
                      "on when this program hangs or the cable breaks")
    ] = False
    heartbeat_period: Annotated[
        float, Setting("time between our heartbeats", "s", 0.001, 1.0)
    ] = 0.025
    heartbeat_timeout: Annotated[
        float, Setting("the drive stops this long after our last heartbeat, object 1016", "s",
                       0.002, 10.0)
    ] = 0.1
    command_timeout: Annotated[
        float, Setting("the drive stops this long after our last command, object 1400:05", "s",
                       0.001, 10.0)
    ] = 0.02
    drive_heartbeat: Annotated[
        float, Setting("time between the drive's heartbeats, object 1017", "s", 0.002, 10.0)
    ] = 0.05
    stale_periods: Annotated[
        float, Setting("age of the statusword beyond which the drive's state is unknown", "periods",
                       2.0, 1000.0)
    ] = 10.0
    enable_timeout: Annotated[
        float, Setting("enabling and recovering must succeed within", "s", 0.01, 60.0)
    ] = 2.0
    vendor_id: Annotated[int, Setting("vendor expected, object 1018:01; 0 = any", "", 0)] = 0
    product_code: Annotated[int, Setting("product expected, object 1018:02; 0 = any", "", 0)] = 0
    sdo_timeout: Annotated[
        float, Setting("time limit of one SDO try; there are two", "s", 0.01, 10.0)
    ] = 0.5
    listen: Annotated[
        float, Setting("listen for another master before configuring", "s", 0.0, 2.0)
    ] = 0.15

    @property
    def claims(self) -> tuple[str, ...]:
        """What only one process of a machine may have on a bus (`locks.lock_device`)."""
        return f"drive node {self.node_id}", f"master {self.master_id}"


_JOINT = DriveSettings(
    node_id=3, master_id=113, rate=500.0, rated_torque=10.0, max_torque=25.0, counts_per_turn=65536
)
JOINTS = {"shoulder": _JOINT, "elbow": _JOINT._replace(node_id=4)}
"""Prefix of the parameters of a planar drive -> its defaults."""
SHARED = ("master_id", "profile", "waived", "allow_no_heartbeat")
"""Settings that both planar drives share, beside the rate of their node."""


def waived_guards(settings: DriveSettings) -> frozenset[str]:
    """Return the guards that the operator's word replaces. Raises ValueError for another name."""
    names = [name.strip() for name in settings.waived.split(",") if name.strip()]
    for name in names:
        if name not in WAIVABLE:
            own = " has a switch of its own, allow_no_heartbeat" if name == MASTER_HEARTBEAT else ""
            raise ValueError(
                f"DriveSettings: waived: {name!r}{own}; there are {', '.join(WAIVABLE)}"
            )
    heartbeat = (MASTER_HEARTBEAT,) if settings.allow_no_heartbeat else ()
    return frozenset((*names, *heartbeat))


def adapted(settings: DriveSettings, profile: DriveProfile) -> DriveSettings:
    """Return the settings for a make that needs a shorter heartbeat in place of another guard."""
    if profile.heartbeat_timeout >= settings.heartbeat_timeout:
        return settings
    timeout = profile.heartbeat_timeout
    return settings._replace(
        heartbeat_timeout=timeout,
        heartbeat_period=min(settings.heartbeat_period, timeout / _BEATS_PER_TIMEOUT),
    )


def cross_checked(settings: DriveSettings) -> DriveSettings:
    """Return `settings` unchanged when they are consistent; else raise ValueError."""
    waived_guards(settings)
    for name, limit in (
        ("heartbeat_period", settings.heartbeat_timeout), ("drive_heartbeat", 10.0)
    ):
        if getattr(settings, name) >= limit:
            raise ValueError(
                f"DriveSettings: {name} = {getattr(settings, name)!r} s: less than {limit:g} s "
                "is wanted, or the guard trips by itself"
            )
    if settings.command_timeout * settings.rate <= 1.0:
        raise ValueError(
            f"DriveSettings: command_timeout = {settings.command_timeout!r} s: more than one "
            f"period of {settings.rate:g} Hz is wanted, or the guard trips by itself"
        )
    if settings.lasting_torque >= settings.excess_torque:
        raise ValueError(
            f"DriveSettings: lasting_torque = {settings.lasting_torque!r} of rated: less than "
            f"excess_torque = {settings.excess_torque:g} is wanted, which stops the drive at once"
        )
    if settings.master_id == settings.node_id:
        raise ValueError(
            f"DriveSettings: master_id = {settings.master_id}: another than the drive's node_id "
            "is wanted"
        )
    return settings
