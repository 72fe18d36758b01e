"""Compliant joints for learning torque control: simulate, train, benchmark, diagnose.

Importing this package registers the environments and loads nothing else; names are loaded when
they are first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from cjt_gym.registry import register

if TYPE_CHECKING:
    from cjt_gym.gap import diagnose, examine
    from cjt_gym.joint import DRIVES, EFFECTS, STRUCTURES, Joint, joint_names, load_joint
    from cjt_gym.records import Record, read_log, read_record, record_names, write_record

    __version__: str

__all__ = [
    "DRIVES",
    "EFFECTS",
    "STRUCTURES",
    "Joint",
    "Record",
    "diagnose",
    "examine",
    "joint_names",
    "load_joint",
    "read_log",
    "read_record",
    "record_names",
    "write_record",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("cjt-gym")
    for home in ("records", "joint", "gap") if name in __all__ else ():  # each imports those before
        found = getattr(import_module(f"cjt_gym.{home}"), name, None)
        if found is not None:
            return found
    raise AttributeError(f"module 'cjt_gym' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])


register()
