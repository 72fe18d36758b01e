"""Policies of anybody: their arrays are checked before compiled code sees them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cjt_gym.envs.observation import Layout
from cjt_gym.errors import CjtGymError, ConfigurationError
from cjt_gym.export.c_text import identifier
from cjt_gym.joint import load_joint
from cjt_gym.plant import SimulatedPlant
from cjt_gym.signals import Signal
from cjt_gym.training.deploy.c_header import c_header
from cjt_gym.training.deploy.exported import Exported, load_exported, save_exported
from cjt_gym.training.deploy.network import Layer, Network
from cjt_gym.training.deploy.stepper import Stepper
from cjt_gym.training.learning.config import TrainConfig

LAYOUT = Layout(1, 2, 10.0, 1.0, 5.0, 80.0, 1e-3)
SIZE, WIDTH = LAYOUT.size, 8
BIG = 2**40


def policy() -> Exported:
    rng = np.random.default_rng(0)
    layers = (
        Layer(rng.normal(size=(WIDTH, SIZE)), np.zeros(WIDTH), "tanh"),
        Layer(rng.normal(size=(1, WIDTH)), np.zeros(1), "none"),
    )
    network = Network(layers, np.zeros(SIZE), np.ones(SIZE), 10.0)
    return Exported("one", TrainConfig(env={"joint": "orange_80_6000"}), LAYOUT, network)


def changed(path: Path, arrays: dict[str, Any], facts: dict[str, Any]) -> Path:
    """Write a policy with other arrays, or None for none, and other facts."""
    with np.load(save_exported(policy(), path)) as archive:
        given = dict(archive)
    known = json.loads(str(given.pop("facts")))
    for name, value in facts.items():
        table, _, key = name.rpartition("/")
        (known[table] if table else known)[key] = value
    given = {k: v for k, v in {**given, **arrays}.items() if v is not None}
    np.savez(path, **({"facts": np.array(json.dumps(known))} | given))
    return path


ARRAYS: dict[str, dict[str, Any]] = {
    "too few biases": {"bias_0": np.zeros(WIDTH - 1)},
    "too many outputs": {"weight_1": np.zeros((3, WIDTH)), "bias_1": np.zeros(3)},
    "layers that do not fit": {"weight_1": np.zeros((1, WIDTH + 4000))},
    "weights of one dimension": {"weight_0": np.zeros(SIZE)},
    "weights of three": {"weight_0": np.zeros((1, WIDTH, SIZE))},
    "no weights": {"weight_0": np.zeros((0, SIZE)), "bias_0": np.zeros(0)},
    "a short mean": {"mean": np.zeros(1)},
    "a wide scale": {"scale": np.ones((SIZE, 1))},
    "another size": {
        "mean": np.zeros(4 * SIZE),
        "scale": np.ones(4 * SIZE),
        "weight_0": np.zeros((WIDTH, 4 * SIZE)),
    },
    "NaN": {"bias_0": np.full(WIDTH, np.nan)},
    "too large for single precision": {"scale": np.full(SIZE, 1e300)},
    "complex": {"weight_0": np.zeros((WIDTH, SIZE), complex)},
    "texts": {"mean": np.full(SIZE, "1")},
    "letters that there are not": {"facts": np.frombuffer(b"\xff\xff\xff\x7f" * 4, "<U4")},
    "objects": {"mean": np.full(SIZE, None)},
    "absent": {"mean": None},
}
FACTS: dict[str, dict[str, Any]] = {
    "preview": {"layout/preview": BIG},
    "a negative preview": {"layout/preview": -3},
    "a broken preview": {"layout/preview": 1.5},
    "no history": {"layout/history": 0},
    "joint numbers": {"layout/joint_numbers": [1.0] * 1000},
    "joint numbers of text": {"layout/joint_numbers": "abc"},
    "no torque": {"layout/torque": 0.0},
    "a torque of text": {"layout/torque": "1"},
    "an infinite velocity": {"layout/velocity": float("inf")},
    "clip": {"clip": float("nan")},
    "clip of text": {"clip": "x"},
    "an activation": {"activations": ["tanh", "sin"]},
    "no activations": {"activations": []},
    "activations of numbers": {"activations": [1, 2]},
    "activations of tables": {"activations": [{}, []]},
    "config": {"config": 3},
    "a key of config": {"config/seeds": 3},
    "layout": {"layout": []},
    "kind": {"kind": "something"},
}


@pytest.mark.parametrize("case", ARRAYS)
def test_arrays_of_wrong_shape_or_type_are_refused(case: str, tmp_path: Path) -> None:
    with pytest.raises(CjtGymError):
        load_exported(changed(tmp_path / "p.npz", ARRAYS[case], {}))


@pytest.mark.parametrize("case", FACTS)
def test_facts_that_do_not_fit_are_refused(case: str, tmp_path: Path) -> None:
    with pytest.raises(CjtGymError):
        load_exported(changed(tmp_path / "p.npz", {}, FACTS[case]))


def test_a_sound_policy_steps_as_before(tmp_path: Path) -> None:
    path = changed(tmp_path / "p.npz", {"bias_1": np.zeros(1, np.float64)}, {})
    ends = (Stepper(load_exported(path)), Stepper(policy()))
    for _ in range(5):
        one, other = (s.step([1.0, 2.0], 0.5, 0.1, 0.1, 0.0, 0.2, 0.2, 0.3) for s in ends)
        assert one == other != 0.0


@pytest.mark.parametrize("observation", [np.zeros(SIZE + 1), np.zeros((1, SIZE)), np.zeros(0)])
def test_observations_of_another_shape_are_refused(observation: Any) -> None:
    with pytest.raises(ConfigurationError, match="observation of a policy must have the shape"):
        policy().network.act(observation.astype(np.float32))


def test_names_end_no_comment_of_a_header() -> None:
    named = replace(policy(), name="x */ int evil; /* @ARRAYS@ \n")
    text = c_header(named, "1 ä*")
    head = text[: text.index("#ifndef")]
    assert head.count("*/") == 1
    assert head.count("/*") == 1
    assert "@ARRAYS@" in head
    assert identifier("1 ä*", "policy") == "policy_1___"
    assert "policy_1____step(" in text


BAD_SHAPES = [np.zeros(4), np.zeros((2, 1)), np.zeros(0), np.array("x"), np.array([1j, 0.0])]


@pytest.mark.parametrize("bad", BAD_SHAPES)
def test_arrays_for_a_plant_must_be_as_many_as_its_joints(bad: Any) -> None:
    plant = SimulatedPlant(load_joint("orange_80_6000"), num=2)
    plant.reset(seed=0)
    good = np.zeros(2)
    for call in (
        lambda: plant.step(bad),
        lambda: plant.step(good, bad),
        lambda: plant.reset(load=bad),
        lambda: plant.reset(start=bad),
        lambda: plant.reset(mask=bad),
        lambda: plant.redraw(bad),
    ):
        with pytest.raises(ConfigurationError, match="must have the shape|must hold real numbers"):
            call()


def test_tables_of_signals_are_checked() -> None:
    for table in (np.zeros((0, 2)), np.zeros((3, 1)), np.zeros(3), np.array([[0.0, np.nan]])):
        with pytest.raises(ConfigurationError, match="table of the file signal"):
            Signal("file", table=table)
    with pytest.raises(ConfigurationError, match="must not decrease"):
        Signal("file", table=np.array([[1.0, 0.0], [0.0, 0.0]]))
