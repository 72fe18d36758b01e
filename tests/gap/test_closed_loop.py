"""Closed-loop replay of a joint of the second simulator under the controller of its record."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cjt_gym.baselines import PdFeedForward
from cjt_gym.blind import Bench, make_bench
from cjt_gym.cli import main
from cjt_gym.errors import ConfigurationError
from cjt_gym.gap.judged.closed_loop import closed_loop_gap, replay_closed_loop
from cjt_gym.joint import Joint, load_joint
from cjt_gym.records import Record, read_record
from cjt_gym.training.evaluation.after_diagnosis import _replay, recorded_law

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


@pytest.mark.parametrize("controller", ["lqg", "cascade", "pid_feedforward", "open_loop"])
def test_a_record_holds_all_of_the_law_that_made_it(controller: str, tmp_path: Path) -> None:
    """The law was made for the joint with its effects; the replay starts from the nominal one."""
    path = tmp_path / "made.csv"
    effects = ["coulomb.d_cm=2.6", "current_lag.bandwidth=60", "noise"]
    words = ["simulate", "orange_80_6000", "--structure", FIXED, "--effect", *effects]
    words += ["--controller", controller, "--duration", "0.5", "--reference", "multisine"]
    assert main([*words, "--out", str(path)]) == 0
    made = read_record(path)
    nominal, true = (
        load_joint("orange_80_6000", FIXED, effects=given)
        for given in ([], made.provenance["effects"])
    )
    name, found = recorded_law(made, nominal, ())
    assert name == controller
    again = replay_closed_loop(made, true, found)
    assert again["tau_cmd"] == pytest.approx(made["tau_cmd"], abs=1e-6)


@pytest.mark.parametrize(
    ("made", "told"),
    [
        ({"kind": "simulation", "controller": "lqg"}, "does not say for which joint"),
        ({"kind": "hardware", "policy": "sea"}, "the policy sea; only controllers"),
        ({"controller": "mine.py:Law"}, r"--controller mine\.py:Law"),
        ({}, "does not name the controller"),
    ],
)
def test_no_other_law_stands_in_for_one_that_is_not_known(
    record: Record, joints: tuple[Joint, Joint], made: dict[str, str], told: str
) -> None:
    with pytest.raises(ConfigurationError, match=told):
        recorded_law(replace(record, provenance=made), joints[0], ())


def test_a_run_that_fades_in_is_replayed_so(record: Record, joints: tuple[Joint, Joint]) -> None:
    soft = replace(record, provenance={"soft_s": 0.5})
    plain, faded = (replay_closed_loop(r, joints[1], law_of_nothing()) for r in (record, soft))
    share = np.minimum((record.t + record.dt) / 0.5, 1.0)
    assert faded["tau_cmd"] == pytest.approx(share * plain["tau_cmd"])
    assert share[400] < 1.0


def test_a_run_whose_unseen_end_fades_out_is_not_replayed(
    record: Record, joints: tuple[Joint, Joint]
) -> None:
    short = replace(record.slice(stop=300), provenance={"soft_s": 0.2})
    told = r"0\.06 s that were not fitted.* fade-out of 0\.2 s"
    with pytest.raises(ConfigurationError, match=told):
        _replay(short, *joints, was_fitted=True, agents=())
