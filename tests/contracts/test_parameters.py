"""Joint files and parameters: the joints that ship, access to values, and round trips."""

from __future__ import annotations

import copy
import json
import math
import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cjt_gym.errors import ParameterError, UnknownNameError
from cjt_gym.joint import Joint, load_joint
from cjt_gym.joint.files.joint_file import JointFile, joint_names, load_joint_file, to_toml
from cjt_gym.joint.files.mistakes import Mistakes
from cjt_gym.joint.files.parameter_table import (
    AXES,
    PARAMETERS,
    SAMPLING_KEYS,
    SENSOR_KEYS,
    sensor_units,
)
from cjt_gym.joint.files.parameters import JointParameters
from cjt_gym.joint.files.quantity import WIDEST, Quantity, Setting
from cjt_gym.joint.files.toml_format import parse_document
from tests.contracts.written_joints import entries, write

GOLDEN = json.loads((Path(__file__).parents[1] / "golden" / "params.json").read_text("utf-8"))
ORACLE_SETS = {
    "orange_80_6000": "cjt_Orange_80_6000",
    "orange_100_6000": "cjt_Orange_100_6000",
    "lemon_50_6000": "cjt_Lemon_50_6000",
    "lime_50_21000": "cjt_Lime_50_21000",
    "avocado_100_21000": "cjt_Avocado_100_21000",
    "pomegranate_160_9000": "cjt_Pomegranate_160_9000",
    "generic": "genericJoint_defaults",
    "example": "example_params",
}
ARTICLE = {  # Algorithm 1 of the article, and the three values that follow their partner
    "I_m": 9.407e-2,
    "d_m": 2.188643e-3,
    "d_m_n": 2.188643e-3,
    "d_cm": 2.64,
    "d_cm_n": 2.64,
    "k_t": 4.1e-2,
    "n": 100.0,
    "d_g": 2.2,
    "d_g_n": 2.1,
    "d_cg": 3.28,
    "d_cg_n": 3.28,
    "I_l": 1.137e-4,
    "k_b": 21000.0,
}


# --- the joints that ship -----------------------------------------------------------------------


def test_the_promised_joints_ship() -> None:
    assert {*ORACLE_SETS, "emps"} <= set(joint_names())


@pytest.mark.parametrize("name", joint_names())
def test_shipped_joint_loads_and_every_value_has_unit_and_source(name: str) -> None:
    file = load_joint_file(name)
    settings: list[Setting] = [*file.parameters.quantities.values(), *file.sampling.values()]
    for table in (*file.effects.values(), *file.sensors.values()):
        settings += table.values()
    quantities = [setting for setting in settings if isinstance(setting, Quantity)]
    assert quantities
    assert file.name == name
    assert file.parameters.source
    assert all(quantity.unit and quantity.source for quantity in quantities)


@pytest.mark.parametrize("name", sorted(ORACLE_SETS))
def test_shipped_values_are_the_toolbox_values(name: str) -> None:
    file = load_joint_file(name)
    golden = GOLDEN["sets"][ORACLE_SETS[name]]
    expected = golden | {"l_a": golden["x"]} | (ARTICLE if name == "example" else {})
    for symbol, quantity in file.parameters.quantities.items():
        assert quantity.value == expected[symbol], symbol
    missing = {s for s in PARAMETERS if s not in file.parameters.quantities}
    assert missing == {"d_s", "v_s"}  # zero in every set: no stiction
    assert file.sampling["dt"].value == golden["Ts"]
    assert file.sampling["dt_electrical"].value == golden["Ts_elec"]


def test_the_joint_of_figure_5_is_algorithm_1_without_its_friction() -> None:
    """The toolbox's own run of its parameter file has the numbers of the printed data sheet."""
    figure, article = (load_joint_file(f"example{end}").parameters for end in ("_figure_5", ""))
    golden = GOLDEN["sets"]["example_params"]
    for symbol, quantity in figure.quantities.items():
        if not symbol.endswith("_n"):
            assert quantity.value == (golden | {"l_a": golden["x"]})[symbol], symbol
    assert figure.d_m + figure.d_g == pytest.approx(0.0022, abs=5e-5)
    assert figure.d_cm + figure.d_cg == pytest.approx(0.1858)
    assert article.d_m + article.d_g == pytest.approx(2.2022, abs=5e-5)
    assert article.d_cm + article.d_cg == pytest.approx(5.92)


@pytest.mark.parametrize("name", sorted(ORACLE_SETS))
def test_shipped_sensors_are_nineteen_bit_encoders(name: str) -> None:
    file = load_joint_file(name)
    step = 2 * math.pi / 2**19
    for channel in ("q_m", "q_g", "q_l"):
        assert file.sensors[channel]["resolution"].number == step
        assert file.sensors[channel]["noise"].number == 1e-5
    k_b = file.parameters.k_b
    assert file.sensors["tau"]["resolution"].number == pytest.approx(k_b * step, rel=1e-15)
    noise = k_b * math.hypot(1e-5, 1e-5)  # of the difference of two encoders
    assert file.sensors["tau"]["noise"].number == pytest.approx(noise, rel=1e-15)


def test_emps_is_the_published_prismatic_model() -> None:
    file = load_joint_file("emps")
    p = file.parameters
    assert p.axis == "prismatic"
    assert (p.I_m, p.d_m, p.k_t) == (95.1089, 203.5034, 35.15065188248547)
    assert [p.quantities[s].unit for s in ("I_m", "d_m", "k_t")] == ["kg", "N s/m", "N/V"]
    assert file.effects["coulomb"]["d_cm"] == Quantity(
        20.3935, "N", "Janot, Gautier, Brunot (2019), IDIM-LS, symmetric friction: Fc"
    )
    offset = file.effects["torque_offset"]["torque"]
    assert isinstance(offset, Quantity)
    assert offset.value == 3.1648  # added to the motor: minus the published offset


# --- access -------------------------------------------------------------------------------------


def test_values_read_as_attributes() -> None:
    p = load_joint_file("orange_80_6000").parameters
    assert p.k_b == 6000.0
    assert "k_b" in p
    assert "d_s" not in p
    assert p.get("d_s", 1.5) == 1.5
    assert p.unit("k_b") == "N m/rad"
    assert p.origin == "params/orange_80_6000.toml"


def test_absent_parameter_is_asked_for(tmp_path: Path) -> None:
    path = write(tmp_path, entries('k_b = { value = 6000.0, unit = "N m/rad" }'))
    p = load_joint_file(path).parameters
    with pytest.raises(ParameterError) as caught:
        _ = p.k_g
    message = str(caught.value)
    assert message.startswith(f"k_g of {path} is needed and absent")
    assert 'k_g = { value = ..., unit = "N m/rad" }' in message


def test_no_such_parameter() -> None:
    p = load_joint_file("orange_80_6000").parameters
    with pytest.raises(AttributeError, match="no 'kb'. Did you mean 'k_b'?"):
        _ = p.kb
    with pytest.raises(UnknownNameError, match="Unknown parameter 'kb'. Did you mean 'k_b'?"):
        p.get("kb", 0.0)
    with pytest.raises(UnknownNameError, match="Unknown parameter 'kb'. Did you mean 'k_b'?"):
        p.unit("kb")


def test_replace_is_validated_and_leaves_the_original() -> None:
    p = load_joint_file("orange_80_6000").parameters
    q = p.replace(k_b=5000.0, d_s=Quantity(1.0, "N m", "guess"))
    assert (p.k_b, q.k_b, q.d_s) == (6000.0, 5000.0, 1.0)
    assert p != q
    with pytest.raises(ParameterError, match="k_b of params/orange_80_6000.toml must be > 0"):
        p.replace(k_b=-1.0)
    with pytest.raises(ParameterError, match="no parameter 'kb'. Did you mean 'k_b'?"):
        p.replace(kb=1.0)
    with pytest.raises(ParameterError, match="d_cm_n of .* within a factor 3 of d_cm"):
        p.replace(d_cm=20.0, d_cm_n=2.0)


def test_negative_direction_follows_its_partner_unless_given() -> None:
    p = load_joint_file("example").parameters  # d_g_n is 2.1 where d_g is 2.2
    q = p.replace(d_cm=20.0, d_g=4.4)
    assert (q.d_cm_n, q.d_g_n) == (20.0, pytest.approx(4.2))
    assert q.quantities["d_cm_n"].source == q.quantities["d_cm"].source
    assert p.replace(d_cm=20.0, d_cm_n=10.0).d_cm_n == 10.0
    assert p.replace(d_cm=Quantity(2000.0, "N cm")).d_cm_n == 20.0
    assert load_joint("generic", parameters={"d_cm": 2.64}).parameters.d_cm_n == 2.64


def test_replace_keeps_a_unit_that_is_not_the_usual_one() -> None:
    p = load_joint_file("emps").parameters.replace(k_t=30.0)
    assert p.quantities["k_t"].unit == "N/V"


def test_a_guess_is_kept_and_changes_no_simulation(tmp_path: Path) -> None:
    guessed = 'k_b = { value = 6000.0, unit = "N m/rad", guess = true }'
    file = load_joint_file(write(tmp_path, entries(guessed)))
    assert file.parameters.quantities["k_b"].guess
    assert guessed in to_toml(file)
    assert file.parameters.replace(k_b=5000.0).quantities["k_b"].guess
    known = load_joint_file(write(tmp_path, entries(guessed.replace(", guess = true", ""))))
    assert file.hash_hex() == known.hash_hex()


@pytest.mark.parametrize(("axis", "per_volt"), [("rotary", "N m/V"), ("prismatic", "N/V")])
def test_an_amplifier_may_take_volts_on_either_axis(axis: str, per_volt: str) -> None:
    quantities = {
        "I_m": Quantity(0.1, "kg m^2" if axis == "rotary" else "kg"),
        "n": Quantity(1.0, "-"),
        "k_t": Quantity(2.0, per_volt),
        "i_p": Quantity(5.0, "V"),
    }
    p = JointParameters("mine", "made up", quantities, axis)
    joint = Joint(JointFile(p), "rigid", "current", {})
    assert joint.torque_limit == 10.0
    record = joint.simulate(np.full(101, 4.0))
    assert record.units["i_cmd"] == "V"
    assert "i" not in record
    assert record["true_dq_m"][-1] == pytest.approx(4.0 / 0.1 * 0.1, rel=1e-9)


def test_a_rotary_motor_may_drive_a_prismatic_axis(tmp_path: Path) -> None:
    quantities = {
        "I_m": Quantity(2.0, "kg"),
        "n": Quantity(1.0, "rev/mm"),  # a screw of 1 mm a turn
        "k_t": Quantity(50.0, "mN m/A"),
        "r": Quantity(2.0, "Ohm"),
        "v_0": Quantity(24.0, "V"),
    }
    file = JointFile(JointParameters("screw", "made up", quantities, "prismatic"))
    assert [file.parameters.unit(symbol) for symbol in ("n", "k_t")] == ["rad/m", "N m/A"]
    force = 0.05 * 2000.0 * np.pi  # [N/A]
    joint = Joint(file, "rigid", "current", {})
    record = joint.simulate(np.full(101, force))
    assert record["i_cmd"][-1] == pytest.approx(1.0, rel=1e-12)
    assert record["true_dq_m"][-1] == pytest.approx(force / 2.0 * 0.1, rel=1e-9)
    volts = Joint(file, "rigid", "static", {}).simulate(np.full(3001, 6.0 * force))
    assert volts["true_dq_m"][-1] == pytest.approx(24.0 / force, rel=1e-9)  # back-EMF of v_0
    slower = replace(file, effects={"torque_constant": {"k_t": Quantity(40.0, "mN m/A")}})
    path = tmp_path / "screw.toml"
    path.write_text(to_toml(slower), encoding="utf-8")
    record = load_joint(path, "rigid", drive="current").simulate(np.full(101, force))
    assert record["true_dq_m"][-1] == pytest.approx(0.8 * force / 2.0 * 0.1, rel=1e-9)


def test_a_gain_per_volt_has_no_current_for_a_voltage_drive(tmp_path: Path) -> None:
    text = entries(
        'I_m = { value = 0.1, unit = "kg m^2" }',
        'n = { value = 1.0, unit = "-" }',
        'k_t = { value = 2.0, unit = "N m/V" }',
        'r = { value = 1.0, unit = "Ohm" }',
        'v_0 = { value = 24.0, unit = "V" }',
    )
    with pytest.raises(ParameterError, match="voltage is this joint's command already"):
        load_joint(write(tmp_path, text), "rigid", "static")


def test_equality_and_hash_follow_the_content() -> None:
    p = load_joint_file("orange_80_6000").parameters
    named = JointParameters("other name", "other source", p.quantities)
    assert p == named
    assert p.hash_hex() == named.hash_hex()
    assert hash(p) == hash(named)
    assert p.hash_hex() != p.replace(k_b=5999.0).hash_hex()
    assert p != "orange_80_6000"
    hashes = {load_joint_file(name).hash_hex() for name in joint_names()}
    assert len(hashes) == len(joint_names())


def test_file_hash_covers_effects_and_sensors(tmp_path: Path) -> None:
    text = entries('k_b = { value = 6000.0, unit = "N m/rad" }')
    effect = '[effects.coulomb]\nbody = "motor"\nd_cm = { value = 1.0, unit = "N m" }\n'
    sensor = '[sensors.q_m]\nnoise = { value = 1.0, unit = "rad" }\n'
    parts = (text, text + effect, text + sensor, text + effect.replace("motor", "gear"))
    hashes = [load_joint_file(write(tmp_path, part)).hash_hex() for part in parts]
    assert len(set(hashes)) == 4


def test_files_are_values() -> None:
    file = load_joint_file("emps")
    assert pickle.loads(pickle.dumps(file)) == file
    assert copy.deepcopy(file) == file
    assert hash(file) == hash(load_joint_file("emps"))
    with pytest.raises(TypeError):
        file.parameters.quantities["k_b"] = Quantity(1.0, "N/m")  # type: ignore[index]


def test_from_values_takes_usual_units() -> None:
    rotary = JointParameters.from_values("mine", {"k_b": 1.0, "k_t": 2.0})
    prismatic = JointParameters.from_values("mine", {"k_b": 1.0, "k_t": 2.0}, axis="prismatic")
    assert [rotary.unit(s) for s in ("k_b", "k_t", "I_m")] == ["N m/rad", "N m/A", "kg m^2"]
    assert [prismatic.unit(s) for s in ("k_b", "k_t", "I_m")] == ["N/m", "N/A", "kg"]
    assert rotary != prismatic


# --- round trip ---------------------------------------------------------------------------------

TEXT = st.text(st.characters(exclude_categories=["Cs"]), min_size=1).filter(
    lambda s: bool(s.strip())
)
NUMBER = st.floats(allow_nan=False, allow_infinity=False).map(lambda x: x + 0.0)


def quantities(
    unit: st.SearchStrategy[str], value: st.SearchStrategy[Any]
) -> st.SearchStrategy[Quantity]:
    tolerance = st.floats(0.0, WIDEST).map(lambda x: x + 0.0)
    known = st.builds(Quantity, value, unit, st.just("") | TEXT, st.none() | tolerance)
    return known | st.builds(Quantity, value, unit, guess=st.booleans())


@st.composite
def parameter_sets(draw: st.DrawFn) -> JointParameters:
    axis = draw(st.sampled_from(AXES))
    chosen = draw(st.sets(st.sampled_from(sorted(PARAMETERS))))
    values = {}
    for symbol in sorted(chosen):
        spec = PARAMETERS[symbol]
        number = st.floats(spec.minimum, 1e300, exclude_min=spec.exclusive).map(lambda x: x + 0.0)
        quantity = draw(quantities(st.sampled_from(spec.units[axis]), number))
        negative = symbol.endswith("_n")
        values[symbol] = Quantity(
            quantity.value, quantity.unit, quantity.source, quantity.tolerance, negative
        )
    if "k_t" in values and "i_p" in values:
        volts = values["k_t"].unit.endswith("/V")
        values["i_p"] = replace(values["i_p"], unit="V" if volts else "A")
    if axis == "prismatic" and {"k_t", "n"} <= values.keys():
        rotary = values["k_t"].unit.startswith("N m/")
        values["n"] = replace(values["n"], unit="rad/m" if rotary else "-")
    return JointParameters(draw(TEXT), draw(TEXT), values, axis)


@st.composite
def joint_files(draw: st.DrawFn) -> JointFile:
    p = draw(parameter_sets())
    lists = NUMBER | st.lists(NUMBER).map(tuple)
    setting = quantities(TEXT, lists) | TEXT
    effects = st.dictionaries(TEXT, st.dictionaries(TEXT, setting, max_size=3), max_size=3)
    positive = st.floats(0.0, 1e300).map(lambda x: x + 0.0)
    sensors = {}
    for channel, units in sensor_units(p.axis).items():
        entry = quantities(st.sampled_from(units), positive)
        sensors[channel] = draw(st.dictionaries(st.sampled_from(SENSOR_KEYS), entry))
    sampling = st.dictionaries(
        st.sampled_from(sorted(SAMPLING_KEYS)), quantities(st.just("s"), positive)
    )
    return JointFile(p, draw(effects), sensors, draw(sampling))


@settings(deadline=None, max_examples=50)
@given(joint_files())
def test_written_file_reads_back_equal(file: JointFile) -> None:
    mistakes = Mistakes("text")
    found = parse_document(to_toml(file), "text", mistakes)
    mistakes.check()
    p = JointParameters(found["name"], found["source"], found["parameters"], found["axis"])
    read = JointFile(p, found["effects"], found["sensors"], found["sampling"])
    assert read == file
    assert read.hash_hex() == file.hash_hex()
    assert p.quantities == file.parameters.quantities
    assert (p.name, p.source) == (file.parameters.name, file.parameters.source)


@pytest.mark.parametrize("name", joint_names())
def test_shipped_file_survives_writing(name: str, tmp_path: Path) -> None:
    file = load_joint_file(name)
    read = load_joint_file(write(tmp_path, to_toml(file)))
    assert read == file
    assert read.parameters.quantities == file.parameters.quantities
    assert to_toml(read) == to_toml(file)


def test_a_joint_prints_on_one_short_line() -> None:
    joint = load_joint("orange_80_6000", "output_fixed", effects=["coulomb"])
    assert repr(joint) == "<Joint orange_80_6000: output_fixed, current, effects: coulomb>"
    assert "k_b = 6000 N m/rad" in repr(joint.parameters)
    record = joint.simulate(np.zeros(10))
    assert repr(record).startswith("<Record of orange_80_6000: 10 samples, 0.001 s, t, i_cmd")
    for shown in (joint.file, record):
        assert len(repr(shown)) < 300
