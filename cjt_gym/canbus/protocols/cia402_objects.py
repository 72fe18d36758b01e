"""CiA 402 over CANopen: the table of objects, the data of the PDOs, and the states of a drive.

References:
    CiA 301, CANopen application layer (IEC 61800-7-201 and -301 hold what is public of CiA 402,
    the profile for drives): objects 0x1000 to 0x1A02 and 0x6007 to 0x6502.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any, Final

from canopen.objectdictionary import ObjectDictionary, ODRecord, ODVariable, datatypes

from cjt_gym.canbus.protocols.layout import Field, Layout


@dataclass(frozen=True)
class CanObject:
    """An object of the dictionary; without a default, the drive determines its value."""

    index: int
    sub: int
    name: str
    field: Field
    access: str = "ro"
    default: int | None = None

    @property
    def key(self) -> tuple[int, int]:
        """Index and subindex."""
        return self.index, self.sub


@dataclass(frozen=True)
class Pdo:
    """A process data object."""

    name: str  # its name in the standard, from the drive's point of view
    to_drive: bool  # whether the drive receives it
    cob_id: int  # identifier without the node's number
    parameters: int  # index of its communication parameters
    mapping: int  # index of its mapping
    objects: Sequence[tuple[int, int]]  # objects that it carries
    kind: int  # transmission type: 1 with every SYNC, 255 event-driven
    event_ms: int = 0  # event timer of type 255 [ms]

    @property
    def layout(self) -> Layout:
        """The data of the frame."""
        return Layout(tuple(OBJECTS[key].field for key in self.objects))


def _object(
    index: int,
    sub: int,
    name: str,
    kind: str,
    unit: str = "",
    access: str = "ro",
    default: int | None = None,
    text: str = "",
) -> CanObject:
    signed = kind[0] == "i"
    field = Field(name, int(kind[1:]), "int" if signed else "uint", unit=unit, text=text)
    return CanObject(index, sub, name, field, access, default)


def _pdo_objects(pdo: Pdo) -> list[CanObject]:
    at, to = pdo.parameters, pdo.mapping
    rows = [
        _object(at, 0, f"{pdo.name} parameters", "u8", access="const", default=5),
        _object(at, 1, f"{pdo.name} identifier", "u32", "", "rw", 1 << 31 | pdo.cob_id),
        _object(at, 2, f"{pdo.name} type", "u8", "", "rw", 255),
        _object(at, 5, f"{pdo.name} event timer", "u16", "ms", "rw", 0),
        _object(to, 0, f"{pdo.name} count", "u8", "", "rw", 0),
    ]
    return rows + [
        _object(to, sub, f"{pdo.name} object {sub}", "u32", "", "rw", 0) for sub in range(1, 5)
    ]


CST: Final = 10
"""Mode of operation: cyclic synchronous torque."""
PDOS: Final = (
    Pdo("RPDO 1", True, 0x200, 0x1400, 0x1600, ((0x6040, 0), (0x6071, 0)), 255),
    Pdo("TPDO 1", False, 0x180, 0x1800, 0x1A00, ((0x6041, 0), (0x6064, 0), (0x6077, 0)), 1),
    Pdo("TPDO 2", False, 0x280, 0x1801, 0x1A01, ((0x606C, 0), (0x6078, 0), (0x603F, 0)), 1),
    Pdo("TPDO 3", False, 0x380, 0x1802, 0x1A02, ((0x6079, 0), (0x6061, 0)), 255, 100),
)
OBJECTS: Final = {
    row.key: row
    for row in (
        _object(0x1000, 0, "Device type", "u32", "", "const", 0x00020192, "low half 402"),
        _object(0x1001, 0, "Error register", "u8"),
        _object(0x1016, 0, "Heartbeats that are watched", "u8", "", "const", 1),
        _object(
            0x1016, 1, "Heartbeat that is watched", "u32", "", "rw", 0, "node times 65536, plus ms"
        ),
        _object(0x1017, 0, "Producer heartbeat time", "u16", "ms", "rw", 0),
        _object(0x1018, 0, "Identity", "u8", "", "const", 1),
        _object(0x1018, 1, "Vendor", "u32", "", "const", 0),
        *(row for pdo in PDOS for row in _pdo_objects(pdo)),
        _object(0x6007, 0, "Abort connection option", "i16", "", "rw", 1, "1: fault"),
        _object(0x603F, 0, "Error code", "u16"),
        _object(0x6040, 0, "Controlword", "u16", "", "rw", 0),
        _object(0x6041, 0, "Statusword", "u16"),
        _object(0x6060, 0, "Mode of operation", "i8", "", "rw", 0, "10: cyclic synchronous torque"),
        _object(0x6061, 0, "Mode of operation shown", "i8"),
        _object(0x6064, 0, "Position", "i32", "increments"),
        _object(0x606C, 0, "Velocity", "i32", "velocity units"),
        _object(0x6071, 0, "Target torque", "i16", "rated/1000", "rw", 0),
        _object(0x6075, 0, "Rated current", "u32", "mA", "rw"),
        _object(0x6076, 0, "Rated torque", "u32", "mN m", "rw"),
        _object(0x6077, 0, "Torque", "i16", "rated/1000"),
        _object(0x6078, 0, "Current", "i16", "rated/1000"),
        _object(0x6079, 0, "DC link voltage", "u32", "mV"),
        _object(0x608F, 0, "Encoder resolution", "u8", "", "const", 2),
        _object(0x608F, 1, "Encoder increments", "u32", "increments", "rw"),
        _object(0x608F, 2, "Motor revolutions", "u32", "", "rw", 1),
        _object(0x6502, 0, "Modes that there are", "u32", "", "const", 1 << CST - 1),
    )
}
"""The objects that are used here, by index and subindex."""


class State:
    """Values of the statusword under the masks of :func:`state_of`."""

    NOT_READY: Final = 0x00
    SWITCH_ON_DISABLED: Final = 0x40
    READY: Final = 0x21
    SWITCHED_ON: Final = 0x23
    ENABLED: Final = 0x27
    QUICK_STOP: Final = 0x07
    FAULT_REACTION: Final = 0x0F
    FAULT: Final = 0x08


def state_of(statusword: int) -> int:
    """Return the :class:`State` that a statusword shows."""
    low = statusword & 0x4F
    if low in (State.NOT_READY, State.SWITCH_ON_DISABLED, State.FAULT, State.FAULT_REACTION):
        return low
    return statusword & 0x6F


def object_dictionary(node: int) -> Any:
    """Return the object dictionary of an emulated drive, for `canopen` and EDS files."""
    made: Any = ObjectDictionary()  # type: ignore[no-untyped-call]
    made.node_id = node
    for index, rows in groupby(OBJECTS.values(), lambda row: row.index):
        members = [_variable(row, node) for row in rows]
        if len(members) == 1:
            made.add_object(members[0])
            continue
        record = ODRecord(members[0].name, index)
        for member in members:
            record.add_member(member)
        made.add_object(record)
    return made


def _variable(row: CanObject, node: int) -> ODVariable:
    variable = ODVariable(row.name, row.index, row.sub)
    kind = "INTEGER" if row.field.kind == "int" else "UNSIGNED"
    variable.data_type = getattr(datatypes, f"{kind}{row.field.bits}")
    variable.access_type = row.access
    variable.default = row.default
    if row.default is not None and row.name.endswith("identifier"):
        variable.default = row.default + node
    return variable
