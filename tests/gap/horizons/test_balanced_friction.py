"""Dry friction that all but balances the one torque of a log."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cjt_gym.gap import diagnose
from cjt_gym.gap.horizons.fitting.balanced_friction import is_delicate, limited
from cjt_gym.gap.horizons.fitting.terms import candidates, scales_of
from cjt_gym.gap.horizons.prediction.case import as_joint, make_case
from cjt_gym.joint import JointFile, get_structure
from cjt_gym.joint.files.quantity import Quantity
from cjt_gym.records import Record
from tests.gap.horizons.rotor import DT, datasheet

RIGID, TORQUE, SPEED = get_structure("rigid"), 0.4, 0.05


def steady(*levels: float, dry: float = 0.2) -> Record:
    """Return a log of a rotor that is driven by torques in turn, 4 s each."""
    drive = np.repeat(levels, round(4.0 / DT))
    speed = SPEED * np.sign(drive) * (np.abs(drive) - dry) / (TORQUE - dry)
    turned = DT * np.cumsum(speed)
    scatter = np.random.default_rng(1).normal(0.0, 1e-5, len(drive))
    columns = {"t": DT * np.arange(len(drive)), "i": drive, "q_m": turned + scatter}
    return Record(columns, {"t": "s", "i": "A", "q_m": "rad"}, structure="rigid")


def with_friction(dry: float) -> JointFile:
    """Return a joint that goes at the steady speed under the torque."""
    file = datasheet(1.0)
    rows = {"d_cm": Quantity(dry, "N m", "test"), "dq_0": Quantity(0.0, "rad/s", "test")}
    damping = Quantity((TORQUE - dry) / SPEED, "N m s/rad", "test")
    return replace(file, effects={"coulomb": rows}, parameters=file.parameters.replace(d_m=damping))


@pytest.mark.parametrize(
    ("levels", "dry", "delicate"),
    [((TORQUE,), 0.5, False), ((TORQUE,), 0.999, True), ((TORQUE, 0.3), 0.999, False)],
)
def test_friction_that_takes_all_of_one_torque_is_delicate(
    levels: tuple[float, ...], dry: float, delicate: bool
) -> None:
    case = make_case([steady(*levels)], [], datasheet(1.0), RIGID)
    assert is_delicate(case.fit, as_joint(with_friction(dry * TORQUE), case)) == delicate


def test_so_is_friction_that_takes_all_of_one_torque_in_each_direction() -> None:
    back = 0.9 * TORQUE
    case = make_case([steady(TORQUE, -back)], [], datasheet(1.0), RIGID)
    rows = {"d_cm": 0.999 * TORQUE, "d_cm_n": 0.999 * back}
    file = replace(
        with_friction(0.999 * TORQUE),
        effects={
            "coulomb_asym": {n: Quantity(x, "N m", "test") for n, x in rows.items()}
            | {"dq_0": Quantity(0.0, "rad/s", "test")}
        },
    )
    assert is_delicate(case.fit, as_joint(file, case))
    others = make_case([steady(TORQUE, 0.3, -back)], [], datasheet(1.0), RIGID)
    assert not is_delicate(others.fit, as_joint(file, others))


def test_its_share_is_limited_then() -> None:
    case = make_case([steady(TORQUE)], [], datasheet(1.0), RIGID)
    scales = scales_of(case.joint, case.logs)
    terms = limited(candidates(case.joint, scales, case.logs), scales.peak)
    assert not {"torque_offset", "torque_constant"} & {term.name for term in terms}
    dry = [n.high for term in terms for n in term.numbers if n.symbol == "d_cm"]
    assert dry
    assert max(dry) < 0.7 * TORQUE


def test_twice_the_torque_does_not_move_the_joint_found_as_never_before() -> None:
    found = diagnose(steady(TORQUE), datasheet(1.0), "rigid").joint
    case = make_case([steady(TORQUE)], [], datasheet(1.0), RIGID)
    assert not is_delicate(case.fit, as_joint(found, case))
