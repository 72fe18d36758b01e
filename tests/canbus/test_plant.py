"""A run in virtual time: the plant's contract, states, limits, record."""

import contextlib
import errno
import os
from dataclasses import replace
from pathlib import Path

import can
import gymnasium
import numpy as np
import pytest

from cjt_gym.canbus.dialogue import AFTERWARDS
from cjt_gym.canbus.emulator import Emulator
from cjt_gym.canbus.link import Arrival
from cjt_gym.canbus.nodes import SPARE, Nodes
from cjt_gym.canbus.plant import CanPlant
from cjt_gym.canbus.protocols.contract import Mode
from cjt_gym.canbus.safety import MOVES, Guard, HardwareFault, State
from cjt_gym.canbus.timing import Timing
from cjt_gym.canbus.virtual import VirtualLink
from cjt_gym.disk import to_toml
from cjt_gym.errors import ConfigurationError, HardwareError, RecordError
from cjt_gym.plant import SimulatedPlant
from cjt_gym.records import FORMATS, read_record, write_record
from tests.canbus.bench import DRIVES, config, document, virtual_plant


def test_follows_the_simulation_of_the_same_joint() -> None:
    given = config(control={"soft": {"value": 0.0, "unit": "s"}})
    plant, emulator = virtual_plant(given)
    simulated = SimulatedPlant(emulator.joint, 1, given.dt, given.dt / 8)
    plant.reset()
    simulated.reset(seed=0)
    wanted = 20.0 * np.sin(2.0 * np.pi * 4.0 * np.arange(200) * given.dt)
    real, ideal = [], []
    for torque in wanted:
        command = np.array([torque])
        real.append(plant.step(command).tau[0])
        ideal.append(simulated.step(command).tau[0])
    plant.close()
    # ODrive's encoder is a float of 32 bits, at most a millisecond old; the torque is the spring's
    scatter = np.std(np.array(real) - np.array(ideal))
    assert scatter < 0.05 * np.std(ideal)


def test_states_follow_their_table() -> None:
    given = config()
    plant, emulator = virtual_plant(given)
    assert plant.state is State.ARMED
    plant.reset()
    plant.step(np.zeros(1))
    assert plant.state is State.RUNNING
    plant.stop()
    assert plant.state is State.ARMED
    plant.reset()
    plant.step(np.zeros(1))
    plant.close()
    assert plant.state is State.DISCONNECTED
    assert emulator.torque == 0.0
    guard = Guard(given.limits, given.dt, given.soft, given.overrun, given.missed)
    for state in State:
        for target in State:
            guard.state = state
            if target in MOVES[state]:
                guard.move(target)
                assert guard.state is target
            else:
                with pytest.raises(HardwareError, match="cannot become"):
                    guard.move(target)


def test_an_angle_may_move_for_as_long_as_its_reports_stayed_away() -> None:
    given = config()
    guard = Guard(given.limits, given.dt, given.soft, given.overrun, given.missed)
    moved = 0.9 * given.limits.dq_m * 10 * given.dt  # in ten control steps
    values = dict.fromkeys(("q_m", "dq_m", "tau", "deflection", "i", "tau_m"), 0.0)
    assert guard.check(values, given.dt) is None
    assert guard.check(values | {"q_m": moved}, 10 * given.dt) is None
    fault = guard.check(values, given.dt)
    assert fault is not None
    assert fault.kind == "corrupt"


def test_nothing_moves_unless_armed() -> None:
    given = config()
    plant, emulator = virtual_plant(given)
    plant.close()
    with pytest.raises(HardwareError):
        plant.step(np.ones(1))
    with pytest.raises(HardwareError, match="must be armed"):
        plant.reset()
    assert emulator.torque == 0.0


def test_command_and_its_rate_are_limited_and_begin_softly() -> None:
    limits = {
        "tau": {"value": 30.0, "unit": "N m"},
        "tau_rate": {"value": 1000.0, "unit": "N m/s"},
    }
    plant, emulator = virtual_plant(config(limits=limits))
    plant.reset()
    seen = []
    for _ in range(100):
        plant.step(np.array([1000.0]))
        seen.append(plant.joint.sent)
    steps = np.diff([0.0, *seen])
    assert max(seen) == pytest.approx(30.0)
    assert steps.max() <= 1000.0 * plant.dt + 1e-9
    assert seen[9] == pytest.approx(30.0 * 10 * plant.dt / 0.1)  # grows over 0.1 s
    plant.stop()
    assert emulator.torque == 0.0


def test_record_is_on_disk_at_every_step(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    plant, _ = virtual_plant(config(), path)
    plant.reset()
    for k in range(1, 30):
        plant.step(np.array([5.0]), tau_ref=3.0)
        assert len(read_record(path)) == k
    with pytest.raises(HardwareFault) as caught:
        plant.step(np.array([np.nan]))
    assert caught.value.fault.kind == "command"
    record = read_record(path)
    assert len(record) == 30
    assert record.provenance["fault"]["kind"] == "command"
    assert record.joint == "orange_80_6000"
    assert record.provenance["stamps"] == "reception"
    assert record["tau_ref"][-1] == 3.0
    assert "tau" not in record  # no sensor measured it
    with pytest.raises(HardwareFault):
        plant.step(np.zeros(1))
    plant.close()


def test_the_round_trip_of_every_exchange_is_in_the_record(tmp_path: Path) -> None:
    path, late = tmp_path / "run.csv", {"latency": {"value": 3e-4, "unit": "s"}}
    plant, emulator = virtual_plant(config(drive=DRIVES["moteus"], emulator=late), path)
    plant.reset()
    for _ in range(20):
        plant.step(np.zeros(1))
    emulator.nodes[0].alive = False
    plant.step(np.zeros(1))
    with pytest.raises(HardwareFault):
        plant.step(np.zeros(1))
    record = read_record(path)
    assert record["round_trip"][0] == 0.0  # nothing was asked before
    np.testing.assert_allclose(record["round_trip"][1:21], 6e-4, atol=2e-5)
    assert record["round_trip"][21] == 0.0  # no answer
    plant.close()


def test_record_of_another_format_and_no_overwriting(tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    with virtual_plant(config(), path)[0] as plant:
        plant.reset()
        for _ in range(5):
            plant.step(np.zeros(1))
    assert len(read_record(path)) > 5
    assert not path.with_suffix(".csv").exists()
    with pytest.raises(ConfigurationError, match="already exists"):
        CanPlant(config(), record=path)
    with pytest.raises(RecordError, match="must end in .csv"):
        CanPlant(config(), record=tmp_path / "run.xyz")


@pytest.mark.parametrize("suffix", [".csv", ".npz"])
def test_a_record_does_not_overwrite_the_configuration_of_its_run(
    suffix: str, tmp_path: Path
) -> None:
    given = tmp_path / "run.toml"
    given.write_text(to_toml(document()))
    with pytest.raises(RecordError, match="belongs to no record"):
        CanPlant(config(), record=given.with_suffix(suffix))
    with pytest.raises(RecordError, match="belongs to no record"):
        write_record(config().joint.simulate(np.zeros(10), dt=1e-3), given.with_suffix(suffix))
    assert given.read_text() == to_toml(document())
    assert list(tmp_path.iterdir()) == [given]


def test_a_silent_node_is_named() -> None:
    given = config()
    emulator = Emulator(given)
    emulator.nodes[0].alive = False
    with pytest.raises(HardwareError, match=r"drive \(node 3\) did not confirm"):
        CanPlant(given, VirtualLink(emulator)).connect()


def test_measured_delays_are_what_environments_draw() -> None:
    timing = Timing()
    rng = np.random.default_rng(0)
    timing.lateness.extend(rng.uniform(1e-4, 3e-4, 1000).tolist())
    timing.ages.extend(rng.uniform(5e-4, 9e-4, 1000).tolist())
    timing.answers.extend([4e-4] * 1000)
    assert timing.delay(1e-3)["command_delay.delay"] == pytest.approx(4e-4, abs=2e-5)
    drawn = timing.randomization(1e-3)
    assert drawn["measurement_delay.delay"]["low"] == pytest.approx(7.2e-4, abs=2e-5)
    assert drawn["measurement_delay.delay"]["high"] == pytest.approx(10.8e-4, abs=2e-5)
    middle = timing.delay(1e-3)
    effects = {name.split(".")[0]: {"delay": value} for name, value in middle.items()}
    env = gymnasium.make("CJT/TorqueTracking-v0", effects=effects, randomization=drawn)
    parameters = env.reset(seed=1)[1]["parameters"]
    low, high = (drawn["command_delay.delay"][end] for end in ("low", "high"))
    assert low <= parameters["command_delay.delay"] <= high


def test_a_loop_that_catches_up_is_answered_as_often_as_it_asked() -> None:
    """As late as it may be, it sends what it missed at once, and then waits for old answers."""
    allowed = {"value": 0.02, "unit": "s"}
    control = {"rate_hz": 1000, "missed": 20, "overrun": allowed, "watchdog": allowed}
    nodes = Nodes(config(drive=DRIVES["mit"], control=control))
    node = nodes.drive
    answer = Arrival(0.0, can.Message(arbitration_id=0, is_extended_id=False, data=bytes(6)))
    assert not node.is_excess(answer, 1e-3, 1.0)
    behind = 20 + 20 + round(SPARE)
    for _ in range(behind):
        nodes.command(0.0)
    assert not any(node.is_excess(answer, 1e-3, 1.0) for _ in range(behind))
    assert node.is_excess(answer, 1e-3, 1.0)


def test_reports_that_waited_while_the_computer_stood_still_are_not_too_many() -> None:
    allowed = {"value": 0.02, "unit": "s"}
    control = {"rate_hz": 1000, "missed": 2, "overrun": allowed, "watchdog": allowed}
    node = Nodes(config(control=control)).drive
    assert not node.is_asked
    report = can.Message(arbitration_id=0, is_extended_id=False)
    times = [0.001 * k for k in range(10)] + [0.03] * 20
    assert not any(node.is_excess(Arrival(t, report), 1e-3, 3.5e-3) for t in times)
    assert any(node.is_excess(Arrival(0.03, report), 1e-3, 3.5e-3) for _ in range(6))


@pytest.mark.parametrize("within", [True, False])
def test_ctrl_c_while_enabling_leaves_the_drive_disabled(within: bool) -> None:
    plant, emulator = virtual_plant(config())
    plant.reset()
    assert isinstance(plant.link, VirtualLink)
    link = plant.link

    def interrupt(now: float) -> None:
        if emulator.drive.mode is Mode.ENABLED and plant.state is State.RUNNING:
            raise KeyboardInterrupt

    link.watch(interrupt, 1e-3)
    with pytest.raises(KeyboardInterrupt), plant if within else contextlib.nullcontext():
        plant.step(np.ones(1))
    assert emulator.drive.mode is Mode.DISABLED
    assert plant.joint.guard.fault is not None
    assert plant.joint.guard.fault.kind == "interrupt"
    plant.close()


def test_a_row_is_not_repeated_where_ctrl_c_comes_as_it_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, write = tmp_path / "run.csv", os.write
    plant, _ = virtual_plant(config(), path)

    def interrupted(file: int, data: bytes) -> int:
        monkeypatch.undo()
        write(file, data)
        raise KeyboardInterrupt

    def run() -> None:
        with plant:
            plant.reset()
            for k in range(20):
                if k == 10:
                    monkeypatch.setattr(os, "write", interrupted)
                plant.step(np.ones(1))

    with pytest.raises(KeyboardInterrupt):
        run()
    record = read_record(path)
    assert len(record) == 12
    np.testing.assert_allclose(record["t"], np.arange(12) * plant.dt)
    assert record.provenance["fault"]["kind"] == "interrupt"


def test_ctrl_c_while_it_fades_switches_off_at_once() -> None:
    plant, emulator = virtual_plant(config())
    commands: list[float] = []

    def run() -> None:
        with plant:
            plant.reset()
            for _ in range(60):
                plant.step(np.array([20.0]))
            assert isinstance(plant.link, VirtualLink)
            plant.link.sent = lambda t, message: commands.append(emulator.torque)
            plant.link.watch(interrupt, 1e-3)

    def interrupt(now: float) -> None:
        if len(commands) == 10:
            commands.append(0.0)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run()
    assert emulator.torque == 0.0
    assert emulator.drive.mode is Mode.DISABLED


@pytest.mark.parametrize("name", ["run.csv", "run.npz"])
@pytest.mark.parametrize("room", [0, 7, 100])
def test_full_disk_takes_the_torque_away_and_leaves_a_record(
    name: str, room: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plant, emulator = virtual_plant(config(), tmp_path / name)
    idle: list[float] = []
    write, left = os.write, [1 << 20]

    def limited(file: int, data: bytes) -> int:
        """Take as many bytes as there is room for."""
        taken = min(len(data), left[0])
        left[0] -= taken
        if not taken:
            raise OSError(errno.ENOSPC, "No space left on device")
        return write(file, data[:taken])

    monkeypatch.setattr("cjt_gym.canbus.journal.os.write", limited)
    monkeypatch.setitem(FORMATS, ".npz", replace(FORMATS[".npz"], write=_no_room))
    plant.reset()
    for _ in range(30):
        plant.step(np.array([5.0]))
    assert isinstance(plant.link, VirtualLink)
    off = [bytes(frame.data) for frame in plant.joint.nodes.drive.master.disable()][-1]
    plant.link.sent = lambda t, frame: idle.append(t) if bytes(frame.data) == off else None
    left[0] = room

    def go_on() -> None:
        for _ in range(5):
            plant.step(np.array([5.0]))

    with pytest.raises(HardwareFault, match="No space left on device") as caught:
        go_on()
    assert caught.value.fault.kind == "record"
    assert emulator.torque == 0.0
    assert len(idle) == 1 + AFTERWARDS  # as after any fault
    plant.close()
    record = read_record(tmp_path / "run.csv")
    assert len(record) == 30 if room < 100 else len(record) >= 30
    assert record.provenance["fault"]["kind"] == "record"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run.csv", "run.toml"]


def _no_room(columns: object, path: Path) -> None:
    path.write_bytes(b"PK")
    raise OSError(errno.ENOSPC, "No space left on device")


def test_disk_that_is_full_at_the_end_is_told_and_leaves_the_rows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(FORMATS, ".npz", replace(FORMATS[".npz"], write=_no_room))
    plant, emulator = virtual_plant(config(), tmp_path / "run.npz")
    plant.reset()
    plant.step(np.ones(1))
    with pytest.raises(HardwareError, match="could not be completed") as caught:
        plant.stop()
    assert "run.csv" in str(caught.value)
    assert emulator.drive.mode is Mode.DISABLED
    assert len(read_record(tmp_path / "run.csv")) > 1
    assert not (tmp_path / "run.npz").exists()


def test_disk_that_is_full_before_is_one_clear_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(file: int, data: bytes) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("cjt_gym.canbus.journal.os.write", full)
    plant, emulator = virtual_plant(config(), tmp_path / "run.csv")
    plant.reset()
    with pytest.raises(ConfigurationError, match="cannot be written: .*No space left"):
        plant.step(np.ones(1))
    assert emulator.drive.mode is Mode.DISABLED
    assert list(tmp_path.iterdir()) == []
    plant.close()
