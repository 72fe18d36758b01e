"""Windows that are predicted sixteen at once, beside the same ones by the general kernel."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cjt_gym.gap.horizons.prediction.case import make_case
from cjt_gym.gap.horizons.prediction.forward import CHANNELS, FEWEST, Forecast
from cjt_gym.joint import load_joint
from cjt_gym.records import Record

COGGING = {"f": (80.0, 480.0), "a": (0.5, 0.2), "b": (0.2, 0.1)}
DELAYED = {"coulomb": {}, "command_delay": {"delay": 3.3e-3}, "cogging": COGGING}
CASES: dict[str, tuple[str, dict[str, Any]]] = {
    "held, late and cogging": ("output_fixed_rigid_gearbox", DELAYED),
    "a free load": ("rigid_gearbox", {"coulomb_asym": {"d_cm": 2.0, "d_cm_n": 3.0}}),
    "one mass": ("rigid", {"coulomb": {"d_cm": 2.0, "dq_0": 0.0}}),
}


@pytest.mark.parametrize("case", CASES)
def test_sixteen_windows_at_once_are_what_each_is_alone(case: str) -> None:
    structure, effects = CASES[case]
    joint = load_joint("orange_80_6000", structure, effects=effects)
    t = 1e-3 * np.arange(3000)
    record = joint.simulate(12.0 * np.sin(2.0 * np.pi * 3.0 * t) + 6.0 * np.sin(41.0 * t))
    units = {"t": "s", "i_cmd": "A", "q_m": "rad"}
    if structure != "rigid":  # whose torque the fast lanes do not know
        units |= {"q_l": "rad", "tau": "N m"}
    record = Record({name: record[name] for name in units}, units, structure=structure)
    log = make_case([record], [], joint.file, joint.structure_row).logs[0]
    forecast = Forecast(joint, log)
    # the first ones lack a part of the lead
    starts = np.array([3, 20, *range(100, len(log) - 400, 61)])
    lengths, leads = np.full(len(starts), 400), np.minimum(starts, 60)
    at_once = forecast.windows(starts, lengths, leads)
    few = [slice(k, k + FEWEST - 1) for k in range(0, len(starts), FEWEST - 1)]
    alone = np.concatenate([forecast.windows(starts[k], lengths[k], leads[k]) for k in few])
    columns = [CHANNELS[name] for name in log.measured]
    scale = alone[..., columns].std(axis=(0, 1))
    assert np.all(scale > 0.0)
    off = (at_once - alone)[..., columns] / scale
    assert np.abs(off).max() < 1e-7
