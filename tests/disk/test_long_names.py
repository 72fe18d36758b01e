"""A name that no file can have is that of no file, whoever looks for it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from cjt_gym.canbus.protocols.dbc_mapping import load_dbc_mapping
from cjt_gym.errors import CjtGymError
from cjt_gym.joint import load_joint_file
from cjt_gym.records import Record, read_log, read_record
from cjt_gym.signals import make_signals
from cjt_gym.training.deploy.exported import load_exported
from cjt_gym.training.learning.config import load_config
from tests.canbus.bench import config

LONG = 300 * "x"


@pytest.mark.parametrize(
    "read",
    [
        lambda: config(joint={"file": f"{LONG}.toml"}),
        lambda: load_dbc_mapping(LONG, 1.0),
        lambda: load_config(LONG),
        lambda: load_exported(f"{LONG}.npz"),
        lambda: load_joint_file(f"{LONG}.toml"),
        lambda: make_signals(f"{LONG}.csv", 1.0),
        lambda: read_log(f"{LONG}.csv"),
        lambda: read_record(LONG),
        lambda: read_record(f"{LONG}.toml"),
    ],
)
def test_it_is_refused(read: Callable[[], object]) -> None:
    with pytest.raises(CjtGymError, match="xxx"):
        read()


def test_what_a_file_names_is_no_file(tmp_path: Path) -> None:
    drive = {"protocol": "odrive", "node": 1, "file": LONG}
    with pytest.raises(CjtGymError, match="file"):
        config(drive=drive)
    record = Record({"t": [0.0, 1.0]}, {"t": "s"}, joint=LONG, origin=tmp_path / "x.csv")
    assert record.joint_file == LONG
    path = tmp_path / "train.toml"
    path.write_text(f'start_from = "{LONG}"\n[env]\njoint = "{LONG}.toml"\n')
    with pytest.raises(CjtGymError, match="xxx"):
        load_config(path)
