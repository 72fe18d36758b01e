"""Held-out records of another joint: what explains the fitted ones does not hold for them."""

from __future__ import annotations

import pytest

from cjt_gym.gap.horizons.case import late, make_case
from cjt_gym.gap.horizons.contradiction import contradicted
from cjt_gym.gap.horizons.model import Draft, drafted
from cjt_gym.gap.horizons.windows import relative
from cjt_gym.joint import get_structure
from tests.gap.horizons.rotor import DAMPING, DRY, INERTIA, datasheet, record


@pytest.mark.parametrize(("dry", "another"), [(DRY, False), (4.0 * DRY, True)])
def test_held_out_records_of_another_joint_are_told(dry: float, another: bool) -> None:
    made = make_case([record()], [record(dry=dry, seed=1)], datasheet(), get_structure("rigid"))
    case = late(made, 0.5)
    draft = Draft(case.joint.file, {})
    draft.row("inertia").update(I_m=INERTIA, I_g=0.0)
    draft.row("damping").update(d_m=DAMPING, d_g=0.0, d_l=0.0)
    draft.row("coulomb")["d_cm"] = DRY
    draft.smooth(0.0)
    joints = {"datasheet": case.joint, "found": drafted(case.joint, draft)}
    held = {name: relative(case.test, case.test.errors(joint)) for name, joint in joints.items()}
    said = contradicted(case, joints, held)
    assert ("they may be of another joint" in said) == another
