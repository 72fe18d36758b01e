"""Mapping: logs with other names, units, signs and clocks become records."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cjt_gym.errors import RecordError
from cjt_gym.records import (
    iter_record,
    load_mapping,
    read_log,
    read_record,
    units_of,
)
from cjt_gym.records.columns import COLUMNS
from cjt_gym.records.draft import draft, guess

T = np.arange(500) * 1e-3
Q = 0.3 * np.sin(2.0 * np.pi * 2.0 * T)
DQ = np.gradient(Q, T)

MAPPING = """
joint = "my_joint.toml"
structure = "output_fixed"
n = 100

[columns.t]
source = "time_ms"
unit = "ms"
[columns.q_m]
source = "motor pos"
unit = "deg"
side = "motor"
sign = -1
[columns.dq_m]
source = "motor_rpm"
unit = "rpm"
side = "motor"
[columns.i]
source = "cur_mA"
unit = "mA"
offset = 20
[columns.tau]
source = "adc"
scale = 0.01
offset = 512
"""


def write_log(folder: Path) -> Path:
    path = folder / "log.csv"
    columns = {
        "time_ms": T * 1e3,
        "motor pos": -np.rad2deg(Q * 100.0),
        "motor_rpm": DQ * 100.0 * 30.0 / np.pi,
        "cur_mA": 1e3 * DQ + 20.0,
        "adc": 4000.0 * Q + 512.0,
        "temperature": 20.0 + T,
    }
    table = np.column_stack(list(columns.values()))
    np.savetxt(path, table, delimiter=",", header=",".join(columns), comments="")
    return path


def check(record: Any) -> None:
    assert dict(record.units) == {"t": "s", "q_m": "rad", "dq_m": "rad/s", "i": "A", "tau": "N m"}
    for name, wanted in {"t": T, "q_m": Q, "dq_m": DQ, "i": DQ, "tau": 40.0 * Q}.items():
        assert np.allclose(record[name], wanted, atol=1e-9), name
    assert (record.joint, record.structure) == ("my_joint.toml", "output_fixed")


def test_a_log_in_degrees_and_rpm_is_read(tmp_path: Path) -> None:
    log = write_log(tmp_path)
    (tmp_path / "rig.toml").write_text(MAPPING)
    check(read_record(log, mapping=tmp_path / "rig.toml"))
    records, repairs = read_log(log, mapping=tmp_path / "rig.toml")
    check(records[0])
    assert repairs == ()


def test_a_mapping_beside_the_log_is_found(tmp_path: Path) -> None:
    log = write_log(tmp_path)
    (tmp_path / "log.map.toml").write_text(MAPPING)
    check(read_record(log))
    (tmp_path / "log.toml").write_text('structure = "rigid"\nmode = "open loop"\n')
    record = read_record(log)
    assert (record.structure, record.joint) == ("rigid", "my_joint.toml")
    assert record.provenance["mode"] == "open loop"


def test_a_mapping_may_be_dictionaries(tmp_path: Path) -> None:
    log = write_log(tmp_path)
    mapping = {"columns": {"t": {"source": "time_ms", "unit": "ms"}, "i": {"source": "cur_mA"}}}
    assert read_record(log, mapping=mapping)["i"][0] == pytest.approx(1e3 * DQ[0] + 20.0)


def test_every_column_can_be_mapped_in_all_of_its_units() -> None:
    for name in COLUMNS:
        assert set(COLUMNS[name].units) <= set(units_of(name))
        for unit in units_of(name):
            column: dict[str, Any] = {"source": "x", "unit": unit}
            if unit.startswith("counts"):
                column["counts_per_rev"] = 4096
            units = load_mapping({"columns": {name: column}}).units
            assert units[name] in COLUMNS[name].units


def test_encoder_counts_behind_a_gear_are_unwrapped(tmp_path: Path) -> None:
    q = 0.5 * np.sin(2.0 * np.pi * T)
    counts = np.round(q * 50.0 / (2.0 * np.pi) * 4096.0) % 4096
    np.savez(tmp_path / "log.npz", enc=counts.astype(np.int32))
    column = {"source": "enc", "unit": "counts", "counts_per_rev": 4096, "side": "motor"}
    mapping = {"dt": 1e-3, "n": 50.0, "columns": {"q_m": column}}
    (record,), repairs = read_log(tmp_path / "log.npz", mapping=mapping)
    assert repairs[0].kind == "wrap"
    assert np.allclose(record["q_m"] - record["q_m"][0], q - q[0], atol=2 * np.pi / 4096 / 50)


def test_dates_in_nanoseconds_keep_their_resolution(tmp_path: Path) -> None:
    start = 1_700_000_000_123_456_789
    np.savez(tmp_path / "log.npz", stamp=start + np.arange(500) * 1_000_003, q_m=Q)
    mapping = {"columns": {"t": {"source": "stamp", "unit": "ns"}, "q_m": {}}}
    record = read_record(tmp_path / "log.npz", mapping=mapping)
    assert np.allclose(record["t"] - record["t"][0], np.arange(500) * 1.000003e-3, atol=1e-12)
    assert abs(record["t"][0]) < 1e-6


def test_a_clock_in_ticks_has_their_length(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text(
        "tick,q_m\n" + "".join(f"{4096 + 32 * k},{k}\n" for k in range(4)), encoding="utf-8"
    )
    clock = {"source": "tick", "scale": 1.0 / 32768.0}
    record = read_record(tmp_path / "log.csv", mapping={"columns": {"t": clock, "q_m": {}}})
    np.testing.assert_allclose(np.diff(record.t), 32.0 / 32768.0, rtol=1e-12)


def test_a_channel_with_a_clock_of_its_own(tmp_path: Path) -> None:
    slow = T[::7] + 0.0004
    np.savez(tmp_path / "log.npz", t=T, q=Q, ts=slow * 1e6, tau=np.sin(9.0 * slow), ref=slow)
    mapping = {
        "columns": {
            "t": {},
            "q_m": "q",
            "tau": {"time": "ts", "time_unit": "us"},
            "tau_ref": {"source": "ref", "time": "ts", "time_unit": "us"},
        }
    }
    record = read_record(tmp_path / "log.npz", mapping=mapping, allow_nan=True)
    known = np.isfinite(record["tau"])
    assert known.sum() > 490
    assert np.allclose(record["tau"][known], np.sin(9.0 * T[known]), atol=1e-3)
    held = record["tau_ref"][known]
    assert set(np.round(held, 9)) <= set(np.round(slow, 9)), "references hold, they do not move"


BAD = [
    ({}, r"must have a table per column, such as  \[columns.q_m\]"),
    ({"columns": {"angle": {}}}, "Unknown column 'angle'. Did you mean 'q_m'"),
    ({"columns": {"velocity": {}}}, "Unknown column 'velocity'. Did you mean 'dq_m'"),
    ({"columns": {"fault": {}}}, "Unknown column 'fault'. Known: "),
    ({"columns": {"qm": {}}}, "Unknown column 'qm'. Did you mean 'q_m'"),
    ({"columns": {"q_m": 3}}, "columns.q_m of the mapping must be a name or a table"),
    ({"columns": {"q_m": {"sorce": "x"}}}, "Unknown key 'sorce'. Did you mean 'source'"),
    ({"columns": {"q_m": {"unit": "rpm"}}}, "unit of columns.q_m .* 'deg' or .* got 'rpm'"),
    ({"columns": {"q_m": {"unit": "degs"}}}, "got 'degs'. Did you mean 'deg'"),
    ({"columns": {"q_m": {"unit": 1}}}, "unit of columns.q_m .* must be a string, got 1"),
    ({"columns": {"q_m": {"sign": 2}}}, "sign of columns.q_m of the mapping must be 1 or -1"),
    ({"columns": {"q_m": {"scale": 0}}}, "scale of columns.q_m .* must not be 0"),
    ({"columns": {"q_m": {"scale": "2"}}}, "scale of columns.q_m .* must be a number"),
    ({"columns": {"q_m": {"unit": "counts"}}}, "needs  counts_per_rev = ..."),
    ({"columns": {"q_m": {"counts_per_rev": 4096}}}, "got the unit 'rad'. Write the unit"),
    ({"columns": {"q_m": {"side": "rotor"}}}, "side of .* must be 'link' or 'motor', got 'rotor'"),
    ({"columns": {"q_m": {"side": "motor"}}}, "needs the gear ratio: a line  n = ..."),
    ({"n": 2, "columns": {"i": {"side": "motor"}}}, "says 'motor', which is for angles"),
    ({"n": 0, "columns": {"i": {}}}, "n of the mapping must not be 0"),
    ({"n": -3, "columns": {"i": {}}}, "n of the mapping must be > 0, got -3"),
    ({"columns": {"q_m": {"unit": "m"}, "tau": {}}}, "must all be rotary"),
    ({"columns": {"q_m": {}}, "units": {"q_m": "rad"}}, r"units under \[columns\]"),
    ({"columns": {"q_m": {}}, "strucutre": "x"}, "Did you mean 'structure'"),
    ({"columns": {"q_m": {"source": "pos"}}}, "columns.q_m of the mapping: .*log.csv has no such"),
    ({"columns": {"t": {"source": "time"}}}, "Unknown column 'time'. Did you mean 'time_ms'"),
    (
        {"columns": {"t": {"sign": -1}}},
        "columns.t of .* may have source, unit and scale only, got sign",
    ),
    ({"columns": {"t": {"scale": -1}}}, "scale of columns.t of .* must be > 0, got -1"),
    ({"columns": {"i": {"source": "cur_mA"}}}, "must have a column t or a sample time"),
]


@pytest.mark.parametrize(("mapping", "message"), BAD)
def test_bad_mappings(mapping: dict[str, Any], message: str, tmp_path: Path) -> None:
    log = write_log(tmp_path)
    with pytest.raises(RecordError, match=message):
        read_record(log, mapping=mapping)
    with pytest.raises(RecordError, match=message):
        read_log(log, mapping=mapping)


def test_a_torque_may_be_logged_in_volts(tmp_path: Path) -> None:
    path = write_log(tmp_path)
    gain = {"value": 0.5, "unit": "N m/V"}
    columns = {
        "tau_cmd": {"source": "cur_mA", "unit": "mV", "gain": gain, "sign": -1},
        "tau": {"source": "adc", "gain": gain, "side": "motor", "offset": 512},
    }
    record = read_record(path, mapping={"columns": columns, "n": 10, "dt": 1e-3})
    assert dict(record.units) == {"tau_cmd": "N m", "tau": "N m"}
    np.testing.assert_allclose(record["tau_cmd"], -0.5e-3 * (1e3 * DQ + 20.0), atol=1e-9)
    np.testing.assert_allclose(record["tau"], 0.5 * 10.0 * 4000.0 * Q, atol=1e-6)


@pytest.mark.parametrize(
    ("column", "changes", "message"),
    [
        ("tau", {"gain": 0.5}, "gain of columns.tau of the mapping must look like"),
        ("tau", {"gain": {"value": 0.5, "unit": "rad/V"}}, "must be one of N m/V, N m/A, N/V, N/A"),
        ("q_m", {"gain": {"value": 0.5, "unit": "N m/V"}}, "gain of .* is for torques only"),
        ("tau", {"gain": {"value": 0, "unit": "N m/V"}}, "value of gain of .* must not be 0"),
        (
            "tau",
            {"gain": {"value": 1.0, "unit": "N m/V"}, "unit": "A"},
            "unit of .* must be V or mV, as its gain is in N m/V, got 'A'",
        ),
    ],
)
def test_gains_that_make_no_sense_are_refused(
    column: str, changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(RecordError, match=message):
        load_mapping({"columns": {column: {"source": "x", **changes}}})


@pytest.mark.parametrize("rows", [9, 1000])
def test_columns_of_other_instants_are_put_into_the_rows_of_theirs(
    tmp_path: Path, rows: int
) -> None:
    path = write_log(tmp_path)
    mapping: dict[str, Any] = {
        "columns": {
            "t": {"source": "time_ms", "unit": "ms"},
            "q_m": {"source": "time_ms", "samples_late": 2},
            "q_l": {"source": "time_ms", "samples_late": 0.25},
            "i_cmd": {"source": "time_ms", "samples_late": -3},
        }
    }
    whole = read_record(path, mapping=mapping)
    log, _ = read_log(path, mapping)
    pieces = list(iter_record(path, rows, mapping))
    assert whole.t[0] == pytest.approx(T[3])
    assert whole.t[-1] == pytest.approx(T[-3])
    for name, late in (("q_m", 2.0), ("q_l", 0.25), ("i_cmd", -3.0)):
        np.testing.assert_allclose(whole[name], 1e3 * whole.t + late, atol=1e-9)
        np.testing.assert_array_equal(log[0][name], whole[name])
        np.testing.assert_array_equal(np.concatenate([p[name] for p in pieces]), whole[name])


@pytest.mark.parametrize(
    ("column", "late", "message"),
    [
        ("q_m", "1", "samples_late of columns.q_m of the mapping must be a number"),
        ("q_m", 1001, "must be within 1000 rows either way, got 1001"),
        ("i_cmd", 0.5, "must be a whole number, as a command holds its value"),
        ("q_m", 600, "samples_late moves columns by up to 600 rows, and the log has no more"),
    ],
)
def test_shifts_that_make_no_sense_are_refused(
    tmp_path: Path, column: str, late: Any, message: str
) -> None:
    mapping = {"columns": {column: {"source": "time_ms", "samples_late": late}}, "dt": 1e-3}
    with pytest.raises(RecordError, match=message):
        read_record(write_log(tmp_path), mapping=mapping)


def test_what_is_no_path_names_no_log() -> None:
    with pytest.raises(RecordError, match="named by its path, .* got 5"):
        read_log(5)  # type: ignore[arg-type]


def test_files_of_mappings_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match="There is no mapping .*none.toml"):
        load_mapping(tmp_path / "none.toml")
    (tmp_path / "bad.toml").write_text("columns = ")
    with pytest.raises(RecordError, match="bad.toml must be a TOML file"):
        load_mapping(tmp_path / "bad.toml")


@pytest.mark.parametrize("beside", ["dt = 0.001\n", '[units]\nq_m = "rad"\n', '[units]\nv = "V"\n'])
def test_a_column_for_which_the_file_beside_it_has_no_unit_is_taken_as_si(
    tmp_path: Path, beside: str
) -> None:
    rows = [f"{0.001 * k},{0.1 * k},{0.01 * k}" for k in range(200)]
    (tmp_path / "log.csv").write_text("\n".join(["t,i,q_m", *rows]))
    (tmp_path / "log.toml").write_text(beside)
    (record,), notes = read_log(tmp_path / "log.csv")
    assert dict(record.units) == {"t": "s", "i": "A", "q_m": "rad"}
    said = "Columns taken as SI units, for which log.toml has none: t, i"
    assert any(note.text.startswith(said) for note in notes)


@pytest.mark.parametrize("zone", ["", "Z", "+01:00"])
def test_dates_as_text_are_seconds(tmp_path: Path, zone: str) -> None:
    rows = [f"2026-11-01T10:00:{k // 100:02}.{k % 100:02}0{zone},{0.01 * k}" for k in range(300)]
    (tmp_path / "log.csv").write_text("\n".join(["t,q_m", *rows]))
    (record,), _ = read_log(tmp_path / "log.csv")
    assert record.t - record.t[0] == pytest.approx(0.01 * np.arange(300), abs=1e-6)


@pytest.mark.parametrize(
    ("name", "column"),
    [
        ("hall_voltage [V]", None),
        ("Gravity Torque [Nm]", None),
        ("Output Velocity [dps]", "dq_l"),
        ("mot_ang", "q_m"),
        ("Load cell [mNm]", "tau"),
        ("motor torque [mN m]", "tau_m"),
        ("zeit_s", "t"),
        ("M_ist_mNm", "tau"),
        ("T_loadcell_Nm", "tau"),
        ("Icmd_A", "i_cmd"),
        ("Winkel_grad", "q_m"),
        ("tau_m [Nm]", "tau_m"),
        ("Strom (A)", "i"),
    ],
)
def test_a_draft_knows_what_a_name_tells_of_and_what_it_does_not(
    name: str, column: str | None
) -> None:
    assert guess(name) == column
    text = draft("log.csv", {name: np.array([0.0, 1.0])})
    assert f"[columns.{column or '?'}]" in text
    assert ('unit = "deg/s"' in text) == name.endswith("[dps]")


def test_a_draft_asks_for_the_unit_of_times_that_their_name_makes_too_short() -> None:
    seconds = 1771538684.155 + 0.01 * np.arange(20)
    for factor, told in ((1.0, 'unit = "?"  # its name says ms'), (1e3, 'unit = "ms"')):
        assert told in draft("log.csv", {"timestamp(ms)": factor * seconds})


@pytest.mark.parametrize("order", [1, -1])
def test_beside_the_motors_sensor_another_is_that_of_the_load(order: int) -> None:
    names = ("actual_position", "motor_position")[::order]
    text = draft("log.csv", {name: np.array([0.0, 1.0]) for name in names})
    of_load, of_motor = (text.split(f'source = "{n}"')[0].splitlines()[-1] for n in sorted(names))
    assert (of_load, of_motor) == ("[columns.q_l]  # from 0 to 1", "[columns.q_m]  # from 0 to 1")


def test_the_second_of_two_equal_sensors_is_on_the_other_side_of_the_spring() -> None:
    names = ("Encoder 1 [counts]", "Encoder 2 [counts]", "Encoder 3 [counts]", "Motor position")
    text = draft("log.csv", {name: np.array([0.0, 1.0]) for name in names})
    first, second, third, fourth = (text.split(name)[0].splitlines()[-2:] for name in names)
    assert first[0].startswith("[columns.q_m]")
    assert second[0].startswith("[columns.q_l]")
    assert third[0].startswith("# [columns.?]")
    assert fourth[0].startswith("# [columns.?]")


@pytest.mark.parametrize(
    ("column", "word", "usual"),
    [
        ("q_m", "Grad", "deg"),
        ("q_m", "°", "deg"),
        ("q_m", "Umdrehungen", "rev"),
        ("dq_m", "Grad/s", "deg/s"),
        ("dq_m", "U/min", "rpm"),
        ("dq_m", "1/min", "rpm"),
    ],
)
def test_units_have_other_words(column: str, word: str, usual: str, tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    table = np.column_stack([T, np.rad2deg(Q)])
    header = f"t,pos [{word}]"
    np.savetxt(path, table, delimiter=",", header=header, comments="", encoding="utf-8")
    written, known = (
        read_log(path, {"columns": {"t": "t", column: {"source": header[2:], "unit": unit}}})[0][0]
        for unit in (word, usual)
    )
    np.testing.assert_array_equal(written[column], known[column])


@pytest.mark.parametrize("word", ["Grad", "°", "degrees"])
def test_other_words_of_units_are_seen_in_headers(word: str) -> None:
    assert 'unit = "deg"' in draft("log.csv", {"t": T, f"motor pos [{word}]": Q})


def test_a_unit_of_another_kind_or_of_two_meanings_gets_no_wrong_advice(tmp_path: Path) -> None:
    path = write_log(tmp_path)

    def refused(unit: str) -> str:
        columns = {"t": "time_ms", "q_m": {"source": "motor pos", "unit": unit}}
        with pytest.raises(RecordError) as error:
            read_log(path, {"columns": columns})
        return str(error.value)

    assert "Did you mean" not in refused("mA")
    assert "Degrees are 'deg'" in refused("grad")
    assert "Did you mean 'mrad'" in refused("mrads")


def test_a_line_of_names_in_the_code_page_of_windows_is_read(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    rows = "".join(f"{1e-3 * k:.3f},{k}\n" for k in range(100))
    path.write_bytes(f"t,Motorwinkel [°]\n{rows}".encode("cp1252"))
    columns = {"t": "t", "q_m": {"source": "Motorwinkel [°]", "unit": "°"}}
    (record,), _ = read_log(path, {"columns": columns})
    np.testing.assert_allclose(record["q_m"], np.deg2rad(np.arange(100)))
