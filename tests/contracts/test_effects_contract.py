"""What every row of the effect table keeps; a new row is covered without a change here."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from cjt_gym.errors import ParameterError, UnknownNameError
from cjt_gym.joint import EFFECTS, STAGES, Effect, EffectParameter, Joint, load_joint
from cjt_gym.joint.configure import FIELDS
from cjt_gym.records import Record

ROWS = pytest.mark.parametrize("effect", EFFECTS.values(), ids=lambda effect: effect.name)
NAME, STRUCTURE = "generic", "full_dynamics"
MEASURED = ("i", "q_m", "q_g", "q_l", "dq_m", "dq_g", "dq_l", "tau")
WITH_BODIES = [(e.name, body) for e in EFFECTS.values() for body in e.bodies]
WITH_CHANNELS = [(e.name, channel) for e in EFFECTS.values() for channel in e.channels]
EXCLUSIONS = [(e.name, other) for e in EFFECTS.values() for other in e.excludes]


def inside(parameter: EffectParameter) -> Any:
    """Return a value well inside the plausible range, and not zero."""
    value = parameter.low + 0.3 * (parameter.high - parameter.low)
    return (value, value) if parameter.series else value


def neutral(parameter: EffectParameter, joint: Joint) -> Any:
    """Return the value that leaves the joint alone; a relative one is that of its partner."""
    value = parameter.neutral or 0.0
    if parameter.relative_to is not None:
        value = joint.parameters.get(parameter.relative_to, 0.0)
    return (value, value) if parameter.series else value


def driven(effects: Any) -> Record:
    """Return 0.2 s of a joint that moves, turns and is loaded."""
    t = np.arange(200) * 1e-3
    tau_m, load = 60.0 * np.sin(2 * np.pi * 9.0 * t), 20.0 * np.cos(2 * np.pi * 6.0 * t)
    return load_joint(NAME, STRUCTURE, effects=effects).simulate(tau_m, load, dt_physics=1e-4)


def differs(one: Record, other: Record) -> bool:
    return any(not np.array_equal(one[name], other[name]) for name in MEASURED)


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


@ROWS
def test_only_effects_that_exclude_each_other_share_a_field(effect: Effect) -> None:
    def fields(of: Effect) -> set[str]:
        return {field for p in of.parameters for field in p.fields}

    for other in EFFECTS.values():
        if other is not effect:
            shared = fields(effect) & fields(other)
            assert bool(shared) == (other.name in effect.excludes), other.name
            assert (other.name in effect.excludes) == (effect.name in other.excludes)


# ---------------------------------------------------------------------------- what they do


@ROWS
def test_a_plausible_value_changes_what_is_measured(effect: Effect) -> None:
    values = {p.symbol: inside(p) for p in effect.parameters}
    assert differs(driven({effect.name: values}), driven({}))


def refusal(effects: Any) -> str | None:
    """Return the message with which a joint with these effects is refused, if it is."""
    try:
        load_joint(NAME, STRUCTURE, effects=effects)
    except ParameterError as error:
        return str(error)
    return None


@ROWS
def test_the_neutral_value_is_refused_or_changes_nothing(effect: Effect) -> None:
    joint = load_joint(NAME, STRUCTURE, effects={})
    spec = {effect.name: {p.symbol: neutral(p, joint) for p in effect.parameters}}
    message = refusal(spec)
    if message is not None:
        assert f"Effect {effect.name} " in message
        assert "would do nothing" in message
    else:
        record, ideal = driven(spec), driven({})
        for name in MEASURED:
            np.testing.assert_array_equal(record[name], ideal[name], err_msg=name)


@ROWS
def test_it_acts_in_its_stage(effect: Effect) -> None:
    """Sensing leaves the motion alone; all other stages change it."""
    values = {p.symbol: inside(p) for p in effect.parameters}
    one, ideal = driven({effect.name: values}), driven({})
    moved = not np.array_equal(one["true_q_m"], ideal["true_q_m"])
    assert moved == (effect.stage != "sensing")


@ROWS
def test_a_joint_file_can_list_it(effect: Effect, tmp_path: Any) -> None:
    """A file with the effect gives the same joint as the argument."""
    values = {p.symbol: inside(p) for p in effect.parameters}
    lines = ['name = "listed"', 'source = "test"', "[parameters]"]
    for symbol, q in load_joint(NAME, effects={}).parameters.quantities.items():
        lines.append(f'{symbol} = {{ value = {q.value!r}, unit = "{q.unit}" }}')
    lines.append(f"[effects.{effect.name}]")
    for p in effect.parameters:
        value = list(values[p.symbol]) if p.series else values[p.symbol]
        lines.append(f'{p.symbol} = {{ value = {value}, unit = "{p.unit}" }}')
    path = tmp_path / "listed.toml"
    path.write_text("\n".join(lines))
    listed, given = load_joint(path), load_joint(NAME, effects={effect.name: values})
    assert listed.effects == given.effects


# ------------------------------------------------------------------------- bodies, channels


@pytest.mark.parametrize(("name", "body"), WITH_BODIES)
def test_friction_acts_on_the_body_that_is_chosen(name: str, body: str) -> None:
    effect, letter = EFFECTS[name], body[0]
    own = [p for p in effect.parameters if p.symbol.removesuffix("_n").endswith(letter)]
    values = {p.symbol: inside(p) for p in own}
    joint = load_joint(NAME, STRUCTURE, effects={name: {"body": body, **values}})
    torque = joint.nonlinear_torque(np.zeros(3), np.array([-1.0, -1.0, -1.0]))
    np.testing.assert_array_equal(torque > 0.0, [b == body for b in ("motor", "gear", "load")])


@pytest.mark.parametrize(("name", "channel"), WITH_CHANNELS)
def test_a_sensor_effect_acts_on_the_channel_that_is_chosen(name: str, channel: str) -> None:
    parameter = EFFECTS[name].parameter(channel)
    assert parameter is not None
    record = driven({name: {"channel": channel, "value": inside(parameter)}})
    ideal = driven({})
    changed = {c for c in MEASURED if not np.array_equal(record[c], ideal[c])}
    assert changed == {channel}


@pytest.mark.parametrize("name", sorted({name for name, _ in WITH_BODIES}))
def test_an_unknown_body_is_refused(name: str) -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'motor'"):
        load_joint(NAME, STRUCTURE, effects={name: {"body": "moter"}})


@pytest.mark.parametrize("name", sorted({name for name, _ in WITH_CHANNELS}))
def test_an_unknown_channel_is_refused(name: str) -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'q_m'"):
        load_joint(NAME, STRUCTURE, effects={name: {"channel": "q_mm", "value": 0.1}})


# --------------------------------------------------------------------------------- refusals


@ROWS
def test_a_misspelt_name_gets_a_suggestion(effect: Effect) -> None:
    with pytest.raises(UnknownNameError, match=f"Did you mean '{effect.name}'"):
        load_joint(NAME, STRUCTURE, effects=[effect.name + "x"])


@ROWS
def test_a_misspelt_parameter_gets_a_suggestion(effect: Effect) -> None:
    symbol = max((p.symbol for p in effect.parameters), key=len)
    with pytest.raises(UnknownNameError) as caught:
        load_joint(NAME, STRUCTURE, effects={effect.name: {symbol + "x": 1.0}})
    assert effect.name in str(caught.value)
    assert symbol in str(caught.value)


@ROWS
@pytest.mark.parametrize("bad", [math.nan, math.inf, "much"])
def test_a_value_that_is_no_number_is_refused(effect: Effect, bad: Any) -> None:
    for p in effect.parameters:
        values = {other.symbol: inside(other) for other in effect.parameters}
        values[p.symbol] = (bad, bad) if p.series else bad
        with pytest.raises(ParameterError, match=f"{effect.name}.{p.symbol}"):
            load_joint(NAME, STRUCTURE, effects={effect.name: values})


@ROWS
def test_a_negative_value_is_refused_where_none_can_be(effect: Effect) -> None:
    for p in effect.parameters:
        if p.low >= 0.0 and not p.series:
            values = {other.symbol: inside(other) for other in effect.parameters}
            with pytest.raises(ParameterError, match=f"{effect.name}.{p.symbol}.*>= 0.*got -"):
                load_joint(NAME, STRUCTURE, effects={effect.name: values | {p.symbol: -1.0}})


@pytest.mark.parametrize(("name", "other"), EXCLUSIONS)
def test_effects_that_set_the_same_levels_are_refused_together(name: str, other: str) -> None:
    with pytest.raises(ParameterError, match="Keep one"):
        load_joint(NAME, STRUCTURE, effects=[name, other])


def test_series_of_unequal_length_are_refused() -> None:
    with pytest.raises(ParameterError, match="equal length"):
        load_joint(NAME, effects={"cogging": {"f": (100.0, 200.0), "a": (0.1,), "b": (0.1,)}})


def test_a_value_without_default_is_asked_for() -> None:
    with pytest.raises(ParameterError, match=r"command_delay\.delay .*absent.*Give it in effects="):
        load_joint(NAME, effects=["command_delay"])


def test_no_damping_in_one_direction_is_an_effect() -> None:
    """Zero is far from neutral for a joint that has damping."""
    joint = load_joint(NAME, effects={"viscous_asym": {"d_m_n": 0.0, "d_g_n": 0.0, "d_l_n": 0.0}})
    torque = joint.nonlinear_torque(np.zeros(3), np.full(3, -1.0))
    np.testing.assert_allclose(torque, [-joint.parameters.d_m, 0.0, 0.0], atol=1e-12)


def test_a_level_that_is_given_moves_the_other_direction_along() -> None:
    """The file's level for negative velocity is for its own positive one."""
    given = load_joint(NAME, STRUCTURE, effects={"coulomb_asym": {"d_cm": 1.0}})
    assert given.effects["coulomb_asym"]["d_cm_n"] == 1.0
    both = load_joint(NAME, STRUCTURE, effects={"coulomb_asym": {"d_cm": 1.0, "d_cm_n": 2.0}})
    assert both.effects["coulomb_asym"]["d_cm_n"] == 2.0
