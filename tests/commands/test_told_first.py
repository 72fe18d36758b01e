"""What the terminal tells of a record before anything else."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from cjt_gym.commands.diagnose import MOST_REPAIRS, _of_the_record
from cjt_gym.records import Repair


def test_what_makes_a_diagnosis_wrong_is_told_before_what_was_mended() -> None:
    mended = [Repair("missing", f"q_{k}", 9, True, f"q_{k}: 9 missing.") for k in range(9)]
    turned = Repair("sign", "q_m", 1, True, "q_m: sign turned.")
    fault = "Something else moves it, or the sign of i_cmd is wrong."
    found: Any = SimpleNamespace(
        examination=SimpleNamespace(faults=(mended[0].text, fault, mended[1].text))
    )
    lines = _of_the_record(found, [*mended, turned]).splitlines()
    assert lines[:2] == [f"record: {turned.text}", f"record: {fault}"]
    assert lines[2] == "record: q_0: 9 missing."
    assert len(lines) == MOST_REPAIRS + 1
    assert lines[-1] == f"record: and {len(mended) + 2 - MOST_REPAIRS} more in the report."
