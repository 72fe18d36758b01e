"""Files appear whole or not at all, and only where they belong."""

from __future__ import annotations

import errno
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cjt_gym.cli import main
from cjt_gym.disk import check_file_name, whole, write_text
from cjt_gym.errors import ConfigurationError, RecordError
from cjt_gym.records import FORMATS, Record, formats, write_record

RECORD = Record({"t": [0.0, 0.1], "q_m": [0.0, 1.0]}, {"t": "s", "q_m": "rad"})
FACTS = "dt = 0.1\n[units]\n"
WRITTEN = [suffix for suffix, form in FORMATS.items() if form.write is not None]


def left(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize("there", [True, False])
@pytest.mark.parametrize("suffix", WRITTEN)
def test_a_disk_that_is_full_leaves_what_was_there(
    suffix: str, there: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, beside = tmp_path / f"run{suffix}", tmp_path / "run.toml"
    if there:
        path.write_text("old")
        beside.write_text(FACTS)
    form = FORMATS[suffix]
    assert form.write is not None

    def half(columns: Mapping[str, Any], place: Path) -> None:
        assert form.write is not None
        form.write(columns, place)
        place.write_bytes(place.read_bytes()[:10])
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setitem(
        formats.FORMATS, suffix, formats.Format(form.what, form.reader, form.streamer, half)
    )
    with pytest.raises(OSError, match="No space left") as caught:
        write_record(RECORD, path)
    assert str(caught.value.filename) == str(path)
    assert left(tmp_path) == (sorted(["run.toml", f"run{suffix}"]) if there else [])
    if there:
        assert path.read_text() == "old"
        assert beside.read_text() == FACTS


def test_what_is_no_record_is_not_overwritten(tmp_path: Path) -> None:
    beside = tmp_path / "run.toml"
    for text in ("no TOML at all", "[bus]\n"):
        beside.write_text(text)
        with pytest.raises(RecordError, match="belongs to no record"):
            write_record(RECORD, tmp_path / "run.csv")
        assert left(tmp_path) == ["run.toml"]
        assert beside.read_text() == text


def test_a_kill_while_writing_leaves_what_was_there(tmp_path: Path) -> None:
    path = write_text(tmp_path / "a.txt", "old")

    def write() -> None:
        with whole(path) as part:
            part.write_text("ne")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write()
    assert path.read_text() == "old"
    assert left(tmp_path) == ["a.txt"]


def test_links_devices_and_permissions_stay_what_they_are(tmp_path: Path) -> None:
    path, link = tmp_path / "a.txt", tmp_path / "link"
    path.write_text("old")
    path.chmod(0o640)
    link.symlink_to(path)
    write_text(link, "new")
    assert link.is_symlink()
    assert path.read_text() == "new"
    assert path.stat().st_mode & 0o777 == 0o640
    write_text("/dev/null", "gone")
    assert not Path("/dev/null").is_file()


@pytest.mark.parametrize("name", ["../x", "a/b", "a\\b", "", ".", "..", "a\nb", "x" * 300, "a:b"])
def test_names_that_are_paths_are_refused(name: str) -> None:
    with pytest.raises(ConfigurationError, match="a name that a file can have"):
        check_file_name(name, "The name")


def test_build_stays_in_its_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = tmp_path / "t.toml"
    table.write_text(
        'structures = ["rigid"]\n[joints]\n'
        'good = { file = "orange_80_6000" }\n"../../x" = { file = "orange_80_6000" }\n'
    )
    assert main(["build", str(table), "--out", str(tmp_path / "a" / "b")]) == 2
    assert "'../../x-rigid'" in capsys.readouterr().err
    assert left(tmp_path) == ["t.toml"]


@pytest.mark.parametrize("alias", ["same", "symbolic link", "hard link", "other spelling"])
def test_convert_never_writes_over_what_it_reads(alias: str, tmp_path: Path) -> None:
    path = tmp_path / "x.csv"
    path.write_text("t,q_m\n0,1\n0.1,2\n")
    out = {"same": path, "other spelling": tmp_path / "." / "a" / ".." / "x.csv"}.get(
        alias, tmp_path / "y.csv"
    )
    (tmp_path / "a").mkdir()
    if alias == "symbolic link":
        out.symlink_to(path)
    elif alias == "hard link":
        out.hardlink_to(path)
    assert main(["convert", str(path), "--out", str(out)]) == 2
    assert path.read_text() == "t,q_m\n0,1\n0.1,2\n"


def test_a_piece_of_a_log_does_not_take_its_place(tmp_path: Path) -> None:
    path = tmp_path / "x_1.csv"
    t = np.concatenate([np.arange(200) * 0.1, np.arange(200) * 0.1 + 1000.0])
    rows = "\n".join(f"{x:g},1" for x in t)
    path.write_text(f"t,q_m\n{rows}\n")
    assert main(["convert", str(path), "--out", str(tmp_path / "x.csv")]) == 2
    assert left(tmp_path) == ["x_1.csv"]


def test_simulate_and_export_never_write_over_what_they_read(tmp_path: Path) -> None:
    joint = tmp_path / "joint.toml"
    joint.write_text("name = 'x'")
    assert main(["export", str(joint), "--to", "mujoco", "--out", str(joint)]) == 2
    record = write_record(RECORD, tmp_path / "x.csv")
    words = ["simulate", "orange_80_6000", "--reference", str(record), "--out", str(record)]
    before = record.read_text()
    assert main(words) == 2
    assert record.read_text() == before
