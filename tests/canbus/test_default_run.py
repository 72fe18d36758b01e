"""A run with nothing but defaults ends without a fault, whatever the bus adds in delay."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cjt_gym import disk
from cjt_gym.baselines.gains import law_in_record, write_gains
from cjt_gym.baselines.pd_feedforward import ROW as PD
from cjt_gym.baselines.robust import SPARE_DELAY
from cjt_gym.canbus.config import HardwareConfig
from cjt_gym.canbus.emulator import Emulator
from cjt_gym.canbus.nodes import Nodes
from cjt_gym.canbus.plant import CanPlant
from cjt_gym.canbus.protocols.contract import SLOW
from cjt_gym.canbus.virtual import VirtualLink
from cjt_gym.cli import main
from cjt_gym.errors import ConfigurationError
from cjt_gym.hardware.delayed_law import designed_for, law_for
from cjt_gym.joint import JointFile, JointParameters, load_joint, to_toml
from cjt_gym.joint.build import file_of
from cjt_gym.plant import Measurement
from cjt_gym.records import Record, read_record, write_record
from cjt_gym.training.evaluation.after_diagnosis import recorded_law
from tests.canbus.bench import config, document, virtual_plant

CONTROLLERS = ("pd", "pd_feedforward", "pid_feedforward", "lqg", "open_loop")
FIXED = "output_fixed_rigid_gearbox"
ASKED = {"protocol": "odrive", "node": 1}
LIMITS = {"tau": {"value": 40.0, "unit": "N m"}, "dq_m": {"value": 7.0, "unit": "rad/s"}}


def written(tmp_path: Path, rate: int, emulator: dict[str, Any]) -> Path:
    path = tmp_path / "joint.toml"
    tables = document(
        drive=ASKED,
        joint={"effects": ["coulomb_asym"]},
        control={"rate_hz": rate},
        limits=LIMITS,
        emulator=emulator,
    )
    path.write_text(disk.to_toml(tables))
    return path


@pytest.mark.parametrize(
    ("controller", "rate"), [*((name, 500) for name in CONTROLLERS), ("pd_feedforward", 1000)]
)
def test_default_run_has_no_fault(
    controller: str, rate: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    late = {"latency": {"value": 2e-4, "unit": "s"}, "jitter": {"value": 5e-5, "unit": "s"}}
    path, out = written(tmp_path, rate, late), tmp_path / "run.csv"
    words = ["hardware", str(path), "--emulated", "--reference", "step", "--json"]
    words += ["--controller", controller, "--duration", "1", "--out", str(out)]
    assert main(words) == 0, capsys.readouterr().err
    record = read_record(out)
    assert "fault" not in record.provenance
    assert record.provenance["amplitude"] > 5.0
    assert json.loads(capsys.readouterr().out)["rmse"] < record.provenance["amplitude"]


@pytest.mark.parametrize("drive", [ASKED, {**ASKED, "reports": "cyclic", "cycle_ms": 1}])
def test_delay_is_measured_as_it_is_in_a_run(drive: dict[str, Any]) -> None:
    late = {"latency": {"value": 3e-4, "unit": "s"}}
    given = config(drive=drive, emulator=late)
    plant = CanPlant(given, VirtualLink(Emulator(given)))
    plant.connect()
    before = sum(plant.whole.measured_delays()[0].values())
    plant.arm()
    plant.reset()
    for _ in range(100):
        plant.step(np.zeros(1))
    during = sum(plant.joint.timing.delay(plant.dt).values())
    plant.close()
    assert before == pytest.approx(during, abs=3e-4)
    if "cycle_ms" not in drive:
        assert before == pytest.approx(plant.dt, abs=1e-5)  # asked for with the command before


def test_gains_are_designed_for_the_delay_and_weaker_the_longer_it_is() -> None:
    given = config()
    gains = [
        law_for("pd_feedforward", given.joint, given.dt, {"measurement_delay.delay": late}).kp  # type: ignore[attr-defined]
        for late in (0.0, given.dt, given.dt + 0.4 * SPARE_DELAY, 2.0 * given.dt)
    ]
    assert gains[0] > gains[1] == gains[2] > gains[3] > 0.0


def identified(tmp_path: Path, **effects: dict[str, float]) -> HardwareConfig:
    """Return the configuration of a joint whose file has these effects, as a diagnosis writes."""
    known, path = load_joint("orange_80_6000", FIXED, effects=effects), tmp_path / "found.toml"
    path.write_text(to_toml(file_of(known)))
    return config(joint={"file": str(path), "structure": FIXED, "effects": []})


def known_law(given: HardwareConfig) -> Any:
    return law_for("pd_feedforward", given.joint, given.dt, {"measurement_delay.delay": given.dt})


def test_gains_are_designed_for_what_was_identified(tmp_path: Path) -> None:
    p = config().joint.parameters
    heavy = {"inertia": {"I_m": 2.0 * p.I_m}, "damping": {"d_m": p.d_m + 5.0}}
    other = {"I_m": heavy["inertia"]["I_m"], "d_m": heavy["damping"]["d_m"]}
    late = {"measurement_delay": {"delay": config().dt}}
    wanted = PD.defaults(load_joint("orange_80_6000", FIXED, None, late, other), config().dt)
    found, nominal = known_law(identified(tmp_path, **heavy)), known_law(config())
    assert (found.kp, found.kd) == pytest.approx((wanted["kp"], wanted["kd"]))
    assert found.kd > 1.2 * nominal.kd
    lagging = known_law(identified(tmp_path, current_lag={"bandwidth": 100.0}))
    assert lagging.kp < nominal.kp
    late_drive = known_law(identified(tmp_path, command_delay={"delay": 3.0 * config().dt}))
    assert late_drive.kp < nominal.kp


def test_a_motor_that_is_known_to_be_weak_is_commanded_more(tmp_path: Path) -> None:
    nominal = known_law(config())
    k_t = config().joint.parameters.k_t
    weak = known_law(identified(tmp_path, torque_constant={"k_t": 0.8 * k_t}))
    seen = Measurement(*np.zeros((9, 1)))
    for reference in (4.0, 1e6):
        torque = weak.act(seen, np.array([reference]))
        weak.reset()
        alike = 0.8 * torque if reference < 10.0 else torque
        assert alike == pytest.approx(nominal.act(seen, np.array([reference])))
        nominal.reset()


def test_a_replay_commands_as_the_run_did() -> None:
    made = {"controller": "pd_feedforward", "kp": 0.0, "kd": 0.0, "command_gain": 1.25}
    record = Record({"tau": np.zeros(9)}, {"tau": "N m"}, dt=1e-3, provenance=made)
    _, law = recorded_law(record, load_joint("orange_80_6000", FIXED), ())
    torque = law.act(Measurement(*np.zeros((9, 1))), np.array([4.0]))
    assert torque == pytest.approx([5.0])


def test_a_record_holds_the_law_for_delays_and_for_a_weak_motor(tmp_path: Path) -> None:
    k_t = config().joint.parameters.k_t
    given = identified(tmp_path, torque_constant={"k_t": 0.8 * k_t})
    late = {"measurement_delay.delay": 3.0 * given.dt}
    law = law_for("lqg", given.joint, given.dt, late)
    made = law_in_record(*designed_for("lqg", given.joint, given.dt, late), law)
    zeros, path = {"tau": np.zeros(9)}, tmp_path / "made.csv"
    write_record(Record(zeros, {"tau": "N m"}, dt=given.dt, provenance=made), path)
    _, again = recorded_law(read_record(path), load_joint("orange_80_6000", FIXED), ())
    seen = Measurement(*np.full((9, 1), 0.01))
    for reference in (4.0, -3.0, 1e6):
        wanted = np.array([reference])
        assert again.act(seen, wanted) == pytest.approx(law.act(seen, wanted), rel=1e-12)


def test_given_gains_without_margin_are_refused_with_the_margin(tmp_path: Path) -> None:
    given, path = config(), tmp_path / "stiff.toml"
    write_gains(path, "pd_feedforward", {"kp": 1.5, "kd": 0.0071}, {})
    late = {"command_delay.delay": 3e-4, "measurement_delay.delay": 1.9e-3}
    law_for(str(path), given.joint, given.dt, {})  # without a delay they will do
    with pytest.raises(
        ConfigurationError, match=r"with a delay of 2\.2 ms .* 2 control steps; they bear 1"
    ):
        law_for(str(path), given.joint, given.dt, late)


def test_delay_that_no_gains_are_designed_for_is_refused() -> None:
    given = config()
    with pytest.raises(ConfigurationError, match="must be <= 100 control steps"):
        law_for("pd", given.joint, given.dt, {"measurement_delay.delay": 0.5})


@pytest.mark.parametrize(
    "tight",
    [
        {"tau": {"value": 6.0, "unit": "N m"}, "dq_m": {"value": 0.3, "unit": "rad/s"}},
        {"current": {"value": 0.6, "unit": "A"}},
        {"deflection": {"value": 0.0007, "unit": "rad"}},
    ],
    ids=["torque and speed", "current", "deflection"],
)
def test_default_reference_fits_the_limits(tight: dict[str, Any], tmp_path: Path) -> None:
    path, out = tmp_path / "joint.toml", tmp_path / "run.csv"
    path.write_text(disk.to_toml(document(drive=ASKED, limits=tight)))
    words = ["hardware", str(path), "--emulated", "--reference", "step", "--duration", "2"]
    assert main([*words, "--out", str(out)]) == 0
    record = read_record(out)
    assert 0.3 < record.provenance["amplitude"] <= 3.6
    assert np.abs(record["tau_ref"]).max() <= record.provenance["amplitude"]


def test_what_changes_slowly_may_be_seconds_old_and_what_moves_may_not() -> None:
    nodes = Nodes(config(drive=ASKED))
    for name, latest in nodes.latest.items():
        if name in SLOW:
            assert 1.0 <= latest.oldest <= 10.0
        else:
            assert latest.oldest == nodes.oldest(latest.period) <= 2.5 * nodes.dt


def test_a_temperature_that_is_lost_now_and_then_ends_no_run() -> None:
    plant, emulator = virtual_plant(config(drive=ASKED))
    plant.reset()
    temperature = 1 << 5 | 0x15
    emulator.tamper = lambda m, node, t: [] if m.arbitration_id == temperature else [m]
    for _ in range(500):  # a second without one
        plant.step(np.zeros(1))
    plant.close()


def test_a_joint_without_a_spring_has_a_law(tmp_path: Path) -> None:
    values = {"I_m": 0.75, "n": 50.0, "k_t": 0.06, "r": 0.4, "v_0": 48.0, "i_p": 20.0, "d_m": 1.0}
    path = tmp_path / "bench.toml"
    file = JointFile(JointParameters.from_values("bench", values))
    path.write_text(to_toml(file), encoding="utf-8")
    rigid = load_joint(path, "rigid")
    assert law_for("pd_feedforward", rigid, 1e-3, {"command_delay.delay": 1e-3}) is not None
