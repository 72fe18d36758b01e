"""`cjt-gym emulate` and `cjt-gym hardware`."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import warnings
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

from cjt_gym.baselines.gains import law_of_record, write_gains
from cjt_gym.canbus.emulator import Emulator
from cjt_gym.canbus.experiments import EXPERIMENTS, experiment_torque
from cjt_gym.canbus.hidden_effects import draw_hidden
from cjt_gym.canbus.lock import NodeLock
from cjt_gym.canbus.virtual import VirtualLink
from cjt_gym.cli import main
from cjt_gym.disk import to_toml
from cjt_gym.errors import CjtGymWarning, HardwareError
from cjt_gym.hardware.beside_simulation import side_by_side
from cjt_gym.hardware.jobs import Job, Run
from cjt_gym.hardware.run import carry_out
from cjt_gym.joint import load_joint
from cjt_gym.records import Record, read_record, write_record
from cjt_gym.training.deploy.shipped import policy_names
from tests.canbus.bench import config, document
from tests.canbus.soak import emulator, free_port
from tests.canbus.test_buses import PATIENT

SENSORS = {"torque": {"protocol": "dbc", "file": "torque_sensor"}}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    found = tmp_path / "joint.toml"
    bus = {"interface": "socketcand", "channel": "can0", "port": free_port()}
    text = to_toml(
        document(bus=bus, joint={"effects": ["coulomb"]}, control=PATIENT | {"rate_hz": 500})
    )
    found.write_text(text + '[sensors.torque]\nprotocol = "dbc"\nfile = "torque_sensor"\n')
    return found


def test_emulated_run_writes_a_record_for_the_diagnosis(
    path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = path.with_name("run.npz")
    words = ["hardware", str(path), "--emulated", "--controller", "pd_feedforward", "--json"]
    assert main([*words, "--duration", "1", "--out", str(out)]) == 0
    written = capsys.readouterr()
    assert "recording run: 1 s" in written.err
    told = json.loads(written.out)
    assert told["samples"] == 500
    assert told["rmse"] < 10.0
    record = read_record(out)
    assert {"i_cmd", "i", "tau_cmd", "tau_ref", "q_m", "dq_m", "tau", "age"} <= set(record.keys())
    assert record.joint == "orange_80_6000"
    assert record.structure == "output_fixed_rigid_gearbox"
    assert record.provenance["controller"] == "pd_feedforward"
    assert record.provenance["kp"] > 0.0


@pytest.mark.parametrize("sign", [1, -1])
def test_a_drive_of_the_wrong_sign_is_remarked_on(
    sign: int, capsys: pytest.CaptureFixture[str]
) -> None:
    real = config(sensors=SENSORS)
    drive = document()["drive"] | {"sign": sign}
    asked = config(drive=drive, sensors=SENSORS)
    reference = 3.0 * np.sin(2.0 * np.pi * 4.0 * np.arange(200) * real.dt)
    job = Job("", reference, "pd_feedforward", None, {})
    with nullcontext() if sign > 0 else pytest.raises(HardwareError, match="motor speed"):
        result = carry_out(Run(None, (job,)), [asked], VirtualLink(Emulator(real)), None)
        assert result["remarks"] == []
    said = capsys.readouterr().err
    assert ("torque of bench.toml falls where the deflection" in said) == (sign < 0)


@pytest.mark.parametrize("good", [0, 30])
def test_code_that_commands_nan_is_a_fault_of_the_command(
    good: int, path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out = path.with_name("own.py"), path.with_name("run.csv")
    code.write_text(
        "class Late:\n    def __init__(self, joint, dt): pass\n"
        "    def reset(self, mask=None): pass\n"
        f"    def act(self, m, r): return r if m.t[0] < {good * 0.002} else float('nan') * r\n"
    )
    words = ["hardware", str(path), "--emulated", "--controller", f"{code}:Late"]
    assert main([*words, "--duration", "0.2", "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert "finite motor torques" in said
    assert f"Torque is off; {f'{out} ends there' if good else 'no record'}" in said
    assert not good or read_record(out).provenance["fault"]["kind"] == "command"


def test_a_drive_that_reports_oftener_than_said_is_told_by_cycle_ms() -> None:
    drive = document()["drive"] | {"reports": "cyclic"}
    real, slower = config(drive=drive | {"cycle_ms": 2}), config(drive=drive | {"cycle_ms": 20})
    job = Job("", np.zeros(200), "pd_feedforward", None, {})
    with pytest.raises(HardwareError, match=r"once every 20 ms, got more\..* set cycle_ms"):
        carry_out(Run(None, (job,)), [slower], VirtualLink(Emulator(real)), None)


def test_a_policy_by_name_says_where_it_was_not_trained(
    path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    same = path.read_text().replace("rate_hz = 500", "rate_hz = 1000")
    other = same.replace("orange_80_6000", "lemon_50_6000")
    for name, text in (("same", same), ("other", other)):
        config_file = path.with_name(f"{name}.toml")
        config_file.write_text(text)
        words = ["hardware", str(config_file), "--emulated", "--policy", "orange_residual"]
        words += ["--duration", "0.05", "--out", str(path.with_name(f"{name}-run.csv"))]
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", CjtGymWarning)
            assert main(words) == 0
        said = capsys.readouterr()
        assert "50 samples, tracking error" in said.out
        told = said.err + "".join(str(one.message) for one in caught)
        assert ("was trained on orange_80_6000" in told) == (name == "other"), told


def test_a_policy_says_which_rate_and_which_name_it_needs(
    path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["hardware", str(path), "--emulated", "--out", str(path.with_name("run.csv"))]
    assert main([*words, "--policy", "orange_residual"]) == 2
    assert "rate_hz = 1000" in capsys.readouterr().err
    assert main([*words, "--policy", "orange_residul"]) == 2
    known = ", ".join(policy_names())
    told = f"Did you mean 'orange_residual'? Known: {known}. Or give the path"
    assert told in capsys.readouterr().err


def test_gain_files_run_and_amplitudes_keep_the_limits(
    path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    gains, out = path.with_name("own.toml"), path.with_name("run.npz")
    write_gains(gains, "pd_feedforward", {"kp": 0.3}, {})
    words = ["hardware", str(path), "--emulated", "--controller", str(gains), "--out", str(out)]
    assert main([*words, "--duration", "0.1"]) == 0
    record = read_record(out)
    assert record.provenance["controller"] == "pd_feedforward"
    assert record.provenance["gain_file"] == str(gains)
    assert record.provenance["gains"]["kp"] == 0.3
    assert law_of_record(record).kp == 0.3
    assert main([*words, "--amplitude", "1e6"]) == 2
    assert "the limit on the joint torque of orange_80_6000" in capsys.readouterr().err


@pytest.mark.slow  # in real time
def test_two_terminals(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = path.with_name("run.csv")
    with emulator(path, "--hidden-seed", "4", "--truth", str(path.with_name("truth.json"))):
        assert main(["hardware", str(path)]) == 0
        shown = capsys.readouterr().out
        assert "Not armed, nothing was moved" in shown
        assert re.search(r"q_m \S+ rad\b", shown)
        words = ["hardware", str(path), "--arm", "--controller", "none", "--reference", "multisine"]
        assert main([*words, "--duration", "0.3", "--out", str(out)]) == 0
    assert len(read_record(out)) == 200  # 150, and 50 that fade
    assert "spring_hysteresis" in json.loads(path.with_name("truth.json").read_text())


def test_dry_run_shows_frames_and_touches_no_bus(
    path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["hardware", str(path), "--dry-run", "--duration", "0.05"]) == 0
    shown = capsys.readouterr()
    assert "frames would be sent" in shown.out
    assert "06E" in shown.err  # torque of node 3
    assert not path.with_name("run.csv").exists()


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["--arm"], "--out must name the record"),
        (["--dry-run", "--emulated"], "not both"),
        (["--emulated", "--out", "x.csv", "--controller", "pdi"], "Unknown controller"),
        (["--emulated", "--out", "x.csv", "--reference", "nothing"], "Unknown signal"),
        (["--emulated", "--out", "x.csv", "--duration", "0"], "--duration"),
        (["--emulated", "--out", "x", "--experiment", "dance"], "Unknown experiment"),
        (["--arm", "--out", "x.csv", "--policy", "orange_residual"], "trained at dt_control"),
        ([], "No socketcand server"),
    ],
)
def test_bad_input_is_one_line(
    words: list[str], text: str, path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["hardware", str(path), *words]) == 2
    error = capsys.readouterr().err
    assert text in error
    assert error.count("\n") == 1


@pytest.mark.slow
def test_series_of_experiments_goes_on(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = path.with_name("series")
    words = ["hardware", str(path), "--emulated", "--out", str(out), "--experiment"]
    assert main([*words, "steps"]) == 0
    record = read_record(out / "steps.csv")
    assert record.provenance["excitation"] == "steps"
    (out / "chirp.csv").write_text("t,tau_cmd\n0,0\n")  # what a dead process left
    (out / "chirp.toml").write_text('dt = 0.002\n[units]\nt = "s"\ntau_cmd = "N m"\n')
    capsys.readouterr()
    assert main([*words, "steps", "chirp"]) == 0
    told = capsys.readouterr().err
    assert "steps: recorded already" in told
    assert "recording chirp: 10 s" in told
    assert len(read_record(out / "chirp.csv")) > 5000
    assert (out / "chirp.broken.csv").exists()


def test_next_record_of_a_diagnosis_is_replayed(path: Path) -> None:
    t = np.arange(1000) * 1e-3
    current = np.where(t > 0.3, 1.0, 0.0)
    units = {"t": "s", "i_cmd": "A"}
    write_record(Record({"t": t, "i_cmd": current}, units), path.with_name("next.npz"))
    out = path.with_name("run.csv")
    words = ["hardware", str(path), "--emulated", "--reference", str(path.with_name("next.npz"))]
    assert main([*words, "--out", str(out)]) == 0
    record = read_record(out)
    command = record["i_cmd"][record.t < 0.999]
    np.testing.assert_allclose(command, np.where(record.t[record.t < 0.999] > 0.3, 1.0, 0.0))


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_experiments_keep_within_the_limits(name: str) -> None:
    given = config()
    torque = experiment_torque(name, given.joint, given.limits, given.dt)
    assert torque[0] == 0.0
    assert abs(torque[-1]) < 1.0
    assert 1.0 < np.abs(torque).max() <= given.limits.tau
    record = given.joint.simulate(torque, dt=given.dt, dt_physics=1e-4)
    assert np.abs(record["true_dq_m"]).max() < given.limits.dq_m
    assert np.abs(record["true_tau"]).max() < given.limits.tau_joint


def test_hidden_effects_are_repeatable_and_valid() -> None:
    for structure in ("output_fixed_rigid_gearbox", "full_dynamics"):
        joint = load_joint("orange_80_6000", structure, effects=[])
        drawn = [draw_hidden(joint, seed) for seed in range(30)]
        assert drawn == [draw_hidden(joint, seed) for seed in range(30)]
        assert len({name for effects in drawn for name in effects}) > 8
        for effects in drawn:
            assert load_joint("orange_80_6000", structure, effects=effects).effects


def test_lock_is_given_back_when_a_process_dies() -> None:
    code = "from cjt_gym.canbus.lock import NodeLock; import time; l = NodeLock('bus', 9); "
    code += "print('held', flush=True); time.sleep(60)"
    holder = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    try:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        with pytest.raises(RuntimeError, match=str(holder.pid)):
            NodeLock("bus", 9)
    finally:
        holder.kill()
        holder.wait()
        holder.stdout.close() if holder.stdout else None
    NodeLock("bus", 9).release()


def test_simulated_rows_have_the_gains_that_the_real_loop_had(tmp_path: Path) -> None:
    given, rmse = config(control={"rate_hz": 1000}), []
    t = np.arange(3000) * 1e-3
    wanted = 5.0 * np.sin(20.0 * t)
    columns = {"t": t, "tau_ref": wanted, "tau": wanted, "tau_cmd": wanted}
    for late in (0.0, 4e-3):
        path = tmp_path / f"{late}.csv"
        facts = {"designed_for_s": {"measurement_delay.delay": late}}
        units = {"t": "s"} | dict.fromkeys(("tau_ref", "tau", "tau_cmd"), "N m")
        write_record(Record(columns, units, provenance=facts), path)
        rows = side_by_side(given, "pd_feedforward", None, {"smooth": path}, [], 0)
        rmse.append({row["where"]: row["rmse"] for row in rows})
    assert rmse[0]["real"] == rmse[1]["real"]
    assert rmse[0]["nominal"] < 0.8 * rmse[1]["nominal"]


def test_figures_of_the_joint_beside_those_of_the_simulation(
    path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = path.with_name("series")
    words = ["hardware", str(path), "--emulated", "--out", str(out), "--controller", "open_loop"]
    words += ["--duration", "3", "--amplitude", "10", "--benchmark"]
    assert main([*words, "smooth", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    real, nominal = told["rows"]
    assert set(real) == set(nominal) >= {"rmse", "nrmse", "effort_rms", "ci95", "kind", "task"}
    assert (real["where"], nominal["where"]) == ("real", "nominal")
    assert real["effort_rms"] == pytest.approx(nominal["effort_rms"], rel=0.02)
    assert real["rmse"] > 2.0 * nominal["rmse"]  # friction, which the nominal joint has not
    assert json.loads((out / "benchmark.json").read_text()) == told["rows"]
    assert main([*words, "smooth"]) == 0
    shown = capsys.readouterr()
    assert "smooth: recorded already" in shown.err
    assert "nominal" in shown.out
    assert main([*words, "smooth", "--seed", "1"]) == 2
    assert "has seed 0, this run has 1" in capsys.readouterr().err
    assert main([*words, "dance"]) == 2
