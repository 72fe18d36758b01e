"""The performance gap between a nominal, an identified and a recorded world."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from cjt_gym.blind import make_bench
from cjt_gym.envs.core import Episodes
from cjt_gym.errors import ConfigurationError
from cjt_gym.joint import Joint, load_joint
from cjt_gym.records import Record
from cjt_gym.signals import Signal
from cjt_gym.training.evaluation.performance import performance_gap, rewards
from cjt_gym.training.evaluation.rollout import ControllerAgent, Traces

FIXED = "output_fixed_rigid_gearbox"
FRICTION = 2.0
Worlds = tuple[Record, Joint, Joint]


@pytest.fixture(scope="module")
def worlds(tmp_path_factory: pytest.TempPathFactory) -> Worlds:
    """Return a record of open-loop control on a joint with friction, and both models of it."""
    bench = make_bench(1, FIXED, up_m=FRICTION, down_m=FRICTION)
    t = np.arange(3000) * bench.sheet.dt
    wanted = np.where(t < 0.2, 0.0, 6.0 * np.sin(2.0 * np.pi * 2.0 * t))
    record = bench.track(wanted, kp=0.0)
    facts = dict(record.provenance) | {"controller": "open_loop"}
    record = Record(record.columns, record.units, dt=record.dt, provenance=facts)
    path = Path(tmp_path_factory.mktemp("bench")) / "nominal.toml"
    path.write_text(bench.datasheet(), encoding="utf-8")
    nominal = load_joint(path, FIXED)
    effects = dict(nominal.effects) | {"coulomb": {"d_cm": FRICTION, "dq_0": 0.0}}
    return record, nominal, load_joint(path, FIXED, effects=effects)


def test_the_identified_world_is_as_hard_as_the_recorded_one(worlds: Worlds) -> None:
    found = performance_gap(*worlds, ControllerAgent("open_loop"), episodes=4)
    assert found.recorded is not None
    assert found.nominal.rmse < 0.8 * found.recorded.rmse
    assert found.identified.rmse == pytest.approx(found.recorded.rmse, rel=0.1)
    assert found.nominal.reward > found.recorded.reward
    assert found.identified.reward == pytest.approx(found.recorded.reward, rel=0.1)
    assert found.removed is not None
    assert found.removed > 0.8
    assert found.recorded.low < found.recorded.rmse < found.recorded.high
    assert json.loads(json.dumps(asdict(found), allow_nan=False)) == asdict(found)


def test_a_record_of_another_controller_shows_no_recorded_world(worlds: Worlds) -> None:
    found = performance_gap(*worlds, ControllerAgent("pd_feedforward"), episodes=2)
    assert found.recorded is None
    assert found.removed is None
    assert "open_loop" in found.note
    assert found.identified.rmse > found.nominal.rmse


def test_gains_are_those_for_the_nominal_joint_in_both_worlds(worlds: Worlds) -> None:
    record, nominal, _ = worlds
    seen = []

    class Watcher:
        name, kind, trained_on, renders = "watcher", "classical", None, False

        def arguments(self, conditions):  # type: ignore[no-untyped-def]
            def make(joint: Joint, dt: float) -> object:
                seen.append(joint)
                return agent.arguments(conditions)["base_controller"](joint, dt)

            return conditions.arguments | {"base_controller": make}

        def begin(self) -> None:
            pass

        def act(self, observation):  # type: ignore[no-untyped-def]
            return np.zeros((observation.shape[0], 1))

    agent = ControllerAgent("pd_feedforward")
    performance_gap(record, nominal, worlds[2], Watcher(), episodes=1)
    assert seen == [nominal, nominal]


def test_rewards_are_those_of_the_environment() -> None:
    arguments = {"reference": Signal("chirp", 10.0), "episode_steps": 50, "torque_amplitude": 10.0}
    episodes = Episodes(3, **arguments)
    episodes.plant.seed(5)
    episodes.reset()
    rng = np.random.default_rng(0)
    rows: list[tuple[np.ndarray, ...]] = []
    for _ in range(50):
        episodes.step(rng.uniform(-0.3, 0.3, (3, 1)))
        task, tau = episodes.task, episodes.plant.batch.arrays.tau
        rows.append(tuple(x.copy() for x in (task.reference, tau, task.command, task.reward)))
    wanted, tau, command, reward = (np.stack(x, axis=1) for x in zip(*rows, strict=True))
    traces = Traces(wanted, tau, tau, command, np.zeros((3, 50), dtype=bool), 1e-3)
    assert rewards(traces, 10.0) == pytest.approx(reward)


@pytest.mark.parametrize("values", [None, 0.0, np.nan])
def test_a_record_without_a_usable_reference_is_refused(
    worlds: Worlds, values: float | None
) -> None:
    record = worlds[0]
    columns = dict(record.columns)
    columns["tau_ref"] = np.full(len(record), values)
    if values is None:
        del columns["tau_ref"]
    units = {name: record.units[name] for name in columns}
    broken = Record(columns, units, dt=record.dt, allow_nan=True)
    with pytest.raises(ConfigurationError, match="tau_ref"):
        performance_gap(broken, worlds[1], worlds[2], ControllerAgent("open_loop"))
