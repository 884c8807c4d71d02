# SPDX-License-Identifier: Apache-2.0
"""Settings of the encoder, and its configuration over SDO (CiA 406, thesis 3.1.8)."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from ..can_io.load import Traffic
from ..geometry import COUNTS_PER_TURN
from ..profiles import GENERIC_406, EncoderProfile
from ..settings import Setting
from . import pdo
from .errors import NotConfigured, Refused, cure
from .motion import FULL_RANGE
from .sdo import Sdo

PROFILE = 406
#: TPDO1: position [counts].
POSITION = (pdo.Entry(0x6004, 0, 32),)

# Object 6000, operating parameters.
_CODE_SEQUENCE_BIT = 0x0001
_SCALING_BIT = 0x0004
_STEP_TOLERANCE = 1e-3

OPERATING_STATUS, ALARM, WARNING = 0x6500, 0x6503, 0x6505
#: What is asked for now and then; an encoder need not have it.
SLOW_STATUS = (OPERATING_STATUS, ALARM, WARNING)
#: Object 6503, alarms; bits 12 to 15 are the manufacturer's.
ALARMS = {0: "position error", 1: "commissioning diagnostics"}
#: Object 6505, warnings.
WARNINGS = {
    0: "frequency exceeded",
    1: "light control reserve reached",
    2: "CPU watchdog",
    3: "operating time limit",
    4: "battery charge too low",
    5: "reference point not reached",
}


class EncoderSettings(NamedTuple):
    """The encoder on the screw's motor: its node id, its counting, the unit of a count."""

    node_id: Annotated[int, Setting("CANopen node id", "", 1, 127)] = 2
    profile: Annotated[
        str, Setting("make of the encoder: a file of params/devices, or the path of one of yours")
    ] = GENERIC_406
    rate: Annotated[float, Setting("ticks (SYNCs) per second", "Hz", 1.0, 4000.0)] = 1000.0
    counts_per_turn: Annotated[
        int, Setting("counts per turn of the screw, object 6001", "counts", 4, 2**31)
    ] = COUNTS_PER_TURN
    measuring_range: Annotated[
        int, Setting("counts after which the position wraps, object 6002; 0 = unchanged", "counts",
                     0, FULL_RANGE - 1)
    ] = 0
    code_sequence: Annotated[
        int, Setting("counting direction in the device, object 6000 bit 0", choices=(0, 1))
    ] = 0
    direction: Annotated[
        int, Setting("1 when the count rises as the nut goes up, else -1", choices=(1, -1))
    ] = 1
    home_position: Annotated[
        float, Setting("height of the reference mark above the bottom of travel", "m", -1.0, 1.0)
    ] = 0.0
    home_speed_limit: Annotated[
        float, Setting("homing is refused while the nut moves faster", "m/s", 0.0, 1.0)
    ] = 0.005
    home_shift: Annotated[
        float, Setting("homing needs a second call when it moves the origin further", "m",
                       0.0, 1.0)
    ] = 0.005
    velocity_cutoff: Annotated[
        float, Setting("cutoff of the velocity filter", "Hz", 0.1, 1000.0)
    ] = 30.0
    vendor_id: Annotated[int, Setting("vendor expected, object 1018:01; 0 = any", "", 0)] = 0
    product_code: Annotated[int, Setting("product expected, object 1018:02; 0 = any", "", 0)] = 0
    sdo_timeout: Annotated[
        float, Setting("time limit of one SDO try; there are two", "s", 0.01, 10.0)
    ] = 0.5
    listen: Annotated[
        float, Setting("listen for another SYNC producer before configuring", "s", 0.0, 2.0)
    ] = 0.1

    @property
    def claims(self) -> tuple[str, ...]:
        """What only one process of a machine may have on a bus (`locks.lock_device`)."""
        return (f"encoder node {self.node_id}",)


def position_pdo(settings: EncoderSettings, number: int = 1) -> pdo.Pdo:
    """Return a TPDO with object 6004 at every SYNC. number: 1 for TPDO1."""
    cob_id = 0x080 + 0x100 * number + settings.node_id
    return pdo.Pdo(number, True, cob_id, pdo.ON_EVERY_SYNC, POSITION)


def encoder_traffic(settings: EncoderSettings, sync_producer: bool = True) -> list[Traffic]:
    """Return the frames of this device for the bus load, SYNC included where we send it."""
    frames = [Traffic("encoder TPDO1", position_pdo(settings).size, settings.rate)]
    return [Traffic("SYNC", 0, settings.rate), *frames] if sync_producer else frames


def set_up(sdo: Sdo, settings: EncoderSettings, profile: EncoderProfile, step: float) -> int:
    """Write what the settings say and read it back; the device is in PRE-OPERATIONAL.

    step: of one count at the nut [m]. Returns the range at which the position wraps [counts].
    Raises NotAnswering, Refused, NotConfigured.
    """
    if profile.scaling:
        wrap = _scale(sdo, settings)
    elif profile.linear:
        wrap = _linear_range(sdo, step)
    else:
        wrap = _physical_range(sdo, settings, profile.scaling_bit)
    if not settings.counts_per_turn <= wrap <= FULL_RANGE:
        # Within a period the nut could pass half of a shorter range, and turns would be miscounted.
        raise NotConfigured(
            f"{sdo.label} wraps after {wrap} counts (object 6002); {settings.counts_per_turn} "
            "(counts_per_turn) to 2^32 are wanted: set measuring_range, or use an encoder that can"
        )
    position = position_pdo(settings, profile.pdo)
    pdo.disable_unused(sdo, (position,))
    pdo.configure(sdo, position)
    return wrap


def _scale(sdo: Sdo, settings: EncoderSettings) -> int:
    """Set direction and resolution; 6001 and 6002 act only with the scaling bit of 6000."""
    parameters = sdo.unsigned(0x6000)
    wanted = parameters & ~_CODE_SEQUENCE_BIT | settings.code_sequence | _SCALING_BIT
    try:
        _set_if_other(sdo, 0x6000, wanted, 2)
    except (Refused, NotConfigured):
        return _unscaled(sdo, settings)
    _set_if_other(sdo, 0x6001, settings.counts_per_turn, 4, "counts_per_turn")
    if settings.measuring_range:
        _set_if_other(sdo, 0x6002, settings.measuring_range, 4, "measuring_range")
    # 2^32 does not fit into the object: a device that uses the whole range shows 0.
    return sdo.unsigned(0x6002) or FULL_RANGE


def _unscaled(sdo: Sdo, settings: EncoderSettings) -> int:
    """Accept an encoder that cannot scale, if its resolution is that of the settings."""
    direction = sdo.unsigned(0x6000) & ~_SCALING_BIT & ~_CODE_SEQUENCE_BIT | settings.code_sequence
    _set_if_other(sdo, 0x6000, direction, 2, "code_sequence")
    return _turns(sdo, settings, sdo.unsigned(0x6501))


def _physical_range(sdo: Sdo, settings: EncoderSettings, scaling_bit: int) -> int:
    """Write nothing: compare what the encoder counts with the settings; return where it wraps."""
    if scaling_bit >= 0 and sdo.unsigned(0x6000) >> scaling_bit & 1:
        _compare(sdo, settings, sdo.unsigned(0x6001), "6001, its scaling is on")
        return sdo.unsigned(0x6002) or FULL_RANGE
    return _turns(sdo, settings, sdo.unsigned(0x6501))


def _linear_range(sdo: Sdo, step: float) -> int:
    """Write nothing; 6501 is the length of a step [nm]. It does not wrap within its travel."""
    found = sdo.unsigned(0x6501) * 1e-9
    if abs(found - step) > _STEP_TOLERANCE * step:
        raise NotConfigured(
            f"{sdo.label} has steps of {found * 1e6:g} um (object 6501); lead / counts_per_turn is "
            f"{step * 1e6:g} um: set counts_per_turn to lead / step"
        )
    return FULL_RANGE


def _turns(sdo: Sdo, settings: EncoderSettings, per_turn: int) -> int:
    """Return the physical range [counts] of an encoder that counts `per_turn`."""
    _compare(sdo, settings, per_turn, "6501, it does not scale")
    try:
        turns = sdo.unsigned(0x6502)
    except Refused:
        return FULL_RANGE  # an incremental encoder has no number of turns
    return per_turn * turns or FULL_RANGE


def _compare(sdo: Sdo, settings: EncoderSettings, per_turn: int, source: str) -> None:
    if per_turn != settings.counts_per_turn:
        raise NotConfigured(
            f"{sdo.label} counts {per_turn} per turn (object {source}); counts_per_turn is "
            f"{settings.counts_per_turn}: set it to {per_turn}"
        )


def _set_if_other(sdo: Sdo, index: int, value: int, size: int, parameter: str = "") -> None:
    """Write a value only if it differs: some encoders store each write in EEPROM.

    parameter: where the value comes from; a refused value is told with it.
    """
    if sdo.unsigned(index) == value:
        return
    try:
        sdo.set(index, 0, value, size)
    except (Refused, NotConfigured) as error:
        if way_out := cure(error, parameter):
            raise NotConfigured(f"{error}; {way_out}") from error
        raise
