"""Scores of diagnoses made up by hand, whose right values can be counted on one's fingers."""

from __future__ import annotations

from typing import Any

import pytest

from cjt_gym.blind.compare import compare
from cjt_gym.blind.rates import mean, rate, reliability
from cjt_gym.blind.score import FAILED, NONE, OUTSIDE, agrees, score_case, summarise
from cjt_gym.blind.table import COUNTED, table


def label(*effects: str, outside: tuple[str, ...] = (), **more: Any) -> dict[str, Any]:
    return {"effects": list(effects), "outside_the_table": list(outside)} | more


def named(*names: str, verdict: str = "explained", **more: Any) -> dict[str, Any]:
    """Return a diagnosis; a name with a question mark is tentative."""
    effects = [
        {
            "name": name.rstrip("?"),
            "status": "tentative" if name.endswith("?") else "confirmed",
            "confidence": 0.5 if name.endswith("?") else 0.9,
            "body": None,
            "channel": None,
            "parameters": {},
        }
        for name in names
    ]
    return {"effects": effects, "verdict": verdict, "seconds": 2.0} | more


def score(key: dict[str, Any], result: dict[str, Any]) -> dict[str, Any]:
    return score_case("case", key, result)


def test_right_name() -> None:
    row = score(label("coulomb"), named("coulomb"))
    assert (row["first_right"], row["exact"], row["f1"]) == (True, True, 1.0)
    assert row["true_and_first"] == ["coulomb", "coulomb"]


def test_one_of_two_and_one_too_many() -> None:
    row = score(label("coulomb", "cogging"), named("cogging", "stribeck"))
    assert (row["first_right"], row["exact"], row["f1"]) == (True, False, 0.5)
    assert row["wrong_confirmed"] == ["stribeck"]
    assert row["true_and_first"] == ["cogging", "cogging"]


def test_silence_is_right_only_where_nothing_is() -> None:
    assert score(label(), named(verdict="no_gap"))["f1"] == 1.0
    row = score(label("coulomb"), named(verdict="no_gap"))
    assert (row["f1"], row["first_right"]) == (0.0, False)
    assert row["true_and_first"] == ["coulomb", NONE]


def test_outside_the_table() -> None:
    row = score(label(outside=("creep",)), named("stiffness?", verdict="partly_explained"))
    assert (row["recognised"], row["wrong_confirmed"], row["wrong"]) == (True, [], ["stiffness"])
    assert row["true_and_first"] == [OUTSIDE, "stiffness"]


def test_no_name_is_right_where_the_table_has_none() -> None:
    assert agrees(OUTSIDE, NONE)
    assert agrees("coulomb", "coulomb")
    assert not agrees("coulomb", NONE)
    assert not agrees(OUTSIDE, "coulomb")


def test_offset_and_bias_of_a_locked_joint_are_one() -> None:
    key = label("torque_bias", structure="output_fixed")
    assert score(key, named("torque_offset"))["exact"]
    assert not score(key, named("torque_offset", "torque_gain"))["exact"]
    assert not score(key | {"structure": "full_dynamics"}, named("torque_offset"))["exact"]
    both = score(key, named("torque_offset", "torque_bias"))
    assert both["f1"] == 1.0, "two names for one effect"


def test_invisible_effects_count_apart() -> None:
    hidden = score(label("coulomb", signature={"coulomb": 1.0}), named(verdict="no_gap"))
    plain = score(label("damping", signature={"damping": 50.0}), named("damping"))
    summary = summarise([hidden, plain])
    assert summary["first_right"]["known"]["total"] == 1
    assert summary["invisible"]["silent"]["hits"] == summary["invisible"]["cases"] == 1


def test_what_check_excludes_is_counted_with_and_without() -> None:
    said = {"record": {"cannot_tell": [{"name": "gear_ripple", "why": "tau is not recorded"}]}}
    rows = [
        score(label("gear_ripple"), named(verdict="unexplained") | said),
        score(label("gear_ripple", "damping"), named("damping") | said),
        score(label("coulomb"), named(verdict="no_gap") | said),
    ]
    first = summarise(rows)["first_right"]
    assert (first["known"]["hits"], first["known"]["total"]) == (1, 3)
    assert (first["not_excluded"]["hits"], first["not_excluded"]["total"]) == (1, 2)


def test_summary_counts() -> None:
    rows = [
        score(label("coulomb"), named("coulomb")),
        score(label("coulomb"), named("stribeck")),
        score(label("cogging", "hardening"), named("hardening", "cogging")),
        score(label(), named("noise")),
        score(label(), named(verdict="no_gap")),
        score(label(outside=("creep",)), named("stiffness", verdict="unexplained")),
        score(label("noise", outside=("creep",)), named("noise", verdict="explained")),
        score(label("noise"), {"error": "RecordError: broken"}),
    ]
    s = summarise(rows)
    assert s["failed"] == 1
    assert (s["first_right"]["known"]["hits"], s["first_right"]["known"]["total"]) == (2, 4)
    assert (s["exact"]["hits"], s["f1"]["mean"]) == (2, 0.5)
    assert (s["false_alarms"]["hits"], s["false_alarms"]["total"]) == (1, 2)
    assert (s["outside"]["recognised"]["hits"], s["outside"]["recognised"]["total"]) == (1, 2)
    assert s["outside"]["known_beside_named"]["hits"] == 1
    assert s["wrong_confirmed"]["with_outside"]["hits"] == 1
    assert s["wrong_confirmed"]["without_outside"]["hits"] == 2
    assert ["coulomb", "stribeck", 1] in s["confusion"]["counts"]
    assert ["noise", FAILED, 1] in s["confusion"]["counts"]
    assert sum(count for _, _, count in s["confusion"]["counts"]) == len(rows)
    assert s["seconds"]["median"] == 2.0


@pytest.mark.parametrize(
    ("hits", "total", "low", "high"),
    [(0, 10, 0.0, 0.2775), (5, 10, 0.2366, 0.7634), (10, 10, 0.7225, 1.0), (0, 0, 0.0, 1.0)],
)
def test_wilson(hits: int, total: int, low: float, high: float) -> None:
    """Newcombe (1998), Statistics in Medicine 17, method 3."""
    found = rate([True] * hits + [False] * (total - hits))
    assert (found["low"], found["high"]) == pytest.approx((low, high), abs=1e-4)


def test_no_case_has_no_share() -> None:
    assert rate([])["share"] is None
    assert mean([])["mean"] is None


def test_calibration_error() -> None:
    perfect = reliability([0.75] * 4, [True, True, True, False])
    assert perfect["error"] == pytest.approx(0.0)
    boastful = reliability([0.99] * 4 + [0.55] * 2, [True, True, False, False, True, False])
    assert [b["total"] for b in boastful["bins"]] == [2, 4]
    assert boastful["error"] == pytest.approx((2 * 0.05 + 4 * 0.49) / 6)
    assert reliability([1.0, 0.0], [True, False])["error"] == pytest.approx(0.0)
    assert reliability([], [])["error"] is None


def true_label(name: str, structure: str = "full_dynamics", **values: float) -> dict[str, Any]:
    return {
        "effects": [name],
        "parameters": {name: values},
        "places": {},
        "structure": structure,
        "true": {"I_g": 0.12, "d_g": 2.5, "d_l": 0.5, "k_b": 5000.0},
        "stated": {"I_g": 0.1, "d_g": 2.0, "d_m": 0.2, "k_b": 5100.0},
    }


def effect(name: str, body: str | None = None, **numbers: tuple[float, float]) -> dict[str, Any]:
    return {
        "name": name,
        "body": body,
        "channel": None,
        "parameters": {
            key: {"value": 0.5 * (low + high), "low": low, "high": high}
            for key, (low, high) in numbers.items()
        },
    }


def test_same_symbols_are_compared() -> None:
    key = true_label("stribeck", d_cm=2.0, d_sm=1.0, v_s=0.1) | {"places": {"stribeck": "motor"}}
    given = effect("stribeck", "motor", d_cm=(1.9, 2.1), d_sm=(0.5, 0.9), v_s=(0.05, 0.2))
    rows = {row["parameter"]: row for row in compare(key, given)}
    assert rows["d_cm"]["covered"]
    assert rows["v_s"]["covered"]
    assert (rows["d_sm"]["true"], rows["d_sm"]["covered"]) == (1.0, False)


def test_wrong_place_or_name_has_no_numbers() -> None:
    key = true_label("coulomb", d_cm=2.0) | {"places": {"coulomb": "motor"}}
    assert compare(key, effect("coulomb", "gear", d_cg=(1.0, 3.0))) == []
    assert compare(key, effect("stribeck", "motor", d_cm=(1.0, 3.0))) == []


def test_ripple_is_compared_by_its_size() -> None:
    key = true_label("cogging", f=160.0, a=0.0, b=-5.0)
    given = effect("cogging", f=(159.0, 161.0), a=(2.9, 3.1), b=(3.9, 4.1))
    rows = {row["parameter"]: row for row in compare(key, given)}
    assert set(rows) == {"f", "amplitude"}
    assert rows["amplitude"]["value"] == pytest.approx(5.0)
    assert rows["amplitude"]["covered"]


def test_gear_of_a_rigid_gearbox_is_part_of_the_motor() -> None:
    given = effect("inertia", I_m=(0.29, 0.33))
    (row,) = compare(true_label("inertia", "rigid_gearbox", I_m=0.3), given)
    assert row["true"] == pytest.approx(0.32)
    (row,) = compare(true_label("inertia", I_m=0.3), given)
    assert row["true"] == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("structure", "total"),
    [("full_dynamics", 1.0), ("output_fixed_rigid_gearbox", 3.5), ("rigid", 4.0)],
)
def test_damping_is_that_of_all_bodies_that_move_with_the_motor(
    structure: str, total: float
) -> None:
    (row,) = compare(true_label("damping", structure, d_m=1.0), effect("damping", d_m=(3.4, 3.6)))
    assert row["true"] == pytest.approx(total)


def test_damping_per_direction_is_that_of_all() -> None:
    key = true_label("viscous_asym", "rigid_gearbox", d_m=0.3, d_m_n=1.3)
    key |= {"places": {"viscous_asym": "motor"}}
    given = effect("viscous_asym", "motor", d_m=(0.5, 0.7), d_m_n=(1.5, 1.7))
    rows = {row["parameter"]: row["true"] for row in compare(key, given)}
    assert rows == pytest.approx({"d_m": 2.8, "d_m_n": 3.8})


def test_guessed_inertia_is_neither_wrong_nor_missing() -> None:
    guessed: dict[str, Any] = {"defects": {"guess": {}}, "not_counted": ["inertia"]}
    row = score(label("coulomb", **guessed), named("inertia", "coulomb"))
    assert (row["first_right"], row["exact"], row["wrong_confirmed"]) == (True, True, [])
    assert (row["named"], row["not_counted"]) == (["coulomb"], ["inertia"])
    assert row["confidences"] == [[0.9, True]]
    row = score(label("inertia", "coulomb", **guessed), named("coulomb"))
    assert (row["exact"], row["kind"]) == (True, "single")
    row = score(label("inertia", **guessed), named("inertia"))
    assert (row["kind"], row["f1"], row["true_and_first"]) == ("none", 1.0, [NONE, NONE])
    assert not score(label("inertia", **guessed), named("damping"))["exact"]


def test_noise_above_what_is_stated_is_right_in_its_channel_only() -> None:
    key = label(defects={"noise": {}}, not_counted=["noise:tau"])
    noise = named("noise")
    for channel, wrong in (("tau", []), ("q_m", ["noise"])):
        noise["effects"][0]["channel"] = channel
        assert score(key, noise)["wrong_confirmed"] == wrong


def test_score_by_defect() -> None:
    gaps, noise = {"defects": {"gaps": {}}}, {"defects": {"gaps": {}, "noise": {}}}
    rows = [
        score(label("coulomb", **gaps), named("coulomb")),
        score(label("coulomb", **noise), named("stribeck")),
        score(label(**gaps), named(verdict="no_gap")),
        score(label(**noise), named("noise?")),
        score(label("cogging", outside=("creep",), **gaps), named("cogging", "stiffness?")),
        score(label(**gaps), {"error": "RecordError: broken"}),
    ]
    found = summarise(rows)["defects"]
    counts = {
        kind: [of["cases"], *((of[k]["hits"], of[k]["total"]) for k in COUNTED)]
        for kind, of in found.items()
    }
    assert counts == {
        "noise": [2, (0, 1), (0, 1), (1, 2), (0, 1)],
        "gaps": [6, (2, 3), (1, 3), (4, 6), (1, 3)],
        "known_and_unknown": [1, (1, 1), (0, 1), (1, 1), (0, 0)],
        "all": [6, (2, 3), (1, 3), (4, 6), (1, 3)],
    }
    lines = table(summarise(rows)).splitlines()
    (line,) = [line for line in lines if line.startswith("gaps ")]
    shares = "2 of 3, 67 %  1 of 3, 33 %  4 of 6, 67 %  1 of 3, 33 %"
    assert " ".join(line.split()) == " ".join(f"gaps 6 {shares}".split())


def test_clean_records_have_no_score_by_defect() -> None:
    mixed = score(label("cogging", outside=("creep",)), named("cogging"))
    assert summarise([mixed])["defects"] == {}
    assert "no false alarm" not in table(summarise([mixed]))
