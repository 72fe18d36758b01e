"""Closed-loop replay of a joint of the second simulator under the controller of its record."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cjt_gym.baselines import PdFeedForward
from cjt_gym.blind import Bench, make_bench
from cjt_gym.errors import ConfigurationError
from cjt_gym.gap.judged.closed_loop import closed_loop_gap, replay_closed_loop
from cjt_gym.joint import Joint, load_joint
from cjt_gym.records import Record

FIXED = "output_fixed_rigid_gearbox"
KP, FRICTION = 0.4, 2.0


@pytest.fixture(scope="module")
def bench() -> Bench:
    return make_bench(1, FIXED, up_m=FRICTION, down_m=FRICTION)


@pytest.fixture(scope="module")
def record(bench: Bench) -> Record:
    t = np.arange(4000) * bench.sheet.dt
    wanted = 4.0 * np.sin(2.0 * np.pi * 1.5 * t) + 3.0 * np.sin(2.0 * np.pi * 6.0 * t)
    return bench.track(np.where(t < 0.3, 0.0, wanted), KP)


@pytest.fixture(scope="module")
def joints(bench: Bench, tmp_path_factory: pytest.TempPathFactory) -> tuple[Joint, Joint]:
    path = Path(tmp_path_factory.mktemp("bench")) / "nominal.toml"
    path.write_text(bench.datasheet(), encoding="utf-8")
    nominal = load_joint(path, FIXED)
    effects = dict(nominal.effects) | {"coulomb": {"d_cm": FRICTION, "dq_0": 0.0}}
    return nominal, load_joint(path, FIXED, effects=effects)


def law(record: Record) -> PdFeedForward:
    return PdFeedForward(record.provenance["kp"], record.provenance["kd"], record.dt)


def test_the_gap_shrinks_to_little_with_the_effect_in(
    record: Record, joints: tuple[Joint, Joint]
) -> None:
    scatter = 0.02
    gap = closed_loop_gap(record, *joints, law(record), scatter)
    assert gap.before > 0.15
    assert gap.after < 0.25 * gap.before
    assert gap.low < gap.removed < gap.high <= 1.0
    assert gap.removed == pytest.approx(1.0 - gap.after / gap.before)
    assert 0.0 < gap.floor < gap.after
    assert set(gap.by_channel) >= {"tau", "tau_cmd", "q_m"}


def test_the_controller_acts_within_the_replay(record: Record, joints: tuple[Joint, Joint]) -> None:
    """The command answers the error: without feedback it would be the reference."""
    replay = replay_closed_loop(record, joints[1], law(record))
    error = record["tau_ref"] - replay["tau"]
    assert replay["tau_cmd"] == pytest.approx(record["tau_ref"] + KP * error)


def test_a_record_without_reference_is_refused(bench: Bench, joints: tuple[Joint, Joint]) -> None:
    with pytest.raises(ConfigurationError, match="tau_ref is missing"):
        replay_closed_loop(bench.record(np.zeros(300)), joints[0], law_of_nothing())


def law_of_nothing() -> PdFeedForward:
    return PdFeedForward(0.0, 0.0, 1e-3)


def test_missing_samples_are_refused(record: Record, joints: tuple[Joint, Joint]) -> None:
    torque = record["tau"].copy()
    torque[7] = np.nan
    holed = Record({**record.columns, "tau": torque}, record.units, dt=record.dt, allow_nan=True)
    with pytest.raises(ConfigurationError, match="NaN"):
        replay_closed_loop(holed, joints[0], law(record))
