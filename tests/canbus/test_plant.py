"""A run in virtual time: the plant's contract, states, limits, record."""

from pathlib import Path

import can
import numpy as np
import pytest

from cjt_gym.canbus.link import Arrival
from cjt_gym.canbus.nodes import SPARE, Nodes
from cjt_gym.canbus.plant import CanPlant
from cjt_gym.canbus.safety import FAULTS, MOVES, Guard, HardwareFault, State
from cjt_gym.canbus.timing import Timing
from cjt_gym.errors import ConfigurationError, HardwareError
from cjt_gym.plant import SimulatedPlant
from cjt_gym.records import read_record
from tests.canbus.bench import DRIVES, config, virtual_plant


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
    guard = Guard(given.limits, given.dt, given.soft, given.overrun)
    for state in State:
        for target in State:
            guard.state = state
            if target in MOVES[state]:
                guard.move(target)
                assert guard.state is target
            else:
                with pytest.raises(HardwareError, match="cannot become"):
                    guard.move(target)


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
        seen.append(plant.sent)
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
    assert record["tau_ref"][-1] == 3.0
    assert "tau" not in record  # no sensor measured it
    with pytest.raises(HardwareFault):
        plant.step(np.zeros(1))
    plant.close()


def test_record_of_another_format_and_no_overwriting(tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    with virtual_plant(config(), path)[0] as plant:
        plant.reset()
        for _ in range(5):
            plant.step(np.zeros(1))
    assert len(read_record(path)) > 5
    assert not path.with_suffix(".csv").exists()
    plant, emulator = virtual_plant(config(), path)
    plant.reset()
    with pytest.raises(ConfigurationError, match="is there already"):
        plant.step(np.zeros(1))
    assert emulator.torque == 0.0
    plant.close()


def test_every_fault_is_described() -> None:
    assert all(text for text in FAULTS.values())


def test_a_silent_node_is_named() -> None:
    given = config()
    from cjt_gym.canbus.emulator import Emulator
    from cjt_gym.canbus.virtual import VirtualLink

    emulator = Emulator(given)
    emulator.nodes[0].alive = False
    with pytest.raises(HardwareError, match=r"drive \(node 3\) did not confirm"):
        CanPlant(given, VirtualLink(emulator)).connect()


def test_measured_delays_are_what_environments_draw() -> None:
    import gymnasium

    import cjt_gym

    assert cjt_gym.__version__
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
    nodes = Nodes.of(config(drive=DRIVES["mit"], control=control))
    node = nodes.drive
    answer = Arrival(0.0, can.Message(arbitration_id=0, is_extended_id=False, data=bytes(6)))
    assert not node.is_excess(answer, 1e-3, 1.0)
    behind = 20 + 18
    for _ in range(behind):
        nodes.command(0.0)
    assert not any(node.is_excess(answer, 1e-3, 1.0) for _ in range(behind))
    more = [node.is_excess(answer, 1e-3, 1.0) for _ in range(round(SPARE) + 1)]
    assert more[-1]
