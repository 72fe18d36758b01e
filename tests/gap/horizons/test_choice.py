"""Which joint is the answer where one predicts better here and another there."""

from __future__ import annotations

from dataclasses import replace

import pytest

from cjt_gym.gap.horizons.prediction.case import make_case
from cjt_gym.gap.horizons.prediction.placement import WHOLE
from cjt_gym.gap.horizons.prediction.windows import HORIZONS, Key
from cjt_gym.gap.horizons.selection.choice import (
    WORSE_AT_FIRST,
    WORSE_AT_ONCE,
    WORSE_BY_CHANCE,
    _by_chance,
    _forgiven,
    _hardly_listens,
    _of_the_start,
)
from cjt_gym.joint import Joint, JointFile, get_structure
from cjt_gym.joint.configure import EffectValues
from cjt_gym.records import Record
from tests.gap.horizons.arm import held_record

NEAR, MIDDLE, FAR = HORIZONS


def errors(near: float, middle: float, far: float, channel: str = "q_m") -> dict[Key, float]:
    return {(channel, NEAR): near, (channel, MIDDLE): middle, (channel, FAR): far}


def test_a_clear_gain_at_the_longest_horizon_forgives_a_slight_loss_before_it() -> None:
    own, other = errors(0.32, 0.069, 0.010), errors(0.30, 0.060, 0.015)
    assert _forgiven(own, other) == {("q_m", NEAR): WORSE_AT_ONCE, ("q_m", MIDDLE): WORSE_AT_ONCE}


@pytest.mark.parametrize("far", [0.014, 0.015, 0.02])
def test_no_clear_gain_forgives_nothing(far: float) -> None:
    assert _forgiven(errors(0.32, 0.069, far), errors(0.30, 0.060, 0.015)) == {}


def test_each_channel_answers_for_itself_and_a_whole_record_for_nothing() -> None:
    own = errors(0.3, 0.1, 0.01) | errors(0.3, 0.1, 0.1, "tau") | {("tau", WHOLE): 0.2}
    other = errors(0.3, 0.1, 0.1) | errors(0.3, 0.1, 0.1, "tau") | {("tau", WHOLE): 0.9}
    assert {channel for channel, _ in _forgiven(own, other)} == {"q_m"}


def test_a_joint_far_better_beyond_the_shortest_horizon_may_be_worse_at_it() -> None:
    own, other = errors(0.109, 0.010, 0.002), errors(0.088, 0.122, 0.138)
    assert _of_the_start(own, other) == {("q_m", NEAR): WORSE_AT_FIRST}
    assert _of_the_start(errors(0.109, 0.07, 0.002), other) == {}
    assert _of_the_start({("tau", NEAR): 0.1}, {("tau", NEAR): 0.3}) == {}


def test_few_held_out_pieces_do_not_refuse_what_all_data_prefer_clearly() -> None:
    own, other = errors(0.70, 0.60, 0.20), errors(0.71, 0.75, 0.71)
    assert _by_chance(own, other) == {k: WORSE_BY_CHANCE for k in own if k[1] > NEAR}


@pytest.mark.parametrize("channel", ["i", "i_cmd"])
def test_a_limit_that_cuts_off_nearly_all_of_every_command_is_none(
    arm: JointFile, channel: str
) -> None:
    """A held trajectory goes on at its speed, which a joint that hears nothing predicts as well."""
    given = held_record(0)
    columns = {"t": given.t, "q_m": given["q_m"], channel: given["i"]}
    record = Record(columns, {"t": "s", "q_m": "rad", channel: "A"}, structure="rigid")
    case = make_case([record], [], arm, get_structure("rigid"))
    largest = float(abs(given["i"]).max())

    def deaf(share: float, constant: float = 1.0) -> bool:
        parameters = arm.parameters.replace(k_t=constant * arm.parameters.k_t)
        limit: dict[str, EffectValues] = {"current_saturation": {"i_p": share * largest}}
        file = replace(arm, parameters=parameters)
        return _hardly_listens(case, Joint(file, "rigid", "current", limit))

    assert [deaf(0.05), deaf(0.5)] == [channel == "i_cmd", False]
    assert deaf(0.3, constant=0.3) is (channel == "i_cmd")
