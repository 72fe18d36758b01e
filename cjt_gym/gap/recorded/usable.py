"""Whether records can be diagnosed together."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from cjt_gym.errors import ConfigurationError
from cjt_gym.records import Record


def check_one_joint(records: Sequence[Record]) -> None:
    """Raise ConfigurationError where records name different joints."""
    files = {str(r.joint_file): r.owner for r in records if r.joint_file is not None}
    contents = {Path(f).read_bytes() if Path(f).is_file() else f for f in files}
    if len(contents) > 1:
        (one, its), (other, theirs), *_ = files.items()
        raise ConfigurationError(
            f"The records must be of one joint, but {its} names {one} and {theirs} names {other}. "
            "Diagnose them apart, or give the joint that all of them share (--joint)."
        )
