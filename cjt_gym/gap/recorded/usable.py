"""Whether records can be diagnosed, and together."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cjt_gym.errors import ConfigurationError, RecordError
from cjt_gym.records import Record

COMMANDING = ("i", "i_cmd", "tau_m", "tau_cmd")
"""Channels of which the stages need at least one."""
PUSHING = (*COMMANDING, "v", "tau", "tau_l")
"""Channels of which one must change, or nothing tells what moves the joint."""


def check_one_joint(records: Sequence[Record]) -> None:
    """Raise ConfigurationError where records name different joints."""
    files = {str(r.joint_file): r.owner for r in records if r.joint_file is not None}
    texts = {Path(f).read_text() if Path(f).is_file() else f for f in files}
    if len(texts) > 1:
        (one, its), (other, theirs), *_ = files.items()
        raise ConfigurationError(
            f"The records must be of one joint, but {its} names {one} and {theirs} names {other}. "
            "Diagnose them apart, or give the joint that all of them share (--joint)."
        )


def check_driven(records: Sequence[Record]) -> None:
    """Raise RecordError where what drives a joint never changes and nothing else pushes it."""
    seen = [(r, n) for r in records for n in PUSHING if n in r]
    if seen and all(np.nanmax(r[n]) == np.nanmin(r[n]) for r, n in seen):
        record, name = seen[0]
        raise RecordError(
            f"{name} of {record.owner} never changes, so that nothing tells what it does to the "
            "joint. Record motion under a torque that varies."
        )
