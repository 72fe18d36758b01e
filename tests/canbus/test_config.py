"""The configuration of a joint on a bus, and its mistakes."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cjt_gym import disk
from cjt_gym.canbus.config import load_hardware, parse_hardware
from cjt_gym.canbus.emulator import emulated_joint
from cjt_gym.canbus.plant import CanPlant
from cjt_gym.errors import CjtGymError, ConfigurationError, MissingFileError
from cjt_gym.joint import load_joint, to_toml
from cjt_gym.joint.build import file_of
from tests.canbus.bench import config, document


def newton_metres(value: float) -> dict[str, Any]:
    return {"value": value, "unit": "N m"}


def test_limits_are_those_of_the_joint_file_unless_tightened() -> None:
    assert config().limits.tau == pytest.approx(0.078 * 80.0 * 30.0)
    assert config().limits.dq_m == 7.7284
    assert config().limits.temperature == 155.0
    tight = config(limits={"tau": newton_metres(40.0)}).limits
    assert tight.tau == 40.0
    assert tight.tau_rate == config().limits.tau_rate  # tightened by itself, or not at all
    assert tight.dq_m == 7.7284


def test_file_of_the_contract_is_read(tmp_path: Path) -> None:
    tables = document(
        bus={"interface": "socketcand", "channel": "can0", "host": "127.0.0.1", "port": 29536},
        drive={"protocol": "odrive", "node": 1},
        joint={"effects": ["coulomb_asym", "cogging"]},
        limits={"tau": newton_metres(40.0), "dq_m": {"value": 5.0, "unit": "rad/s"}},
    )
    tables["joint"]["effects"] = {"coulomb_asym": {}, "cogging": {"f": [480], "a": [1], "b": [0]}}
    path = tmp_path / "joint.toml"
    path.write_text(disk.to_toml(tables))
    found = load_hardware(path)
    assert found.dt == 0.002
    assert found.drive.settings.scaling.gear_ratio == 80.0
    assert found.joint.effects == {}
    joint = emulated_joint(found)
    assert set(joint.effects) == {"coulomb_asym", "cogging", "noise", "quantization"}


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"limits": {"tau": newton_metres(400.0)}}, "tighter than the joint's, never looser"),
        ({"limits": {"tau": {"value": 4.0, "unit": "A"}}}, "must be in N m"),
        ({"bus": {"interface": "sockcand"}}, "Did you mean 'socketcand'"),
        ({"limits": {"torque": newton_metres(4.0)}}, "unknown key 'torque'"),
        ({"limits": {"q_m": {"low": 1.0, "high": 0.0, "unit": "rad"}}}, "high of q_m"),
        ({"control": {"rate_hz": 0}}, "rate_hz .* must be > 0"),
        ({"control": {"rate_hz": float("nan")}}, "rate_hz"),
        ({"control": {"rate": 500}}, "Did you mean 'rate_hz'"),
        ({"control": {"torque": "guess"}}, "torque of"),
        ({"bus": {"port": 70000}}, "port .* >= 1 and <= 65535"),
        ({"drive": {"protocol": "odriv", "node": 1}}, "Did you mean 'odrive'"),
        ({"drive": {"protocol": "odrive", "node": 64}}, "node"),
        ({"joint": {"structure": "rigid"}}, "cannot be known: the structure rigid has no spring"),
        ({"joint": {"effects": "coulomb"}}, "must be a list, as for --effect"),
        ({"emulator": {"loss": 1.5}}, "loss"),
        ({"emulator": {"load": -0.1}}, "load .* must be >= 0 and <= 0.95"),
        ({"emulators": {}}, "Did you mean 'emulator'"),
    ],
)
def test_mistakes_are_named(changes: dict[str, Any], text: str) -> None:
    with pytest.raises(CjtGymError, match=text):
        CanPlant(config(**changes))


def test_values_are_converted_as_in_joint_files() -> None:
    watchdog, span = {"value": 40, "unit": "ms"}, {"low": -10, "high": 20, "unit": "deg"}
    limits = {"tau": {"value": 20e3, "unit": "mN m"}, "q_m": span}
    given = parse_hardware(document(control={"watchdog": watchdog}, limits=limits), "x", Path())
    assert given.drive.settings.watchdog == pytest.approx(0.04)
    assert given.limits.tau == pytest.approx(20.0)
    assert np.degrees([given.limits.q_low, given.limits.q_high]) == pytest.approx([-10, 20])


def test_missing_tables_and_files_are_named(tmp_path: Path) -> None:
    tables = document()
    del tables["drive"]
    with pytest.raises(ConfigurationError, match=r"lacks the table \[drive\]"):
        parse_hardware(tables, "x.toml", Path())
    with pytest.raises(MissingFileError, match="does not exist"):
        load_hardware(tmp_path / "none.toml")
    (tmp_path / "bad.toml").write_bytes(b"\xff\xfe = 1")
    with pytest.raises(ConfigurationError, match="must be a text in UTF-8"):
        load_hardware(tmp_path / "bad.toml")


def test_limits_are_numbers() -> None:
    limits = config().limits
    assert all(np.isfinite([limits.tau, limits.tau_rate, limits.tau_joint, limits.deflection]))


@pytest.mark.parametrize(
    ("control", "overrun", "watchdog", "missed"),
    [
        ({"rate_hz": 500}, 0.02, 0.0235, 10),
        ({"rate_hz": 1000}, 0.02, 0.02175, 20),
        ({"rate_hz": 50}, 0.02, 0.055, 1),
        ({"rate_hz": 500, "overrun": {"value": 0.002, "unit": "s"}}, 0.002, 0.0055, 1),
        ({"rate_hz": 500, "watchdog": {"value": 0.004, "unit": "s"}}, 0.004, 0.004, 2),
        ({"rate_hz": 500, "missed": 0}, 0.02, 0.0235, 0),
    ],
)
def test_allowances_that_are_not_given_follow_from_the_others(
    control: dict[str, Any], overrun: float, watchdog: float, missed: int
) -> None:
    given = parse_hardware(document(control=control), "x", Path())
    assert (given.overrun, given.drive.settings.watchdog) == pytest.approx((overrun, watchdog))
    assert given.missed == missed


def test_the_emulated_joint_has_the_effects_of_its_file_unless_others_are_given(
    tmp_path: Path,
) -> None:
    known = load_joint("orange_80_6000", "output_fixed", effects={"coulomb": {"d_cm": 3.0}})
    (tmp_path / "mine.toml").write_text(to_toml(file_of(known)), encoding="utf-8")
    for given, wanted in (({}, {"coulomb"}), ({"effects": []}, set())):
        joint = {"file": "mine.toml", "structure": "output_fixed", **given}
        found = parse_hardware({**document(), "joint": joint}, "bench.toml", tmp_path)
        assert set(emulated_joint(found).effects) - {"noise", "quantization"} == wanted
    words = ["coulomb.d_cm=0.6", "cogging=typical"]
    joint = {"file": "mine.toml", "structure": "output_fixed", "effects": words}
    found = parse_hardware({**document(), "joint": joint}, "bench.toml", tmp_path)
    assert emulated_joint(found).effects["coulomb"]["d_cm"] == 0.6
    assert "cogging" in emulated_joint(found).effects
    assert found.joint.effects == {}, "the nominal joint of controllers has none"
