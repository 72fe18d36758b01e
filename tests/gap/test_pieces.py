"""Logs that were recorded in pieces: a cart is put back by hand between its runs."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from cjt_gym.cli import main
from cjt_gym.gap.check import examine
from cjt_gym.gap.check.clock import clock
from cjt_gym.gap.horizons.selection.worth import LOUDLY, Worth
from cjt_gym.gap.recorded.series import BRIEF, ENOUGH, stretches
from cjt_gym.joint import get_structure, load_joint_file
from cjt_gym.records import Record, read_log, read_record

MASS, DAMPING, DRY = 0.6, 20.0, 0.7
"""Of the cart [kg, N s/m, N]."""
DT, FINE = 0.01, 50
RUNS = ((7.0, 0.9), (1.5, 3.0), (2.0, 6.0), (1.5, 9.0), (1.2, 12.0), (1.4, 15.0))
"""Duration [s] and force [N] of each run; in the longest it only creeps."""
JOINT = """
name = "cart"
source = "test"
structure = "rigid"
axis = "prismatic"
[parameters]
I_m = { value = 0.5, unit = "kg", guess = true }
I_g = { value = 0.0, unit = "kg" }
I_l = { value = 0.0, unit = "kg" }
d_m = { value = 0.0, unit = "N s/m" }
n = { value = 1.0, unit = "-" }
k_t = { value = 1.0, unit = "N/A", tolerance = 0.02 }
[sensors.q_m]
resolution = { value = 1e-5, unit = "m" }
"""
RECORD = """
joint = "cart.joint.toml"
structure = "rigid"
[units]
t = "s"
q_m = "m"
i_cmd = "A"
"""


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log of all runs with pauses of a second, integrated with fine steps."""
    folder, rows, begin = tmp_path_factory.mktemp("cart"), [], 0.0
    for seconds, force in RUNS:
        v = x = 0.0
        for k in range(round(seconds / DT)):
            given = force if k * DT >= 0.3 else 0.0
            rows.append((begin + k * DT, np.round(x / 1e-5) * 1e-5, given))
            for _ in range(FINE):
                moving = v > 0.0 or given > DRY
                v += DT / FINE * (given - DAMPING * v - DRY) / MASS if moving else 0.0
                v = max(v, 0.0)
                x += DT / FINE * v
        begin = rows[-1][0] + 1.0
    t, q, f = np.array(rows).T
    np.savez(folder / "cart.npz", t=t, q_m=q, i_cmd=f)
    (folder / "cart.toml").write_text(RECORD)
    (folder / "cart.joint.toml").write_text(JOINT)
    return folder / "cart.npz"


@pytest.mark.slow
def test_the_shorter_pieces_of_a_log_count(log: Path, tmp_path: Path) -> None:
    """The longest alone shows neither the mass nor how friction divides."""
    main(["diagnose", str(log), "--out", str(tmp_path)])
    found = json.loads((tmp_path / "diagnosis.json").read_text())
    sizes = {x: v["value"] for e in found["effects"] for x, v in e["parameters"].items()}
    assert sizes["d_m"] == pytest.approx(DAMPING, rel=0.1)
    assert sizes["d_cm"] == pytest.approx(DRY, rel=0.25)
    assert max(row["found"] for row in found["horizons"] if row["seconds"] >= 0.1) < 0.1


def test_the_stages_take_shorter_stretches_where_the_long_ones_are_few(log: Path) -> None:
    pieces = stretches(read_log(log)[0])
    assert [len(piece) for piece in pieces] == [700, 200, 150, 150]
    assert len(pieces[0]) >= ENOUGH > len(pieces[1]) >= BRIEF
    long = stretches(read_log(log)[0][:2])
    assert [len(piece) for piece in long] == [700], "where most of a log is whole"


def test_a_check_tells_the_range_of_all_pieces(log: Path) -> None:
    joint, record = load_joint_file(log.parent / "cart.joint.toml"), read_record(log)
    found = examine(read_log(log)[0], joint, get_structure("rigid"))
    assert found.channels["i_cmd"].high == 15.0
    assert found.channels["q_m"].high == record["q_m"].max()
    assert not found.at_rest


def test_a_check_tells_where_a_log_is_cut(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(log)]) == 0
    assert "No rows for up to 1 s in 5 places" in capsys.readouterr().out


@pytest.mark.parametrize("rows", [90, 100, 120, 130])
def test_a_piece_of_any_length_leaves_the_others_their_say(rows: int) -> None:
    t = DT * np.arange(1000.0)
    units = {"t": "s", "q_m": "rad", "i_cmd": "A"}
    long, brief = (
        Record({"t": t[:n], "q_m": np.sin(t[:n]), "i_cmd": np.cos(t[:n])}, units)
        for n in (600, rows)
    )
    assert [len(one) for one in stretches([brief, long])] == [600]
    assert [len(one) for one in stretches([brief])] == [rows]


def test_the_jitter_of_pieces_is_told_once() -> None:
    rng = np.random.default_rng(0)
    pieces = [
        Record(
            {"t": np.cumsum(rng.uniform(8e-3, 12e-3 * k, 200)), "q_m": np.arange(200.0)},
            {"t": "s", "q_m": "rad"},
        )
        for k in (1, 1.2, 1.1)
    ]
    (said,) = clock(pieces)
    assert "jitters" in said
    assert "to 14" in said


def test_what_held_out_data_repeat_need_not_show_in_many_pieces() -> None:
    narrow = Worth(fall=20.0, clear=5.0, rest=0.0, price=3.0)
    assert not narrow.enough, "one stretch does not decide"
    assert Worth(20.0, 5.0, 0.0, 3.0, held=2.0 * LOUDLY * 3.0).enough
    assert not Worth(20.0, 5.0, 0.0, 3.0, held=0.5 * LOUDLY * 3.0).enough
    against = Worth(fall=-5.0, clear=0.0, rest=0.0, price=3.0, held=100.0)
    assert not against.repeated
    assert Worth(-1.0, 0.0, 0.0, 3.0, held=100.0).repeated
