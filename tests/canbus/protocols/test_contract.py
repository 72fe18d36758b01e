"""What holds for every protocol of the table."""

import math
import random

import pytest
from can import Message
from hypothesis import given, settings
from hypothesis import strategies as st

from cjt_gym.canbus.protocols import PROTOCOLS, protocol_of, settings_of
from cjt_gym.canbus.protocols.contract import CHANNELS, Fault, Limits, Mode, Update
from cjt_gym.errors import ConfigurationError, ProtocolError, UnknownNameError
from tests.canbus.protocols.line import DRIVES, Line, settings_for, started

JOINT = {
    "q_m": 0.7,
    "dq_m": -0.04,
    "tau_m": 0.9,
    "i": 1.5,
    "temperature": 41.0,
    "v_bus": 48.0,
    "tau": 0.8,
    "q_l": 0.69,
    "dq_l": -0.03,
}
every_protocol = pytest.mark.parametrize("name", sorted(PROTOCOLS))


@every_protocol
def test_the_tests_know_the_protocol(name: str) -> None:
    assert name in DRIVES
    assert protocol_of(name).name == name


@every_protocol
def test_a_command_arrives_and_the_reports_come_back(name: str) -> None:
    line = started(name)
    line.show(JOINT)
    low, high = line.master.torque_range
    torque = 0.4 * min(high, 20.0)
    line.pass_time(0.2, lambda: line.master.command(torque))
    assert line.firmware.mode is Mode.ENABLED
    assert line.firmware.torque == pytest.approx(torque, abs=0.01 * torque)
    assert set(line.channels) == line.master.channels <= set(CHANNELS)
    for channel, value in line.channels.items():
        assert value == pytest.approx(JOINT[channel], abs=0.03), channel
    assert low < 0 < high


@every_protocol
def test_reports_come_as_often_as_promised(name: str) -> None:
    line = started(name)
    period = round(line.settings.period / 1e-3)
    counts = dict.fromkeys(line.master.channels, 0)
    for _ in range(500):
        heard = line.send(line.master.command(0.0)) + line.pass_time(period * 1e-3)
        for frame in heard:
            for channel in (line.master.decode(frame) or Update()).channels:
                counts[channel] += 1
    seconds = 500 * period * 1e-3
    for channel, count in counts.items():
        expected = seconds / line.master.periods[channel]
        assert expected - 2 <= count <= 1.3 * expected + 2, channel


@every_protocol
def test_disabling_needs_no_answer(name: str) -> None:
    line = started(name)
    line.send(line.master.command(0.5))
    line.send(line.master.disable())
    assert line.firmware.mode is Mode.DISABLED
    assert line.firmware.torque == 0.0


@every_protocol
def test_nothing_but_enabling_makes_torque(name: str) -> None:
    line = Line(settings_for(name), name)
    line.pass_time(0.3)
    line.run(line.master.configure())
    line.run(line.master.clear())
    line.pass_time(0.05, line.master.poll)
    if not PROTOCOLS[name].command_enables:
        line.pass_time(0.05, lambda: line.master.command(0.5))
    assert line.firmware.mode is Mode.DISABLED
    assert line.firmware.torque == 0.0


@every_protocol
def test_the_drive_stops_by_itself_where_the_master_is_silent(name: str) -> None:
    line = started(name)
    line.pass_time(0.02, lambda: line.master.command(0.5))
    assert line.firmware.torque != 0.0
    line.pass_time(line.settings.watchdog + 2e-3)
    assert line.firmware.torque == 0.0


@every_protocol
def test_polling_does_not_keep_the_torque_alive(name: str) -> None:
    line = started(name)
    line.pass_time(0.02, lambda: line.master.command(0.5))
    line.pass_time(line.settings.watchdog + 0.01, line.master.poll)
    assert line.firmware.torque == 0.0


@every_protocol
@pytest.mark.parametrize("fault", Fault)
def test_a_fault_is_seen_and_can_be_cleared(name: str, fault: Fault) -> None:
    line = started(name)
    line.firmware.fail(fault)
    line.pass_time(0.15, lambda: line.master.command(0.5))
    assert line.firmware.torque == 0.0
    assert line.mode is Mode.FAULT
    assert line.error
    line.run(line.master.clear())
    line.pass_time(0.15, line.master.poll)
    assert line.firmware.mode is Mode.DISABLED
    line.run(line.master.enable())
    line.pass_time(0.15, lambda: line.master.command(0.5))
    assert line.mode is not Mode.FAULT or not line.error
    assert line.firmware.torque == pytest.approx(0.5, rel=0.02)


@every_protocol
def test_limits_of_the_drive(name: str) -> None:
    limits = Limits(tau_m=1.0, dq_m=2.0, temperature=80.0)
    line = Line(settings_for(name, limits), name)
    high = line.master.torque_range[1]
    line.start()
    line.pass_time(0.02, lambda: line.master.command(min(high, 1e3)))
    assert line.firmware.torque <= 1.0
    line.show({**JOINT, "dq_m": 2.5})
    line.pass_time(0.02, lambda: line.master.command(0.5))
    assert line.firmware.fault is Fault.OVER_SPEED


@every_protocol
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_torque_that_is_none_is_refused(name: str, bad: float) -> None:
    master = PROTOCOLS[name].master(settings_for(name))
    with pytest.raises(ProtocolError, match="finite"):
        master.command(bad)


@every_protocol
@given(share=st.floats(-1.0, 1.0))
@settings(max_examples=30, deadline=None)
def test_torques_over_the_whole_range_arrive(name: str, share: float) -> None:
    line = started(name)
    high = min(line.master.torque_range[1], 1e4)
    frames = line.master.command(share * high)
    line.send(frames)
    assert line.firmware.torque == pytest.approx(share * high, abs=2e-3 * high)
    (read,) = [each for frame in frames if (each := line.master.commanded(frame)) is not None]
    assert read == pytest.approx(share * high, abs=2e-3 * high)


@every_protocol
@given(q=st.floats(-0.1, 0.1), dq=st.floats(-0.1, 0.1), tau=st.floats(-0.2, 0.2))
@settings(max_examples=20, deadline=None)
def test_values_of_the_joint_come_back(name: str, q: float, dq: float, tau: float) -> None:
    line = started(name)
    line.show({**JOINT, "q_m": q, "dq_m": dq, "tau_m": tau})
    line.pass_time(0.02, lambda: line.master.command(0.0))
    assert line.channels["q_m"] == pytest.approx(q, abs=2e-3)
    assert line.channels["dq_m"] == pytest.approx(dq, abs=2e-2)
    if "tau_m" in line.channels:
        assert line.channels["tau_m"] == pytest.approx(tau, abs=1e-2)


def random_frame(rng: random.Random, likely: list[int], fd: bool) -> Message:
    """Return a frame; half of them have an identifier that means something."""
    extended = rng.random() < 0.1
    identifier = rng.choice(likely) if rng.random() < 0.5 else rng.getrandbits(11)
    remote = not fd and rng.random() < 0.05
    size = rng.choice((8, 12, 16, 24, 48, 64) if fd and rng.random() < 0.5 else range(9))
    return Message(
        arbitration_id=identifier if not extended else rng.getrandbits(29),
        is_extended_id=extended,
        is_remote_frame=remote,
        is_fd=fd,
        data=b"" if remote else rng.randbytes(size),
    )


@every_protocol
def test_random_frames_bring_values_or_one_clear_error(name: str) -> None:
    line = started(name)
    line.pass_time(0.2, lambda: line.master.command(0.1))
    likely = sorted({frame.arbitration_id for frame in line.sent + line.heard})
    rng = random.Random(4)
    for _ in range(4000):
        line.survive(random_frame(rng, likely, PROTOCOLS[name].fd))


@every_protocol
def test_bad_settings_are_one_clear_error(name: str) -> None:
    drive = DRIVES[name]
    with pytest.raises(UnknownNameError, match="Did you mean 'node'"):
        settings_of(PROTOCOLS[name], {**drive, "nod": 1})
    with pytest.raises(ConfigurationError, match="node of .* must be a whole number"):
        settings_of(PROTOCOLS[name], {**drive, "node": 2**40})
    with pytest.raises(ConfigurationError, match="gear_ratio"):
        settings_of(PROTOCOLS[name], {**drive, "gear_ratio": 0.0})
    with pytest.raises(ConfigurationError, match="sign"):
        settings_of(PROTOCOLS[name], {**drive, "sign": 2})


def test_an_unknown_protocol_is_told_with_the_known_ones() -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'mit'"):
        protocol_of("mitt")
