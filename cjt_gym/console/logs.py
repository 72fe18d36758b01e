"""Records and logs as commands read them: with the joint that they name."""

from __future__ import annotations

from pathlib import Path

from cjt_gym.joint import load_joint_file
from cjt_gym.records import Record, read_record
from cjt_gym.records.files import gear_ratio_of


def read_own(log: str | Path, joint: str | None = None) -> Record:
    """Return a record, with the gear ratio of its joint where its mapping gives none.

    Args:
        log: The record or log.
        joint: The joint to take it from where the log names none that is at hand.
    """
    n = gear_ratio_of(log)
    if n is None and joint is not None:
        n = load_joint_file(joint).gear_ratio
    return read_record(log, n=n)
