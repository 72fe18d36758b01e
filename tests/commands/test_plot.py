"""`cjt-gym plot` draws any record, whatever its columns and its name."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from cjt_gym.cli import main
from cjt_gym.datasheet.drawing import canvas
from cjt_gym.datasheet.record_plot import BINS, Trace, _draw, _envelope
from cjt_gym.records import Record, write_record


def record(samples: int = 300, **provenance: object) -> Record:
    t = 1e-3 * np.arange(samples)
    columns = {"t": t, "tau": np.sin(t), "true_tau": np.sin(t), "q_m": t, "dq_m": t, "age": t}
    units = {"t": "s", "tau": "N m", "true_tau": "N m", "q_m": "rad", "dq_m": "rad/s", "age": "s"}
    return Record(columns, units, provenance=provenance)


@pytest.mark.parametrize("ending", ["html", "png", "svg", "pdf"])
def test_every_format_is_written_whole(ending: str, tmp_path: Path) -> None:
    out = tmp_path / "new" / f"plot.{ending}"
    assert main(["plot", "emps", "--between", "1", "2", "--out", str(out)]) == 0
    begins = {"html": b"<!doctype html", "png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}
    assert out.read_bytes().startswith(begins[ending])
    assert [path.name for path in out.parent.iterdir()] == [out.name]


def test_page_of_two_records_names_what_is_drawn_and_how_one_ended(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fault = {"kind": "overrun", "text": "too late <b>"}
    paths = [
        write_record(record(**provenance), tmp_path / f"{name}.npz")  # type: ignore[arg-type]
        for name, provenance in (("one $", {}), ("a & b $^{", {"fault": fault}))
    ]
    out = tmp_path / "plot.html"
    assert main(["plot", *map(str, paths), "--out", str(out), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["columns"] == ["tau", "true_tau", "q_m", "dq_m", "age"]
    page = out.read_text(encoding="utf-8")
    assert "a &amp; b $^{" in page
    assert "overrun: too late &lt;b&gt;" in page
    assert "http" not in page.split("</svg>")[1]
    svg = page[page.index("<svg") : page.index("</svg>") + 6]
    ET.fromstring(svg)


def test_columns_are_drawn_in_the_order_asked_for_and_none_is_under_a_legend(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = write_record(record(), tmp_path / "run.npz"), tmp_path / "plot.svg"
    words = ["plot", str(path), "--columns", "true_tau", "tau", "--out", str(out), "--json"]
    assert main(words) == 0
    assert json.loads(capsys.readouterr().out)["columns"] == ["true_tau", "tau"]
    with canvas() as (figure, _):
        _draw(figure, [Trace("run", record())], {"N m": ["tau", "true_tau"]})
        figure.draw_without_rendering()
        (axes,) = figure.axes
        named = axes.get_legend()
        assert named is not None
        assert named.get_window_extent().y0 >= axes.get_window_extent().y1


def test_many_samples_keep_their_peaks_and_gaps() -> None:
    t = np.arange(200_000) * 1e-3
    value = np.sin(t)
    value[123_457] = 9.0
    value[50_000:51_000] = np.nan
    seen, drawn = _envelope(t, value)
    assert len(seen) == 2 * BINS
    assert np.all(np.diff(seen) >= 0.0)
    assert np.nanmax(drawn) == 9.0
    assert np.isnan(drawn).any()


def test_logs_are_drawn_as_check_reads_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    t = 1e-3 * np.arange(2000)
    table = np.column_stack([t, np.sin(t)])[(t < 0.5) | (t > 1.5)]
    plain, named = tmp_path / "plain.csv", tmp_path / "named.csv"
    np.savetxt(plain, table, delimiter=",", header="t,q_m", comments="")
    np.savetxt(named, table, delimiter=",", header="time,pos", comments="")
    mapping = tmp_path / "names.toml"
    mapping.write_text(
        '[columns]\nt = { source = "time", unit = "s" }\nq_m = { source = "pos", unit = "deg" }\n'
    )
    out = tmp_path / "plot.html"
    assert main(["plot", str(plain), "--out", str(out), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["columns"] == ["q_m"]
    assert "plain, piece 2" in out.read_text(encoding="utf-8")
    assert main(["plot", str(named), "--mapping", str(mapping), "--out", str(out)]) == 0
    assert main(["plot", str(named), "--out", str(out)]) == 2
    assert "--out named.map.toml" in capsys.readouterr().err.replace(f"{tmp_path}/", "")


def test_a_mapping_of_the_motors_side_takes_the_gear_ratio_of_a_joint(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, out = tmp_path / "log.csv", tmp_path / "plot.svg"
    np.savetxt(log, np.column_stack([np.arange(200), np.arange(200)]), delimiter=",", header="ms,q",
               comments="")  # fmt: skip
    (tmp_path / "log.map.toml").write_text(
        '[columns]\nt = { source = "ms", unit = "ms" }\n'
        'q_m = { source = "q", unit = "deg", side = "motor" }\n'
    )
    assert main(["plot", str(log), "--out", str(out)]) == 2
    assert "needs the gear ratio" in capsys.readouterr().err
    assert main(["plot", str(log), "--joint", "orange_80_6000", "--out", str(out)]) == 0
