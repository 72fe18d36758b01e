"""What every row of the effect table keeps; a new row is covered without a change here."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cjt_gym.cli import main
from cjt_gym.errors import ParameterError, UnknownNameError
from cjt_gym.joint import (
    DRIVES,
    EFFECTS,
    STAGES,
    STRUCTURES,
    Effect,
    EffectParameter,
    Joint,
    Quantity,
    load_joint,
    load_joint_file,
    to_toml,
)
from cjt_gym.joint.configure import FIELDS
from cjt_gym.joint.effects import PLACES, body_of
from cjt_gym.joint.files.parameter_table import axis_units
from cjt_gym.records import Record
from tests.physics.cases import typical

ROWS = pytest.mark.parametrize("effect", EFFECTS.values(), ids=lambda effect: effect.name)
NAME = "orange_80_6000"
LOADED = {"I_l": 0.5}
MEASURED = ("i", "q_m", "q_g", "q_l", "dq_m", "dq_g", "dq_l", "tau")
RATES = {"q_m": "dq_m", "q_g": "dq_g", "q_l": "dq_l"}
WITH_BODIES = [(e.name, body) for e in EFFECTS.values() for body in e.bodies]
WITH_CHANNELS = [(e.name, channel) for e in EFFECTS.values() for channel in e.channels]
EXCLUSIONS = [(e.name, other) for e in EFFECTS.values() for other in e.excludes]


def made(effect: Effect, effects: Any, **more: Any) -> Joint:
    """Return a joint in which that effect can act, with these effects."""
    drive = "static" if effect.needs == "voltage" else "current"
    structure = "output_fixed" if effect.needs == "fixed_load" else "full_dynamics"
    return load_joint(NAME, structure, drive, effects=effects, **more)


def neutral(parameter: EffectParameter) -> Any:
    """Return the value that leaves the joint alone; a relative one is that of its partner."""
    value = parameter.neutral or 0.0
    if parameter.relative_to is not None:
        p = load_joint_file(NAME).parameters.replace(**LOADED)
        value = p.get(parameter.relative_to, 0.0)
    return (value, value) if parameter.series else value


def at_rest(effect: Effect) -> dict[str, Any]:
    """Return typical values with those that give the effect its size made neutral."""
    off = {p.symbol: neutral(p) for p in effect.parameters if p.symbol in effect.size}
    return {**typical(effect), **off}


def driven(effect: Effect, effects: Any) -> Record:
    """Return 0.2 s of a joint that moves, turns, is loaded and asks for its peak current."""
    t = np.arange(200) * 1e-3
    tau_m = 150.0 * np.sin(2 * np.pi * 9.0 * t)
    joint = made(effect, effects, parameters=LOADED)
    push = 0.2 if joint.structure_row.output_fixed else 20.0
    return joint.simulate(tau_m, push * np.cos(2 * np.pi * 6.0 * t), dt_physics=1e-4)


def linear_damping(joint: Joint) -> Any:
    record, _ = joint.packed()
    return np.array([record[name][0] for name in ("d_m", "d_g", "d_l")])


def differs(one: Record, other: Record) -> bool:
    return any(not np.array_equal(one[name], other[name]) for name in MEASURED)


NO_NONLINEAR_TORQUE = {
    **dict.fromkeys(("torque_constant", "thermal_derating", "commutation_ripple"), "of a current"),
    **dict.fromkeys(("inertia", "load_inertia", "damping"), "linear"),
    **dict.fromkeys(("load_motion", "human_torque"), "over time"),
}
"""Effects of motor and load that add no nonlinear torque of position and speed, and of what."""


# ------------------------------------------------------------------------------- the rows


def test_names_are_keys() -> None:
    assert [effect.name for effect in EFFECTS.values()] == list(EFFECTS)


@ROWS
def test_row_says_where_what_and_whence(effect: Effect) -> None:
    assert effect.stage in STAGES
    assert effect.summary.endswith(".")
    assert effect.source
    assert effect.parameters
    symbols = [p.symbol for p in effect.parameters]
    assert len(set(symbols)) == len(symbols)


@ROWS
def test_parameters_have_unit_neutral_value_and_range(effect: Effect) -> None:
    for p in effect.parameters:
        assert p.unit
        assert p.description
        assert (p.neutral is None) == (p.relative_to is not None)
        assert p.neutral is None or math.isfinite(p.neutral)
        assert -math.inf < p.low < p.high < math.inf
        assert p.low >= 0.0 or p.low == -p.high, f"{p.symbol}: a signed range is symmetric"
        assert set(p.fields) <= set(FIELDS)
    assert set(effect.size) <= {p.symbol for p in effect.parameters}
    assert effect.needs in PLACES


@ROWS
def test_a_typical_value_is_within_the_plausible_range(effect: Effect) -> None:
    values = typical(effect)
    for p in effect.parameters:
        assert np.all(np.asarray(values[p.symbol]) >= p.low) or values[p.symbol] == neutral(p)
        assert np.all(np.asarray(values[p.symbol]) <= p.high)


def test_every_effect_that_can_act_is_in_all() -> None:
    for structure in STRUCTURES.values():
        for drive in DRIVES:
            active = set(load_joint(NAME, structure.name, drive, effects="all").effects)
            able = {e.name for e in EFFECTS.values() if e.acts_in(structure, drive)}
            assert active == able - {"coulomb_asym"}


def test_all_can_be_given_beside_values() -> None:
    joint = load_joint(NAME, effects={"all": {}, "coulomb_asym": {"d_cm": 1.5}})
    assert joint.effects["coulomb_asym"]["d_cm"] == 1.5
    assert "coulomb" not in joint.effects
    assert {"stribeck", "cogging", "noise"} <= set(joint.effects)


@ROWS
def test_an_effect_that_cannot_act_is_refused(effect: Effect) -> None:
    for structure in STRUCTURES.values():
        if not effect.acts_in(structure, "current"):
            with pytest.raises(ParameterError, match=f"Effect {effect.name} .* needs a"):
                load_joint(NAME, structure.name, effects={effect.name: typical(effect)})


# ---------------------------------------------------------------------------- what they do


@ROWS
def test_a_typical_value_changes_what_is_measured(effect: Effect) -> None:
    assert differs(driven(effect, {effect.name: typical(effect)}), driven(effect, {}))


@ROWS
def test_the_neutral_value_changes_nothing(effect: Effect) -> None:
    record, ideal = driven(effect, {effect.name: at_rest(effect)}), driven(effect, {})
    for name in MEASURED:
        np.testing.assert_array_equal(record[name], ideal[name], err_msg=name)


@ROWS
def test_it_acts_in_its_stage(effect: Effect) -> None:
    """Sensing leaves the motion alone; all other stages change it."""
    one, ideal = driven(effect, {effect.name: typical(effect)}), driven(effect, {})
    moved = not np.array_equal(one["true_q_m"], ideal["true_q_m"])
    assert moved == (effect.stage != "sensing")


@ROWS
def test_a_joint_file_can_list_it(effect: Effect, tmp_path: Any) -> None:
    """A file with the effect gives the same joint as the argument."""
    values = typical(effect)
    entries = {p.symbol: Quantity(values[p.symbol], p.unit) for p in effect.parameters}
    file = replace(load_joint_file(NAME), effects={effect.name: entries})
    path = tmp_path / "listed.toml"
    path.write_text(to_toml(file))
    given = made(effect, {effect.name: values})
    listed = load_joint(path, given.structure, given.drive)
    assert listed.effects == given.effects


# ------------------------------------------------------------------------- bodies, channels


@pytest.mark.parametrize(("name", "body"), WITH_BODIES)
def test_friction_acts_on_the_body_that_is_chosen(name: str, body: str) -> None:
    """A joint with friction on one body alone loses its speed there alone."""
    effect = EFFECTS[name]
    own = [p for p in effect.parameters if body_of(p.symbol) == body and p.low == 0.0]
    values = {p.symbol: 0.3 * p.high for p in own if p.symbol[:2] != "si"}
    values |= {p.symbol: 1e4 for p in own if p.symbol[:2] == "si"}
    values |= {"v_s": 0.05} if effect.parameter("v_s") else {}
    joint = load_joint(NAME, "full_dynamics", effects={name: {"body": body, **values}})
    at, still = np.zeros(3), np.full(3, -1.0)
    torque = joint.nonlinear_torque(at, still, tau=10.0)
    changed = linear_damping(joint) - linear_damping(load_joint(NAME, effects={}))
    np.testing.assert_array_equal(
        (torque > 0.0) | (changed != 0.0), [b == body for b in ("motor", "gear", "load")]
    )


@pytest.mark.parametrize(("name", "channel"), WITH_CHANNELS)
def test_a_sensor_effect_acts_on_the_channel_that_is_chosen(name: str, channel: str) -> None:
    effect = EFFECTS[name]
    parameter = effect.parameter(channel)
    assert parameter is not None
    value = 0.3 * parameter.high if parameter.neutral == 0.0 else 1.1
    record = driven(effect, {name: {"channel": channel, "value": value}})
    ideal = driven(effect, {})
    changed = {c for c in MEASURED if not np.array_equal(record[c], ideal[c])}
    assert channel in changed
    assert changed <= {channel, RATES.get(channel, channel)}


@pytest.mark.parametrize("name", sorted({name for name, _ in WITH_BODIES}))
def test_an_unknown_body_is_refused(name: str) -> None:
    with pytest.raises(UnknownNameError, match="body of effect"):
        load_joint(NAME, "full_dynamics", effects={name: {"body": "moter"}})


@pytest.mark.parametrize("name", sorted({name for name, _ in WITH_CHANNELS}))
def test_an_unknown_channel_is_refused(name: str) -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'q_m'"):
        load_joint(NAME, effects={name: {"channel": "q_mm", "value": 0.1}})


# --------------------------------------------------------------------------------- refusals


@ROWS
def test_a_misspelt_name_gets_a_suggestion(effect: Effect) -> None:
    with pytest.raises(UnknownNameError, match=f"Did you mean '{effect.name}'"):
        load_joint(NAME, effects=[effect.name + "x"])


@ROWS
def test_a_misspelt_parameter_gets_a_suggestion(effect: Effect) -> None:
    symbol = max((p.symbol for p in effect.parameters), key=len)
    with pytest.raises(UnknownNameError) as caught:
        made(effect, {effect.name: {symbol + "x": 1.0}})
    assert effect.name in str(caught.value)
    assert symbol in str(caught.value)


@ROWS
@pytest.mark.parametrize("bad", [math.nan, math.inf, "much"])
def test_a_value_that_is_no_number_is_refused(effect: Effect, bad: Any) -> None:
    for p in effect.parameters:
        values = typical(effect)
        values[p.symbol] = (bad, bad) if p.series else bad
        with pytest.raises(ParameterError, match=f"{effect.name}.{p.symbol}"):
            made(effect, {effect.name: values})


@ROWS
def test_a_negative_value_is_refused_where_none_can_be(effect: Effect) -> None:
    for p in effect.parameters:
        if p.low >= 0.0:
            values = typical(effect)
            with pytest.raises(ParameterError, match=f"{effect.name}.{p.symbol}.*>=? 0.*got -"):
                made(effect, {effect.name: values | {p.symbol: -1.0}})


@pytest.mark.parametrize(("name", "other"), EXCLUSIONS)
def test_effects_that_set_the_same_levels_are_refused_together(name: str, other: str) -> None:
    with pytest.raises(ParameterError, match="Keep one"):
        load_joint(NAME, effects=[name, other])


def test_series_of_unequal_length_are_refused() -> None:
    with pytest.raises(ParameterError, match="equal length"):
        load_joint(NAME, effects={"cogging": {"f": (100.0, 200.0), "a": (0.1,), "b": (0.1,)}})


@pytest.mark.parametrize(
    ("effects", "words"),
    [
        (
            {"current_lag": {"bandwidth": (-300.0, "Hz")}, "cogging": {"f": ((-1.0,), "1/rev")}},
            ["current_lag.bandwidth of", ">= 0 Hz", "cogging.f of", "> 0 1/rev"],
        ),
        (
            {"command_delay": {}, "cogging": {"f": ((1.0, 2.0), "1/rev"), "a": (1.0, "N m")}},
            ["command_delay.delay of", "cogging.b of"],
        ),
    ],
)
def test_a_file_is_shown_all_mistakes_in_the_values_of_its_effects(
    effects: Any, words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    listed = {name: {k: Quantity(*v) for k, v in row.items()} for name, row in effects.items()}
    path = tmp_path / "wrong.toml"
    path.write_text(to_toml(replace(load_joint_file(NAME), effects=listed)))
    assert main(["joints", str(path)]) == 2
    said = capsys.readouterr().err
    assert all(word in said for word in ["has 2 mistakes", *words])


def test_a_value_without_default_is_asked_for() -> None:
    with pytest.raises(ParameterError, match=r"command_delay\.delay .*absent.*Give it in effects="):
        load_joint(NAME, effects=["command_delay"])


def test_no_damping_in_one_direction_is_an_effect() -> None:
    """Zero is far from neutral for a joint that has damping."""
    joint = load_joint(NAME, effects={"viscous_asym": {"d_m_n": 0.0, "d_g_n": 0.0, "d_l_n": 0.0}})
    torque = joint.nonlinear_torque(np.zeros(3), np.full(3, -1.0))
    p = joint.parameters
    np.testing.assert_allclose(torque, [-p.d_m, -p.d_g, -p.d_l], atol=1e-12)


def test_a_level_that_is_given_moves_the_other_direction_along() -> None:
    """The file's level for negative velocity is for its own positive one."""
    given = load_joint(NAME, effects={"coulomb_asym": {"d_cm": 1.0}})
    assert given.effects["coulomb_asym"]["d_cm_n"] == 1.0
    both = load_joint(NAME, effects={"coulomb_asym": {"d_cm": 1.0, "d_cm_n": 2.0}})
    assert both.effects["coulomb_asym"]["d_cm_n"] == 2.0


@pytest.mark.parametrize(
    "effect", [e for e in EFFECTS.values() if e.stage in ("motor", "load")], ids=lambda e: e.name
)
def test_a_torque_of_position_or_speed_is_in_nonlinear_torque(effect: Effect) -> None:
    """`Joint.nonlinear_torque` calls the terms of the kernel one by one, and must know each."""
    rng = np.random.default_rng(0)
    q, dq, tau = rng.uniform(-3.0, 3.0, (2, 200, 3)), 2.0, rng.uniform(-30.0, 30.0, 200)
    found = [
        made(effect, effects, parameters=LOADED).nonlinear_torque(q[0], dq * q[1], tau)
        for effects in ({effect.name: typical(effect)}, {})
    ]
    assert np.array_equal(*found) == (effect.name in NO_NONLINEAR_TORQUE)


def test_no_number_of_an_effect_keeps_a_rotary_unit_on_a_prismatic_axis() -> None:
    units = {p.unit for effect in EFFECTS.values() for p in effect.parameters}
    assert "N m/rad^3" in units
    for unit in units:
        assert not any("rad" in other for other in axis_units(unit, "prismatic")), unit
