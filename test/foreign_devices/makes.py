# SPDX-License-Identifier: Apache-2.0
"""What the objects of a make are, from public files and manuals, and not from `params/devices`.

Each make is our EDS file with what is otherwise there. `params/devices` was written from the same
sources, so a number that was misread there is missing here: see `test_makes.py`.
"""

from __future__ import annotations

from typing import NamedTuple

import canopen
from application import EDS, variables
from canopen.objectdictionary import ODRecord, ODVariable, datatypes
from power_drive import STANDARD, Torque

U16, U32, I16, I32 = (
    datatypes.UNSIGNED16, datatypes.UNSIGNED32, datatypes.INTEGER16, datatypes.INTEGER32,
)  # fmt: skip
Key = tuple[int, int]


class Make(NamedTuple):
    """What is otherwise than in an EDS file of ours.

    absent, read_only: objects or entries; None as sub-index: the whole object. added: key -> data
    type, value. values: key -> value. identifiers: index of a PDO -> its identifier without the
    node id. unmappable: objects that no PDO takes. torque: how it is told its torque.
    """

    file: str
    source: str
    absent: tuple[tuple[int, int | None], ...] = ()
    read_only: tuple[Key, ...] = ()
    added: dict[Key, tuple[int, int]] = {}
    values: dict[Key, int] = {}
    identifiers: dict[int, int] = {}
    unmappable: frozenset[int] = frozenset()
    torque: Torque = STANDARD


def _every(*subindexes: int, first: int, count: int = 4) -> tuple[tuple[int, int], ...]:
    return tuple((first + i, subindex) for i in range(count) for subindex in subindexes)


def _identifiers(receive: list[int], transmit: list[int]) -> dict[int, int]:
    return dict(enumerate(receive, start=0x1400)) | dict(enumerate(transmit, start=0x1800))


_NO_DEADLINE = _every(5, first=0x1400)
_NO_EVENT_TIMER = _every(5, first=0x1800)
#: 0.42 Nm in mNm, and in the micro-Nm of maxon.
_MILLI, _MICRO = 420, 420_000

MAKES = {
    "generic_402": Make("drive.eds", "CiA 402", values={(0x6076, 0): _MILLI}),
    "epos4": Make(
        "drive.eds",
        "EDS of the EPOS4 50/5 in YamamotoSoya/maxon_epos4compact50-5can_ros2",
        absent=(
            *_NO_DEADLINE, *_NO_EVENT_TIMER, (0x605D, None), (0x6072, None), (0x6074, None),
            (0x6075, None), (0x6078, None), (0x6079, None), (0x6087, None), (0x6088, None),
            (0x608F, None),
        ),
        read_only=((0x1005, 0),),
        added={(0x3001, 1): (U32, 5000), (0x3001, 2): (U32, 15_000)},
        values={(0x1018, 1): 0xFB, (0x6007, 0): 3, (0x605A, 0): 6, (0x605E, 0): 2,
                (0x6076, 0): _MICRO, (0x6502, 0): 0x3A5, (0x1801, 3): 10},
        identifiers=_identifiers([0x200, 0x80000300, 0x80000400, 0x80000500],
                                 [0x40000180, 0xC0000280, 0xC0000380, 0xC0000480]),
    ),
    "elmo_gold": Make(
        "drive.eds",
        "DCF of a Gold drive in ipa320/cob_robots",
        absent=(*_NO_DEADLINE, (0x1005, None), (0x6088, None), (0x6402, None)),
        added={(0x1006, 0): (U32, 0), (0x2F75, 0): (U16, 1)},
        values={(0x1018, 1): 0x9A, (0x6007, 0): 1, (0x605A, 0): 2, (0x605E, 0): 2,
                (0x6076, 0): _MILLI},
        identifiers=_identifiers([0x200, 0x300, 0x400, 0x500], [0x180, 0x280, 0x380, 0x480]),
        unmappable=frozenset({0x603F}),
    ),
    "elmo_simpliq": Make(
        "drive.eds",
        "DCF of a SimplIQ drive in ipa320/cob_robots",
        absent=(*_NO_DEADLINE, (0x6079, None), (0x60B2, None)),
        read_only=((0x1005, 0), *_every(1, first=0x1400), *_every(1, first=0x1800), (0x6502, 0)),
        added={(0x1006, 0): (U32, 0)},
        values={(0x1018, 1): 0x9A, (0x605A, 0): 2, (0x605E, 0): 2, (0x6076, 0): _MILLI,
                (0x6502, 0): 0x6D},
        identifiers=_identifiers([0x200, 0x300, 0x400, 0x500],
                                 [0x40000180, 0x40000280, 0x40000380, 0x40000480]),
        unmappable=frozenset({0x603F, 0x6061}),
    ),
    "ingenia": Make(
        "drive.eds",
        "e35.eds among the examples of christiansandberg/canopen",
        absent=(
            *_NO_DEADLINE, (0x1016, None), (0x1029, None), (0x6007, None), (0x605A, None),
            (0x605B, None), (0x605C, None), (0x605D, None), (0x605E, None),
        ),
        added={(0x1006, 0): (U32, 0)},
        values={(0x6076, 0): _MILLI, (0x6502, 0): 0x303EF, (0x1801, 3): 1000},
        identifiers=_identifiers([0x200, 0x300, 0x400, 0x500],
                                 [0x40000180, 0x40000280, 0x40000380, 0x40000480]),
    ),
    "epos2": Make(
        "drive.eds",
        "EPOS2 firmware specification: current mode -3, 2030, 6078, motor data 6410",
        absent=(
            *_NO_DEADLINE, *_NO_EVENT_TIMER, (0x6071, None), (0x6072, None), (0x6076, None),
            (0x6077, None), (0x6087, None), (0x60B2, None),
        ),
        added={(0x2030, 0): (I16, 0), (0x6410, 1): (U16, 5000), (0x6410, 2): (U16, 10_000)},
        values={(0x1018, 1): 0xFB},
        torque=Torque((0x2030, 0), (0x6078, 0), (0x6410, 2), modes=(-3,)),
    ),
    "ipos": Make(
        "drive.eds",
        "TechnosoftIpos in roboticslab-uc3m/yarp-devices; iPOS manual P091.063, which it cites",
        absent=(
            *_NO_DEADLINE, (0x6071, None), (0x6072, None), (0x6076, None), (0x6077, None),
            (0x6078, None), (0x6087, None), (0x60B2, None),
        ),
        read_only=((0x207E, 0),),
        added={(0x201C, 0): (I32, 0), (0x201D, 0): (U16, 0), (0x207E, 0): (I16, 0),
               (0x207F, 0): (U16, 0)},
        torque=Torque((0x201C, 0), (0x207E, 0), (0, 0), 16, (-5,), 0x0010, {(0x201D, 0): 1}, True),
    ),
    "kinco": Make(
        "drive.eds",
        "KincoDrive in the public program CANOpenRobotController",
        absent=(
            *_NO_DEADLINE, (0x603F, None), (0x6071, None), (0x6076, None), (0x6077, None),
            (0x6087, None), (0x60B2, None),
        ),
        added={(0x60F6, 8): (I16, 0)},
        torque=Torque((0x60F6, 8), (0x6078, 0), modes=(4,)),
    ),
    "generic_406": Make("encoder.eds", "CiA 406"),
    "sick_ahm36": Make(
        "encoder.eds", "operating instructions AHS/AHM36 CANopen", values={(0x1018, 1): 0x01000056}
    ),
    "baumer_rotary": Make(
        "encoder.eds", "manual of Baumer's G and BM encoders", absent=((0x6200, None),)
    ),
    "baumer_linear": Make(
        "encoder.eds",
        "manual BMMS M75",
        absent=((0x6200, None), (0x6502, None)),
        read_only=((0x6002, 0),),
        values={(0x6501, 0): 1000, (0x1800, 2): 255, (0x1800, 5): 100, (0x1801, 2): 1},
    ),
}  # fmt: skip


def dictionary(name: str, node_id: int) -> canopen.ObjectDictionary:
    """Return the objects of a make."""
    make = MAKES[name]
    objects = canopen.import_od(str(EDS / make.file), node_id)
    for index, subindex in make.absent:
        if subindex is None:
            del objects[index]
        elif index in objects.indices:
            objects.indices[index].subindices.pop(subindex, None)
    for (index, subindex), (kind, value) in make.added.items():
        _add(objects, index, subindex, kind, value)
    for variable in variables(objects):
        key = variable.index, variable.subindex
        if key in make.read_only:
            variable.access_type = "ro"
        variable.default = make.values.get(key, variable.default)
        if key[1] == 1 and key[0] in make.identifiers:
            variable.default = make.identifiers[key[0]] + node_id
    return objects


def _add(
    objects: canopen.ObjectDictionary, index: int, subindex: int, kind: int, value: int
) -> None:
    variable = ODVariable(f"{index:04X}:{subindex:02X}", index, subindex)
    variable.data_type, variable.access_type, variable.default = kind, "rw", value
    if not subindex:
        objects.add_object(variable)
        return
    if index not in objects.indices:
        objects.add_object(ODRecord(f"{index:04X}", index))
    objects[index].add_member(variable)
