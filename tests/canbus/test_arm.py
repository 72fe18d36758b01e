"""Several joints on one bus: in step, safe together, in one record."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import can
import numpy as np
import pytest

from cjt_gym.canbus import protocols
from cjt_gym.canbus.arm import REHEARSAL, CanArm
from cjt_gym.canbus.config import parse_joints
from cjt_gym.canbus.emulated_arm import EmulatedArm
from cjt_gym.canbus.link import Arrival
from cjt_gym.canbus.protocols.contract import Fault as DriveFault
from cjt_gym.canbus.protocols.contract import Mode
from cjt_gym.canbus.safety import HardwareFault, State
from cjt_gym.canbus.shared_bus import SharedLink
from cjt_gym.canbus.virtual import VirtualLink
from cjt_gym.cli import main
from cjt_gym.errors import ConfigurationError, HardwareError
from cjt_gym.records import joints_of, one_joint, read_record
from cjt_gym.training.deploy.shipped import policy_path
from tests.canbus.soak import emulator, free_port
from tests.canbus.test_bus_load import joints, listed
from tests.canbus.test_buses import PATIENT

MIXED = ("moteus", "cia402", "odrive", "cia402")


def armed(
    *protocols: str, record: Path | None = None, **changes: Any
) -> tuple[CanArm, EmulatedArm, VirtualLink]:
    configs = parse_joints(joints(*(protocols or MIXED), **changes), "arm.toml", Path())
    emulated = EmulatedArm(configs)
    link = VirtualLink(emulated)
    arm = CanArm(configs, link, record)
    arm.connect()
    arm.arm()
    arm.reset()
    return arm, emulated, link


def test_every_joint_gets_its_own_command_at_the_same_time(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    arm, emulated, _ = armed(record=path)
    wanted = 3.0 * np.arange(1, 5)
    with arm:
        for _ in range(80):
            measured = arm.step(wanted, 0.5 * wanted)
            assert {m.t[0] for m in measured} == {measured[0].t[0]}
        np.testing.assert_allclose(emulated.torques, wanted, rtol=0.01)
        np.testing.assert_allclose([m.tau[0] for m in measured], wanted, rtol=0.3)
    assert emulated.torques == [0.0] * 4
    assert {e.drive.mode for e in emulated.emulators} == {Mode.DISABLED}
    record = read_record(path)
    assert len(record) == 130  # 80, and 50 that fade
    for k in range(4):
        np.testing.assert_allclose(record[f"joint_{k}/tau_cmd"][60:80], wanted[k])
        assert record[f"joint_{k}/tau_ref"][10] == 0.5 * wanted[k]
    known = record.provenance["joints"]
    assert [row["protocol"] for row in known.values()] == list(MIXED)
    assert "fault" not in record.provenance


def run(arm: CanArm, act: Callable[[], object]) -> None:
    """Let the joints push; something happens on the way."""
    with arm:
        for k in range(100):
            arm.step(np.full(4, 5.0))
            if k == 60:
                act()


@pytest.mark.parametrize("culprit", range(4))
def test_fault_of_one_takes_the_torque_of_all_away(culprit: int, tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    arm, emulated, _ = armed(record=path)
    zero = [float("nan")] * 4
    for k, one in enumerate(emulated.emulators):
        one.torque_changed = lambda t, torque, k=k: zero.__setitem__(k, t)  # type: ignore[misc]
    fail = emulated.emulators[culprit].drive.fail
    with pytest.raises(HardwareFault, match=f"joint_{culprit}") as caught:
        run(arm, lambda: fail(DriveFault.OVER_CURRENT))
    assert emulated.torques == [0.0] * 4
    assert max(zero) - min(zero) <= 0.1 + 2.0 * arm.dt  # an ODrive says it in its heartbeat
    record = read_record(path)
    assert record.provenance["fault"] == {
        "joint": f"joint_{culprit}",
        "kind": caught.value.fault.kind,
        "text": caught.value.fault.text.removeprefix(f"joint_{culprit}: "),
    }
    assert [record[f"joint_{k}/tau_cmd"][-1] for k in range(4)] == [0.0] * 4
    assert np.all(np.isfinite(record["joint_3/q_m"]))


def test_delays_of_all_joints_are_measured_together() -> None:
    tables = joints(*["mit"] * 3, bus={"bitrate": 1_000_000}, control={"rate_hz": 1000})
    tables["emulator"]["latency"] = {"value": 3e-4, "unit": "s"}
    configs = parse_joints(tables, "arm.toml", Path())
    arm = CanArm(configs, VirtualLink(EmulatedArm(configs)))
    with arm:
        arm.connect()
        begin = arm.link.now()
        before = [sum(delays.values()) for delays in arm.measured_delays()]
        assert arm.link.now() - begin == pytest.approx(REHEARSAL * arm.dt)
        arm.arm()
        arm.reset()
        for _ in range(50):
            arm.step(np.zeros(3))
        during = [sum(joint.timing.delay(arm.dt).values()) for joint in arm.joints]
        assert before == pytest.approx(during, abs=2e-4)
        with pytest.raises(HardwareError, match="one is running"):
            arm.measured_delays()


class Behind:
    """A link whose frames arrive late, until it catches up and all arrive at once.

    Attributes:
        late: By how much [s].
    """

    def __init__(self, link: VirtualLink, late: float) -> None:
        self.late = late
        self.stamps, self.now, self.wait_until = link.stamps, link.now, link.wait_until
        self.send, self.watch, self.close = link.send, link.watch, link.close
        self._receive = link.receive
        self._waiting: list[Arrival] = []

    def receive(self) -> list[Arrival]:
        self._waiting += [frame._replace(t=frame.t + self.late) for frame in self._receive()]
        found = [frame for frame in self._waiting if frame.t <= self.now() or not self.late]
        self._waiting = [frame for frame in self._waiting if frame not in found]
        return [frame._replace(t=min(frame.t, self.now())) for frame in found]


def behind(protocol: str, late: float) -> tuple[CanArm, Behind]:
    """Return two joints that are ready for a run at 1 kHz, on a link that is late [s]."""
    allowed = {"value": 0.02, "unit": "s"}
    control = {"rate_hz": 1000, "missed": 20, "overrun": allowed, "watchdog": allowed}
    configs = parse_joints(joints(protocol, protocol, control=control), "arm.toml", Path())
    link = Behind(VirtualLink(EmulatedArm(configs)), late)
    arm = CanArm(configs, link)
    arm.connect()
    arm.arm()
    arm.reset()
    return arm, link


@pytest.mark.parametrize("protocol", ["moteus", "cia402"])
@pytest.mark.parametrize("late", [0.003, 0.015])
def test_answers_from_before_a_run_are_no_repeated_ones(protocol: str, late: float) -> None:
    arm, link = behind(protocol, late)
    with arm:
        for k in range(40):
            link.late = late if k < 3 else 0.0
            arm.step(np.zeros(2))


def test_a_drive_whose_reports_are_as_old_as_allowed_is_not_deaf() -> None:
    arm, _ = behind("moteus", 0.015)
    with arm:
        for _ in range(40):
            arm.step(np.full(2, arm.joints[0].limits.tau))


def _command(arm: CanArm, link: VirtualLink, emulated: EmulatedArm) -> None:
    arm.step(np.array([5.0, np.nan, 5.0, 5.0]))


def _exception(arm: CanArm, link: VirtualLink, emulated: EmulatedArm) -> None:
    raise KeyboardInterrupt


def _bus_off(arm: CanArm, link: VirtualLink, emulated: EmulatedArm) -> None:
    link.is_off = True


def _dead(arm: CanArm, link: VirtualLink, emulated: EmulatedArm) -> None:
    emulated.emulators[1].nodes[0].alive = False


def _late(arm: CanArm, link: VirtualLink, emulated: EmulatedArm) -> None:
    link.wait_until(link.now() + 3.0 * arm.dt)


@pytest.mark.parametrize("act", [_command, _exception, _bus_off, _dead, _late])
def test_whatever_goes_wrong_no_torque_is_left_within_the_watchdog(act: Any) -> None:
    arm, emulated, link = armed()
    with pytest.raises((HardwareFault, KeyboardInterrupt)):
        run(arm, lambda: act(arm, link, emulated))
    emulated.advance(emulated.now + 2.0 * arm.dt)
    assert emulated.torques == [0.0] * 4
    assert all(joint.state is State.FAULT for joint in arm.joints)


def test_a_dead_program_leaves_no_torque_on_any_joint() -> None:
    arm, emulated, _ = armed()
    for _ in range(60):
        arm.step(np.full(4, 5.0))
    assert min(map(abs, emulated.torques)) > 0.0
    emulated.advance(emulated.now + 0.006)
    assert emulated.torques == [0.0] * 4


@pytest.mark.parametrize("which", [1, 3])
def test_ctrl_c_while_one_is_enabled_leaves_all_disabled(which: int) -> None:
    arm, emulated, link = armed()

    def interrupt(now: float) -> None:
        if emulated.emulators[which].drive.mode is Mode.ENABLED:
            raise KeyboardInterrupt

    link.watch(interrupt, 1e-3)
    with pytest.raises(KeyboardInterrupt):
        arm.step(np.ones(4))
    assert {e.drive.mode for e in emulated.emulators} == {Mode.DISABLED}
    link.watch(lambda now: None, 1e-3)
    with contextlib.suppress(HardwareFault):
        arm.close()


def test_a_joint_that_may_not_be_armed_leaves_the_others_still() -> None:
    configs = parse_joints(joints("moteus", "dbc"), "arm.toml", Path())
    configs[1].drive.settings.limits.__dict__["watchdog"] = 0.0
    emulated = EmulatedArm(configs)
    with CanArm(configs, VirtualLink(emulated)) as arm:
        arm.connect()
        with pytest.raises(HardwareError, match="must stop by itself"):
            arm.arm()
        with pytest.raises(HardwareError):
            arm.step(np.ones(2))
    assert emulated.torques == [0.0, 0.0]


def test_frames_for_all_nodes_go_out_once_and_last() -> None:
    sent: list[can.Message] = []

    class Bus:
        def send(self, messages: Any) -> None:
            sent.extend(messages)

        def now(self) -> float:
            return 0.0

        def receive(self) -> list[Arrival]:
            return []

    shared = SharedLink(2, 1e-3, Bus())  # type: ignore[arg-type]
    sync = can.Message(arbitration_id=0x80, is_extended_id=False)
    shared.gather()
    for k, tap in enumerate(shared.taps):
        own = can.Message(arbitration_id=0x200 + k, is_extended_id=False, data=b"\1")
        tap.send([own, sync])
    assert sent == []
    shared.flush()
    assert [message.arbitration_id for message in sent] == [0x200, 0x201, 0x80]


def test_joint_that_is_there_twice_or_has_no_plain_name_is_refused() -> None:
    tables = joints("moteus", "moteus")
    tables["joints"][1]["name"] = "a/b"
    with pytest.raises(ConfigurationError, match="must be letters, digits"):
        parse_joints(tables, "arm.toml", Path())


def test_command_runs_all_joints_and_each_can_be_diagnosed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out, own = tmp_path / "arm.toml", tmp_path / "run.csv", tmp_path / "own.csv"
    path.write_text(listed(joints("cia402", "moteus")))
    words = ["hardware", str(path), "--emulated", "--reference", "step", "--duration", "0.5"]
    assert main([*words, "--out", str(out), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert set(told["joints"]) == {"joint_0", "joint_1"}
    assert max(told["joints"].values()) < 12.0
    record = read_record(out)
    assert joints_of(record) == ("joint_0", "joint_1")
    assert np.abs(record["joint_0/tau_ref"] - record["joint_1/tau_ref"]).max() > 1.0
    assert main(["convert", str(out), "--joint", "joint_1", "--out", str(own)]) == 0
    part = read_record(own)
    np.testing.assert_allclose(part["q_m"], record["joint_1/q_m"])
    assert (part.joint, part.provenance["protocol"]) == ("orange_80_6000", "moteus")
    assert part.provenance["kp"] > 0.0
    assert part.provenance["delays_s"]["measurement_delay.delay"] > 0.0
    assert main(["convert", str(out), "--joint", "joint_2", "--out", str(tmp_path / "x.csv")]) == 2
    assert main(["convert", str(own), "--joint", "joint_1", "--out", str(tmp_path / "x.csv")]) == 2
    assert main([*words, *3 * ["--controller", "pd"], "--out", str(tmp_path / "x.csv")]) == 2
    assert "once for each of joint_0, joint_1, got 3" in capsys.readouterr().err
    assert main([*words[:2], "--dry-run", "--duration", "0.02"]) == 0


def test_an_experiment_moves_every_joint_and_is_not_repeated(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = tmp_path / "arm.toml", tmp_path / "series"
    tables = joints("cia402", "moteus", control={"rate_hz": 200})
    tables["emulator"]["watchdog"] = {"value": 0.008, "unit": "s"}
    tables["joints"][1]["joint"] = {**tables["joints"][1]["joint"], "file": "orange_100_6000"}
    path.write_text(listed(tables))
    words = ["hardware", str(path), "--emulated", "--experiment", "steps", "--out", str(out)]
    assert main(words) == 0
    record = read_record(out / "steps.csv")
    for name, joint in (("joint_0", "orange_80_6000"), ("joint_1", "orange_100_6000")):
        assert record.provenance["joints"][name]["excitation"] == "steps"
        assert np.ptp(record[f"{name}/tau_cmd"]) > 5.0
        assert one_joint(record, name).joint == joint
    assert np.abs(record["joint_0/tau_cmd"] - record["joint_1/tau_cmd"]).max() > 1.0
    assert main(words) == 0
    assert "steps: recorded already" in capsys.readouterr().err


def with_torque_sensors(tables: dict[str, Any], folder: Path) -> str:
    """Return tables of joints as TOML, each with a torque sensor of its own beside it."""
    shipped = Path(protocols.__file__).parent / "data"
    text = listed(tables)
    for k in range(len(tables["joints"])):
        dbc = (shipped / "joint_sensor.dbc").read_text()
        (folder / f"own_{k}.dbc").write_text(dbc.replace("2415919872", str(2415919872 + 16 * k)))
        mapping = (shipped / "torque_sensor.map.toml").read_text()
        (folder / f"own_{k}.map.toml").write_text(mapping.replace("joint_sensor", f"own_{k}"))
        sensor = f'[joints.sensors.torque]\nprotocol = "dbc"\nfile = "own_{k}.map.toml"\n'
        head, mark, tail = text.partition(f'name = "joint_{k}"')
        own, following, rest = tail.partition("[[joints]]")
        text = head + mark + own + sensor + following + rest
    return text


def test_each_joint_of_the_benchmark_has_a_policy_of_its_own(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = tmp_path / "arm.toml", tmp_path / "series"
    tables = joints("moteus", "moteus", control={"rate_hz": 1000})
    path.write_text(with_torque_sensors(tables, tmp_path))
    other = tmp_path / "other.npz"
    other.write_bytes(policy_path("orange_residual").read_bytes())
    words = ["hardware", str(path), "--emulated", "--benchmark", "smooth", "--duration", "3"]
    words += ["--amplitude", "5", "--out", str(out), "--json"]
    assert main([*words, "--policy", "orange_residual", "--policy", str(other)]) == 0
    rows = json.loads(capsys.readouterr().out)["rows"]
    assert [row["where"] for row in rows] == [
        f"joint_{k}: {where}" for k in range(2) for where in ("real", "nominal")
    ]
    assert {row["kind"] for row in rows} == {"residual"}
    record = read_record(out / "smooth.csv")
    told = [own["policy"] for own in record.provenance["joints"].values()]
    assert told == ["orange_residual", str(other)]
    for row, name in zip(rows[::2], ("joint_0", "joint_1"), strict=True):
        errors = record[f"{name}/tau_ref"] - record[f"{name}/tau"]
        assert row["rmse"] == pytest.approx(np.sqrt(np.mean(errors[1000:3000] ** 2)), rel=0.05)


@pytest.mark.slow  # in real time
def test_two_terminals_with_two_joints(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, out = tmp_path / "arm.toml", tmp_path / "run.csv"
    bus = {"interface": "socketcand", "channel": "can0", "port": free_port()}
    tables = joints("cia402", "moteus", bus=bus, control=PATIENT | {"rate_hz": 500})
    path.write_text(listed(tables))
    with emulator(path):
        assert main(["hardware", str(path)]) == 0
        assert "joint_1: dq_m" in capsys.readouterr().out
        words = ["hardware", str(path), "--arm", "--controller", "none", "--reference", "smooth"]
        assert main([*words, "--duration", "0.3", "--out", str(out)]) == 0
    assert len(read_record(out)) == 200
