"""Repair: what is in order stays as it is; what is not is found, marked and said."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.signal import lfilter

from cjt_gym.blind import draw_case
from cjt_gym.errors import RecordError
from cjt_gym.records import (
    Record,
    Repair,
    clean,
    clean_pieces,
    default_units,
    read_record,
    record_names,
)
from cjt_gym.records.glitches import glitches
from cjt_gym.records.repair import make_records

Floats = NDArray[np.float64]


def motion(seed: int = 0, samples: int = 3000, noise: float = 1.0, dt: float = 1e-3) -> dict:
    """Return the columns of an orderly record: reversals, steps of the current, rest, noise."""
    rng = np.random.default_rng(seed)
    t = np.arange(samples) * dt
    levels = rng.uniform(-5.0, 5.0, samples // 200 + 1)
    i_cmd = np.repeat(levels, 200)[:samples]
    i_cmd[: samples // 10] = 0.0
    lag = np.exp(-dt / 2e-3)
    i = lfilter([1.0 - lag], [1.0, -lag], i_cmd)
    f = rng.uniform(0.5, 4.0, 4)
    rest = np.clip(t / t[-1] * 8.0 - 1.0, 0.0, 1.0)
    q_m = 0.3 * rest * sum(np.sin(2.0 * np.pi * g * t) for g in f)
    resolution = 1e-5
    tau = 40.0 * q_m + 0.01 * noise * rng.standard_normal(samples)
    return {
        "t": t,
        "i_cmd": i_cmd,
        "i": i + 0.01 * noise * rng.standard_normal(samples),
        "q_m": np.round(q_m / resolution) * resolution,
        "tau": tau,
    }


def as_record(columns: dict) -> Record:
    return Record(columns, default_units(tuple(columns)))


def kinds(repairs: tuple[Repair, ...]) -> set[tuple[str, str | None]]:
    return {(repair.kind, repair.channel) for repair in repairs}


@settings(max_examples=20, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    noise=st.sampled_from([0.0, 0.1, 1.0, 10.0]),
    samples=st.integers(200, 3000),
    dt=st.sampled_from([2.5e-4, 1e-3, 1e-2]),
)
def test_an_orderly_record_comes_back_as_it_is(
    seed: int, noise: float, samples: int, dt: float
) -> None:
    record = as_record(motion(seed, samples, noise, dt))
    cleaned, repairs = clean(record)
    assert cleaned is record
    assert not [repair.text for repair in repairs if repair.changed]


@pytest.mark.parametrize("seed", range(3))
def test_records_with_effects_are_left_alone(seed: int) -> None:
    columns = draw_case(seed, duration=2.0).diagnose.columns
    record = as_record(dict(columns))
    assert clean(record) == (record, ())


@pytest.mark.parametrize("name", record_names())
def test_shipped_records_are_left_alone(name: str) -> None:
    record = read_record(name)
    assert clean(record)[0] is record


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10**6), data=st.data())
def test_glitches_are_found_and_nothing_else_is_lost(seed: int, data: st.DataObject) -> None:
    columns = motion(seed)
    channel = data.draw(st.sampled_from(["i", "q_m", "tau"]))
    places = data.draw(
        st.lists(st.integers(30, 2960), min_size=1, max_size=8, unique_by=lambda k: k // 20)
    )
    assume(np.diff(sorted(places)).min(initial=99) > 8)  # one glitch each, not one within another
    changes = np.flatnonzero(np.diff(columns["i_cmd"]))
    spoilt = columns[channel].copy()
    jump = 2.0 * max(np.ptp(columns[channel]), 0.1)
    assume(abs(jump - 2.0 * np.pi) > 0.3)  # a jump of a turn of an angle is a wrapped counter
    false = []
    for place in places:
        assume(channel != "i" or np.abs(changes - place).min() > 15)
        length = data.draw(st.integers(1, 4))
        spoilt[place : place + length] += data.draw(st.sampled_from([-jump, jump]))
        false += list(range(place, place + length))
    record, repairs = clean(as_record({**columns, channel: spoilt}))
    assert np.flatnonzero(np.isnan(record[channel])).tolist() == sorted(false)
    assert kinds(repairs) == {("glitch", channel)}
    assert repairs[0].count == len(false)
    assert repairs[0].text in record.provenance["repairs"]
    others = [name for name in columns if name != channel]
    assert all(np.array_equal(record[name], columns[name]) for name in others)


def test_repairing_twice_changes_nothing_more() -> None:
    columns = motion()
    columns["q_m"][1000] += 9.0
    once, _ = clean(as_record(columns))
    twice, repairs = clean(once)
    assert twice == once
    assert not [repair for repair in repairs if repair.changed]


def test_pulses_of_the_command_are_no_glitches_of_the_current() -> None:
    columns = motion()
    for place in (500, 700, 901):
        columns["i_cmd"][place] += 20.0
        columns["i"][place + 2] += 20.0
    assert clean(as_record(columns))[1] == ()


def test_a_glitch_of_the_current_is_none_of_a_command_that_changes_all_the_time() -> None:
    columns = motion()
    rng = np.random.default_rng(3)
    columns["i_cmd"] = columns["i_cmd"] + 0.1 * rng.standard_normal(len(columns["t"]))
    columns["i"][1234] = -15.0 * np.abs(columns["i"]).max()
    record, repairs = clean(as_record(columns))
    assert kinds(repairs) == {("glitch", "i")}
    assert np.flatnonzero(np.isnan(record["i"])).tolist() == [1234]


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10**6), turn=st.sampled_from([2 * np.pi, 2 * np.pi / 50.0]))
def test_unwrapping_undoes_wrapping(seed: int, turn: float) -> None:
    columns = motion(seed)
    q = 10.0 * turn * (columns["q_m"] + 0.2 * columns["t"])
    assume(np.abs(np.diff(q)).max() < 0.2 * turn)
    wrapped = {"t": columns["t"], "q_m": q % turn}
    facts = {"units": default_units(("t", "q_m"))}
    (record,), repairs = make_records(wrapped, facts, {"q_m": turn})
    assert repairs[0].kind == "wrap"
    assert np.allclose(record["q_m"] - record["q_m"][0], q - q[0], atol=1e-9)


def table_of(columns: dict, rows: NDArray[np.intp]) -> dict:
    return {name: values[rows] for name, values in columns.items()}


def repaired(columns: dict) -> tuple[tuple[Record, ...], tuple[Repair, ...]]:
    return make_records(columns, {"units": default_units(tuple(columns))}, {})


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_rows_out_of_order_and_twice_are_put_right(seed: int) -> None:
    columns = motion(seed, samples=1000)
    rng = np.random.default_rng(seed)
    rows = np.argsort(np.arange(1000) + rng.uniform(0.0, 3.0, 1000), kind="stable")
    moved = int(np.sum(rows < np.maximum.accumulate(rows)))
    assume(moved > 0)
    rows = np.insert(rows, [300, 600], [rows[299], rows[599]])
    records, repairs = repaired(table_of(columns, rows))
    assert records[0]["t"].tolist() == columns["t"].tolist()
    assert all(np.array_equal(records[0][name], columns[name]) for name in columns)
    counts = {repair.kind: repair.count for repair in repairs}
    assert counts == {"order": moved, "repeated": 2}


def test_a_clock_that_is_set_back_cuts_the_log() -> None:
    columns = motion(samples=2000)
    columns["t"] = np.concatenate([5.0 + columns["t"][:1200], columns["t"][:800]])
    records, repairs = repaired(columns)
    assert [len(record) for record in records] == [1200, 800]
    assert kinds(repairs) == {("cut", None)}
    assert "set back 1 time" in repairs[0].text


def test_long_gaps_cut_the_log_and_short_ones_are_counted() -> None:
    columns = motion(samples=3000)
    keep = np.ones(3000, dtype=bool)
    keep[500:520] = keep[1000:2000] = False
    record = as_record(table_of(columns, np.flatnonzero(keep)))
    pieces, repairs = clean_pieces(record)
    assert [len(piece) for piece in pieces] == [980, 1000]
    texts = " ".join(repair.text for repair in repairs)
    assert "20 rows" in texts
    assert "No rows for up to 1 s in one place" in texts
    longest, found = clean(record)
    assert len(longest) == 1000
    assert "Of 2 pieces the longest is kept" in found[-1].text


def test_rows_with_a_false_time_are_left_out() -> None:
    columns = motion(samples=1000)
    columns["t"][100], columns["t"][400], columns["t"][700] = np.nan, 1e9, -3.0
    records, repairs = repaired(columns)
    assert len(records[0]) == 997
    assert (repairs[0].kind, repairs[0].count) == ("unreadable", 3)


def test_a_log_that_begins_with_its_latest_row_is_turned_round() -> None:
    columns = motion(samples=1000)
    turned = {name: values[::-1] for name, values in columns.items()}
    (record,), repairs = repaired(turned)
    assert np.array_equal(record["q_m"], columns["q_m"])
    assert [(r.kind, r.count) for r in repairs] == [("order", 1000)]


def test_rows_in_no_order_are_refused() -> None:
    columns = motion(1, 1000)
    mixed = table_of(columns, np.random.default_rng(0).permutation(1000))
    with pytest.raises(RecordError, match="goes back in 51 % of the rows: they are in disorder"):
        repaired(mixed)


def test_times_coarser_than_the_rows_are_spread() -> None:
    columns = motion(samples=1000)
    exact = columns["t"]
    columns["t"] = np.arange(1000) // 10 * 0.01
    records, repairs = repaired(columns)
    assert kinds(repairs) == {("sampling", None)}
    assert np.allclose(records[0]["t"], exact[: len(records[0])], atol=1e-9)


def test_times_closer_than_any_clock_shows_are_the_same() -> None:
    columns = motion(samples=6)
    columns["t"] = np.array([0.0, 5e-324, 1e-323, 1.5e-323, 0.1, 0.2])
    records, repairs = repaired(columns)
    assert [repair.kind for repair in repairs] == ["sampling"]
    assert np.diff(records[0]["t"]).min() > 0.02


def test_rows_that_repeat_while_the_joint_moves_are_marked() -> None:
    columns = dict(draw_case(2, effects=[], duration=4.0).diagnose.columns)
    rows = np.arange(len(columns["t"]))
    stale = np.random.default_rng(2).random(len(rows)) < 0.01
    newest = np.maximum.accumulate(np.where(stale, 0, rows))
    columns |= {name: v[newest] for name, v in columns.items() if name != "t"}
    same = np.all(
        [np.diff(v, prepend=np.nan) == 0.0 for name, v in columns.items() if name != "t"], axis=0
    )
    record, repairs = clean(as_record(columns))
    assert kinds(repairs) == {("stale", None)}
    marked = np.isnan(record["q_m"])
    assert marked.sum() > 0.8 * same.sum() > 10
    assert not (marked & ~same).any()


def halted(names: set[str]) -> tuple[dict, np.ndarray]:
    """Return columns of which some stand still for 20 to 50 rows now and then, and where."""
    columns, rng = motion(samples=6000), np.random.default_rng(5)
    still = np.zeros(6000, dtype=bool)
    for begin in range(900, 5700, 300):
        still[begin + 1 : begin + int(rng.integers(20, 50))] = True
    newest = np.maximum.accumulate(np.where(still, 0, np.arange(6000)))
    return columns | {name: columns[name][newest] for name in names}, still


def test_channels_that_freeze_while_the_command_goes_on_are_marked() -> None:
    columns, still = halted({"q_m", "i"})
    record, repairs = clean(as_record(columns))
    assert kinds(repairs) >= {("stale", "q_m"), ("stale", "i")}
    for name in ("q_m", "i"):
        marked = np.isnan(record[name])
        assert (marked & still).sum() > 0.5 * still.sum()
        assert not (marked & ~still).any()


def test_a_log_that_stands_still_is_marked_wherever_it_did() -> None:
    """In a reversal, too, where the jump after it is small."""
    columns, still = halted(set(motion(samples=6000)) - {"t"})
    record, repairs = clean(as_record(columns))
    assert ("stale", None) in kinds(repairs)
    assert np.array_equal(np.isnan(record["q_m"]), still)


def test_a_log_of_times_alone_is_no_log_that_stands_still() -> None:
    records, _ = repaired({"t": 1e-3 * np.arange(200)})
    assert len(records[0]) == 200


def test_a_joint_that_sticks_is_not_frozen() -> None:
    """It moves off from where it stood, however suddenly."""
    columns = motion(samples=6000)
    u = 2.0 * np.sin(2.0 * np.pi * 1.5 * columns["t"])
    speed, q = 0.0, np.zeros(6000)
    for k in range(1, 6000):
        free = speed + 1e-3 * (u[k] * 300.0)
        speed = free - np.clip(free, -0.45, 0.45)
        q[k] = q[k - 1] + 1e-3 * speed
    columns["q_m"] = 1e-5 * np.round(q / 1e-5)
    assert (np.diff(columns["q_m"]) == 0.0).sum() > 500
    assert ("stale", "q_m") not in kinds(clean(as_record(columns))[1])


def test_a_sensor_slower_than_the_log_counts_only_where_it_is_new() -> None:
    columns = motion()
    columns["tau"] = np.repeat(columns["tau"][::8], 8)
    record, repairs = clean(as_record(columns))
    known = np.flatnonzero(np.isfinite(record["tau"]))
    assert set(np.diff(known)) == {8}
    assert "only every 8 samples" in repairs[0].text


def test_infinite_values_become_missing_and_empty_logs_are_refused() -> None:
    columns = motion()
    columns["tau"][[5, 77]] = np.inf
    records, repairs = repaired(columns)
    assert np.isnan(records[0]["tau"][[5, 77]]).all()
    assert ("unreadable", "tau") in kinds(repairs)
    with pytest.raises(ValueError, match="must increase from row to row"):
        repaired({**columns, "t": np.full(3000, np.nan)})
    with pytest.raises(ValueError, match="has no samples"):
        repaired({name: values[:0] for name, values in columns.items()})


DOUBTS = [
    ({"q_m": 180.0}, "unit", "q_m", "spans .* turns. If these are degrees"),
    ({"i": 1e3}, "unit", "i", "If these are milliampere"),
    ({"t": 1e3}, "unit", "t", "If these are milliseconds"),
    ({"dq_m": 180.0 / np.pi}, "unit", "dq_m", "as if in deg/s"),
    ({"dq_m": 30.0 / np.pi}, "unit", "dq_m", "as if in rpm"),
    ({"dq_m": -1.0}, "sign", "dq_m", "Map it with sign = -1"),
]


@pytest.mark.parametrize(("factors", "kind", "channel", "text"), DOUBTS)
def test_what_looks_wrong_is_said_and_left(
    factors: dict[str, float], kind: str, channel: str, text: str
) -> None:
    columns = motion()
    columns["dq_m"] = np.gradient(columns["q_m"], columns["t"])
    assert clean(as_record(columns))[1] == ()
    record = as_record({name: values * factors.get(name, 1.0) for name, values in columns.items()})
    cleaned, repairs = clean(record)
    assert np.array_equal(cleaned[channel], record[channel])
    (found,) = [repair for repair in repairs if repair.channel == channel]
    assert (found.kind, found.changed) == (kind, False)
    assert re.search(text, found.text), found.text


def test_a_late_velocity_is_measured() -> None:
    columns = motion(samples=5000)
    late = np.interp(columns["t"] - 3.4e-3, columns["t"], np.gradient(columns["q_m"], columns["t"]))
    _, repairs = clean(as_record({**columns, "dq_m": late}))
    (found,) = repairs
    assert found.kind == "lateness"
    assert "3.4 ms late" in found.text


def test_a_channel_that_is_cut_off_is_said() -> None:
    columns = motion()
    columns["tau"] = np.clip(columns["tau"], -8.0, 8.0)
    _, repairs = clean(as_record(columns))
    assert kinds(repairs) == {("saturation", "tau")}
    assert "8" in repairs[0].text


def test_an_angle_that_leaps_far_away_is_a_glitch_however_long_that_lasts() -> None:
    t = 1e-3 * np.arange(3000)
    angle = np.sin(3.0 * t)
    off = angle.copy()
    off[1000:1015], off[2000:2040] = 9999.0, -500.0
    assert np.array_equal(glitches(off, angle=True), off != angle)
    assert not glitches(off).any()  # a current may be a pulse
    burst = np.where(t > 2.97, np.minimum(t - 2.97, 0.03) * 100.0, 1e-4 * np.round(angle))
    assert not glitches(burst, angle=True).any()  # it turns fast at the end


@pytest.mark.parametrize(
    ("place", "count"), [(slice(0, 1), 1), (slice(0, 3), 3), (slice(-2, None), 2)]
)
def test_an_angle_that_jumps_at_an_end_of_the_log_is_a_glitch_there(
    place: slice, count: int
) -> None:
    t = 1e-3 * np.arange(3000)
    angle = np.sin(3.0 * t)
    assert not glitches(angle, angle=True).any()
    assert not glitches(np.where(t < 1.5, 0.0, angle - angle[1500]), angle=True).any()
    off = angle.copy()
    off[place] += 3.0
    found = glitches(off, angle=True)
    assert np.array_equal(found, off != angle)
    assert found.sum() == count
    assert not glitches(off).any()


def test_a_row_left_over_from_an_earlier_run_is_a_glitch() -> None:
    """The joint rests beside it, so that a jump smaller than later steps is none of the joint's."""
    t = 0.01 * np.arange(1500)
    angle = 1e-3 * np.round(1e3 * np.where(t < 0.8, 0.0, 2.0 * np.sin(8.0 * (t - 0.8))))
    assert not glitches(angle, angle=True).any()
    for row in (0, -1):
        off = angle if row == 0 else angle[::-1].copy()
        off[row] += 0.3
        found = glitches(off, angle=True)
        assert found[row]
        assert found.sum() == 1
        off[row] -= 0.3


@pytest.mark.parametrize(("last", "marked"), [(-10.149451, 299), (0.0, 0)])
def test_a_current_that_a_drive_no_longer_measures_is_none(last: float, marked: int) -> None:
    rng = np.random.default_rng(0)
    t = 0.01 * np.arange(900)
    i = 12.0 * np.sin(2.0 * t) + 0.05 * rng.standard_normal(len(t))
    i[600:] = last
    q = np.cumsum(0.01 * np.sin(2.0 * t)) + 0.3 * t
    cleaned, repairs = clean(as_record({"t": t, "i": i, "q_m": q}))
    assert int(np.isnan(cleaned["i"]).sum()) == marked
    assert [r.text.split(" to ")[0] for r in repairs if r.channel == "i"] == (
        [f"i: stays {last:.6g}"] if marked else []
    )
