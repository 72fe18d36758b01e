"""Which records a closed loop is replayed on, and what becomes of repeated samples."""

from __future__ import annotations

import numpy as np

from cjt_gym.records import Record
from cjt_gym.training.evaluation.after_diagnosis import REPEATED, _held, _tracking

SAMPLES = 200


def record(share: float, reference: float = 1.0) -> Record:
    """Return a record that tracks a torque, some of whose samples the sensor repeated."""
    t = np.arange(SAMPLES) * 1e-3
    tau = 10.0 + np.sin(20.0 * t)
    rows = 1 + np.random.default_rng(0).permutation(SAMPLES - 1)
    tau[rows[: round(share * SAMPLES)]] = np.nan
    columns = {"tau_ref": reference * np.sin(20.0 * t), "tau": tau}
    return Record(columns, {"tau_ref": "N m", "tau": "N m"}, dt=1e-3, allow_nan=True)


def test_a_record_may_repeat_some_samples_but_not_many() -> None:
    some, many = record(REPEATED - 0.02), record(REPEATED + 0.02)
    assert _tracking([many, some]) is some
    assert _tracking([many]) is None
    assert _tracking([record(0.0, reference=0.0)]) is None


def test_a_repeated_sample_has_the_value_before() -> None:
    given = record(0.15)
    held = _held(given)["tau"]
    missing = np.isnan(given["tau"])
    assert missing.any()
    assert np.isfinite(held).all()
    np.testing.assert_array_equal(held[~missing], given["tau"][~missing])
    later = np.flatnonzero(missing[1:]) + 1
    np.testing.assert_array_equal(held[later], held[later - 1])
