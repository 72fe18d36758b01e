"""Records of several joints: the part of one."""

from __future__ import annotations

from dataclasses import replace

from cjt_gym.errors import RecordError, unknown_name
from cjt_gym.records.columns import JOINT_MARK
from cjt_gym.records.record import Record


def joints_of(record: Record) -> tuple[str, ...]:
    """Return the names of the joints that a record holds, none where it holds only one."""
    names = (name.rpartition(JOINT_MARK)[0] for name in record.columns)
    return tuple(dict.fromkeys(name for name in names if name))


def part_of(record: Record, name: str) -> Record:
    """Return the part of one joint, see `one_joint`; of a record of one joint all of it."""
    return one_joint(record, name) if joints_of(record) else record


def one_joint(record: Record, name: str) -> Record:
    """Return the part of one joint, as a record of its own.

    Raises:
        RecordError: It holds no such joint.
    """
    known = joints_of(record)
    if name not in known:
        told = str(unknown_name(f"joint of {record.owner}", name, known))
        raise RecordError(told if known else f"{record.owner} is a record of one joint.")
    mark = name + JOINT_MARK
    columns = {k.removeprefix(mark): v for k, v in record.columns.items() if k.startswith(mark)}
    units = {k.removeprefix(mark): v for k, v in record.units.items() if k.startswith(mark)}
    sensors = {k.removeprefix(mark): v for k, v in record.sensors.items() if k.startswith(mark)}
    facts = {k: v for k, v in record.provenance.items() if k != "joints"}
    own = dict(record.provenance.get("joints", {}).get(name, {}))
    late = record.provenance.get("delays_s", {})
    facts |= {"delays_s": late[name]} if name in late else {}
    return replace(
        record,
        columns={"t": record.t, **columns},
        units={"t": "s", **units},
        sensors=sensors,
        joint=own.pop("joint", None),
        structure=own.pop("structure", None),
        parameter_hash=own.pop("parameter_hash", None),
        provenance=facts | own,
    )
