"""Joint files that are refused, and in which words."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from cjt_gym.errors import CjtGymError, MissingFileError, ParameterError, UnknownNameError
from cjt_gym.joint.files.joint_file import load_joint_file, to_toml
from cjt_gym.joint.files.parameter_table import (
    AXES,
    PARAMETERS,
)
from cjt_gym.joint.files.parameters import JointParameters
from tests.contracts.written_joints import HEAD, entries, write

KB = 'k_b = { value = 6000.0, unit = "N m/rad" }'
REFUSED = {
    "unknown parameter": (
        entries('k_bb = { value = 1.0, unit = "N m/rad" }'),
        ["unknown parameter 'k_bb'", "Did you mean 'k_b'?", "Known: I_m"],
    ),
    "unknown key of an entry": (
        entries('k_b = { value = 1.0, unit = "N m/rad", sorce = "x" }'),
        ["k_b of", "unknown key 'sorce'", "Did you mean 'source'?"],
    ),
    "unknown top-level key": (HEAD + "[parameter]\n", ["'parameter'", "'parameters'?"]),
    "unknown sensor key": (
        HEAD + '[sensors.q_m]\nnois = { value = 1.0, unit = "rad" }\n',
        ["[sensors.q_m]", "unknown key 'nois'", "Did you mean 'noise'?"],
    ),
    "unknown sensor channel": (
        HEAD + '[sensors.qm]\nnoise = { value = 1.0, unit = "rad" }\n',
        ["unknown sensor channel 'qm'", "Did you mean 'q_m'?"],
    ),
    "unknown sampling key": (
        HEAD + '[sampling]\ndtt = { value = 1.0, unit = "s" }\n',
        ["[sampling]", "unknown key 'dtt'", "Did you mean 'dt'?"],
    ),
    "missing value": (entries('k_b = { unit = "N m/rad" }'), ["k_b of", "lacks the key 'value'"]),
    "missing unit": (entries("k_b = { value = 1.0 }"), ["k_b of", "lacks the key 'unit'"]),
    "bare number": (entries("k_b = 6000.0"), ["k_b of", "{ value = ..., unit =", "got 6000.0"]),
    "missing name": ('source = "x"\n', ["lacks the key 'name'", 'name = "..."']),
    "missing source": ('name = "x"\n', ["lacks the key 'source'"]),
    "empty name": ('name = " "\nsource = "x"\n', ["name of", "not empty", "' '"]),
    "wrong unit": (
        entries('k_b = { value = 6.0, unit = "kN m" }'),
        ["k_b of", "must be in N m/rad", "'kN m'", 'unit = "N m/rad"'],
    ),
    "unit that does not exist": (
        entries('k_b = { value = 6.0, unit = "N m/radd" }'),
        ["k_b of", "must be in N m/rad", "'N m/radd', which does not exist"],
    ),
    "frequency as angular velocity": (
        entries('dq_p = { value = 6.0, unit = "Hz" }'),
        ["dq_p of", "must be in rad/s", "'Hz'"],
    ),
    "rotary unit on a prismatic axis": (
        'axis = "prismatic"\n' + entries(KB),
        ["k_b of", "must be in N/m", "'N m/rad'"],
    ),
    "rotary motor without a ratio per metre": (
        'axis = "prismatic"\n'
        + entries('n = { value = 9.0, unit = "-" }', 'k_t = { value = 1.0, unit = "N m/A" }'),
        ["n and k_t of", "n in rad/m with k_t in N m/A", "got '-' with 'N m/A'"],
    ),
    "ratio per metre of a linear motor": (
        'axis = "prismatic"\n'
        + entries('n = { value = 9.0, unit = "rad/m" }', 'k_t = { value = 1.0, unit = "N/A" }'),
        ["n and k_t of", "got 'rad/m' with 'N/A'"],
    ),
    "prismatic unit on a rotary axis": (
        entries('I_m = { value = 1.0, unit = "kg" }'),
        ["I_m of", "must be in kg m^2", "'kg'"],
    ),
    "wrong sensor unit": (
        HEAD + '[sensors.tau]\nnoise = { value = 1.0, unit = "rad" }\n',
        ["noise of [sensors.tau]", "must be in N m", "'rad'"],
    ),
    "wrong sampling unit": (
        HEAD + '[sampling]\ndt = { value = 1.0, unit = "m" }\n',
        ["dt of [sampling]", "must be in s", "'m'"],
    ),
    "negative stiffness": (
        entries('k_b = { value = -6000, unit = "N m/rad" }'),
        ["k_b of", "must be > 0 N m/rad", "got -6000."],
    ),
    "zero gear ratio": (
        entries('n = { value = 0, unit = "-" }'),
        ["n of", "must be > 0", "got 0."],
    ),
    "negative friction": (
        entries('d_cm = { value = -0.1, unit = "N m" }'),
        ["d_cm of", "must be >= 0 N m", "got -0.1."],
    ),
    "negative noise": (
        HEAD + '[sensors.q_m]\nnoise = { value = -1.0, unit = "rad" }\n',
        ["noise of [sensors.q_m]", ">= 0 rad", "-1.0"],
    ),
    "negative tolerance": (
        entries('k_b = { value = 1.0, unit = "N m/rad", tolerance = -0.1 }'),
        ["tolerance of k_b", ">= 0", "got -0.1."],
    ),
    "tolerance in per cent": (
        entries('k_b = { value = 1.0, unit = "N m/rad", tolerance = 5 }'),
        ["tolerance of k_b", "at most 2", "0.05 is 5 %", "got 5", "guess = true"],
    ),
    "tolerance in words": (
        entries('k_b = { value = 1.0, unit = "N m/rad", tolerance = "guess" }'),
        ["tolerance of k_b", "must be a number", "got 'guess'", "guess = true instead"],
    ),
    "guess with a tolerance": (
        entries('k_b = { value = 1.0, unit = "N m/rad", tolerance = 0.1, guess = true }'),
        ["k_b of", "either a tolerance or guess = true", "got both"],
    ),
    "guess that is no truth value": (
        entries('k_b = { value = 1.0, unit = "N m/rad", guess = 0.3 }'),
        ["guess of k_b", "true or false", "got 0.3"],
    ),
    "limit in amperes on a gain per volt": (
        entries(
            'k_t = { value = 0.05, unit = "N m/V" }',
            'i_p = { value = 10.0, unit = "A" }',
        ),
        ["i_p of", "must be in V", "k_t is in N m/V", "'A'"],
    ),
    "nan": (entries('k_b = { value = nan, unit = "N m/rad" }'), ["k_b of", "finite", "nan"]),
    "infinity": (entries('k_b = { value = inf, unit = "N m/rad" }'), ["k_b of", "finite", "inf"]),
    "nan in an effect": (
        HEAD + '[effects.cogging]\na = { value = [1.0, nan], unit = "N m" }\n',
        ["a of [effects.cogging]", "finite", "nan"],
    ),
    "text as value": (
        entries('k_b = { value = "6000", unit = "N m/rad" }'),
        ["k_b of", "must be a number", "'6000'"],
    ),
    "truth as value": (entries('n = { value = true, unit = "-" }'), ["n of", "a number", "True"]),
    "list as parameter": (
        entries('k_b = { value = [1.0, 2.0], unit = "N m/rad" }'),
        ["k_b of", "must be one number", "[1.0, 2.0]"],
    ),
    "unit that is no text": (
        entries("k_b = { value = 1.0, unit = 5 }"),
        ["unit of k_b", "text that is not empty", "got 5"],
    ),
    "unknown axis": ('axis = "linear"\n' + HEAD, ["axis of", '"prismatic"', "'linear'"]),
    "parameters that are no table": (HEAD + "parameters = 3\n", ["parameters of", "[parameters]"]),
    "effect that is no table": (HEAD + "[effects]\ncoulomb = 1\n", ["coulomb of", "got 1"]),
    "bare number in an effect": (
        HEAD + "[effects.coulomb]\nd_cm = 1.0\n",
        ["d_cm of [effects.coulomb]", "{ value = ..., unit"],
    ),
    "channel twice": (
        HEAD + "[sensors.q_m]\n[sensors.q_m]\n",
        ["Cannot declare ('sensors', 'q_m') twice", "only once"],
    ),
    "several channels in an effect": (
        HEAD + '[effects.noise]\nchannel = ["q_m", "tau"]\n',
        ["channel of [effects.noise]", "{ value = ..., unit"],
    ),
    "truth in an effect": (
        HEAD + "[effects.coulomb]\nd_cm = true\n",
        ["d_cm of [effects.coulomb]", "{ value = ..., unit", "got True"],
    ),
    "parameter twice": (entries(KB, KB), ["is not valid TOML", "only once"]),
    "no TOML": ("k_b: 6000", ["is not valid TOML"]),
    "negative direction differs silently": (
        entries(
            'd_m = { value = 0.0022, unit = "N m s/rad" }',
            'd_m_n = { value = 14.786, unit = "N m s/rad" }',
        ),
        ["d_m_n of", "factor 3 of d_m = 0.0022 N m s/rad", "got 14.786", "asymmetric = true"],
    ),
    "negative direction without partner": (
        entries('d_cm_n = { value = 1.0, unit = "N m" }'),
        ["d_cm_n of", "partner d_cm is absent", "asymmetric = true"],
    ),
    "negative direction with zero partner": (
        entries(
            'd_cm = { value = 0.0, unit = "N m" }',
            'd_cm_n = { value = 1.0, unit = "N m" }',
        ),
        ["d_cm_n of", "d_cm = 0 N m", "got 1."],
    ),
    "asymmetric where it means nothing": (
        entries('d_cm = { value = 1.0, unit = "N m", asymmetric = true }'),
        ["d_cm of", "asymmetric = true", "(..._n) only"],
    ),
    "asymmetric that is no truth value": (
        entries('d_cm_n = { value = 1.0, unit = "N m", asymmetric = 1 }'),
        ["asymmetric of d_cm_n", "true or false", "got 1"],
    ),
}


@pytest.mark.parametrize("case", sorted(REFUSED))
def test_bad_file_is_refused_in_clear_words(case: str, tmp_path: Path) -> None:
    text, parts = REFUSED[case]
    path = write(tmp_path, text)
    with pytest.raises(ParameterError) as caught:
        load_joint_file(path)
    message = str(caught.value)
    assert str(path) in message
    assert [part for part in parts if part not in message] == []
    assert isinstance(caught.value, ValueError)
    assert isinstance(caught.value, CjtGymError)


@pytest.mark.parametrize("symbol", sorted(PARAMETERS))
def test_every_parameter_refuses_what_is_below_its_range(symbol: str) -> None:
    spec = PARAMETERS[symbol]
    for axis in AXES:
        bad = spec.minimum if spec.exclusive else spec.minimum - 1e-6
        with pytest.raises(ParameterError) as caught:
            JointParameters.from_values("mine", {symbol: bad}, axis=axis)
        assert spec.range_text(axis) in str(caught.value)
        for value in (math.nan, math.inf):
            with pytest.raises(ParameterError, match=f"{symbol} of "):
                JointParameters.from_values("mine", {symbol: value}, axis=axis)


def test_declared_asymmetry_is_accepted(tmp_path: Path) -> None:
    line = 'd_cm_n = { value = 9.0, unit = "N m", asymmetric = true }'
    lone = load_joint_file(write(tmp_path, entries(line)))
    assert lone.parameters.d_cm_n == 9.0
    both = load_joint_file(write(tmp_path, entries('d_cm = { value = 1.0, unit = "N m" }', line)))
    assert load_joint_file(write(tmp_path, to_toml(both))) == both


def test_factor_three_is_still_accepted() -> None:
    for negative in (1.0, 9.0):
        JointParameters.from_values("mine", {"d_cm": 3.0, "d_cm_n": negative})


def test_unknown_joint() -> None:
    with pytest.raises(UnknownNameError) as caught:
        load_joint_file("orang_80_6000")
    assert "Unknown joint 'orang_80_6000'. Did you mean 'orange_80_6000'?" in str(caught.value)
    assert "Known: avocado_100_21000" in str(caught.value)
    assert isinstance(caught.value, LookupError)


def test_a_file_that_is_named_like_a_joint_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UnknownNameError) as caught:
        load_joint_file("elbow")
    assert "in this folder" not in str(caught.value)
    write(tmp_path, HEAD).rename("elbow.toml")
    with pytest.raises(UnknownNameError, match=r"For the file in this folder, give elbow\.toml\."):
        load_joint_file("elbow")


def test_a_name_with_an_ending_is_a_file_that_is_missing() -> None:
    with pytest.raises(MissingFileError, match=r"elbow.tml does not exist"):
        load_joint_file("elbow.tml")


def test_missing_and_unreadable_file(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match="nowhere.toml does not exist"):
        load_joint_file(tmp_path / "nowhere.toml")
    with pytest.raises(FileNotFoundError):
        load_joint_file("no/such/file.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ParameterError, match=r"must be a text in UTF-8: .*[^.]\. Save it as UTF-8"):
        load_joint_file(tmp_path / "binary.toml")
    with pytest.raises(ParameterError, match="cannot be read"):
        load_joint_file(tmp_path)
