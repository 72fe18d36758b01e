"""Whatever comes over the bus or a line, nothing but a clear fault comes of it."""

from __future__ import annotations

from itertools import pairwise

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cjt_gym.canbus.ports.slcan import line_of, parse_line
from cjt_gym.canbus.ports.socketcand import parse_send
from cjt_gym.canbus.settings import EmulatorSettings
from cjt_gym.canbus.wire import Wire
from tests.canbus.bench import DRIVES
from tests.canbus.storm import storm

FRAMES = st.builds(
    can.Message,
    arbitration_id=st.one_of(st.integers(0, 0x7FF), st.sampled_from([0, 1, 3, 0x61, 0x69, 0x201])),
    is_extended_id=st.just(False),
    is_remote_frame=st.booleans(),
    data=st.binary(max_size=8),
)


@given(frame=FRAMES)
def test_frames_survive_an_slcan_line(frame: can.Message) -> None:
    back = parse_line(line_of(frame).rstrip(b"\r"))
    assert back is not None
    assert back.arbitration_id == frame.arbitration_id
    assert back.is_remote_frame == frame.is_remote_frame
    if not frame.is_remote_frame:
        assert bytes(back.data) == bytes(frame.data)


@given(line=st.binary(max_size=40))
def test_any_line_is_a_frame_or_none(line: bytes) -> None:
    parse_line(line)
    parse_send(line.split())


def test_a_wire_keeps_the_order_and_loses_its_share() -> None:
    lossy = EmulatorSettings(latency=1e-3, jitter=1e-3, loss=0.25, load=0.5)
    wire = Wire(lossy, seed=1)
    for k in range(4000):
        wire.put(k * 1e-4, can.Message(arbitration_id=k % 0x800, is_extended_id=False))
    found = wire.take(10.0)
    assert [due.order for due in found] == sorted(due.order for due in found)
    assert all(a.t <= b.t for a, b in pairwise(found))
    assert len(found) == pytest.approx(3000, abs=150)
    assert found[0].t > 1e-3


@pytest.mark.parametrize("frames", [5_000, pytest.param(200_000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("protocol", DRIVES)
def test_a_storm_of_random_frames_ends_in_a_fault_or_in_nothing(protocol: str, frames: int) -> None:
    found = storm(protocol, frames, seed=0)
    assert found.frames >= frames
    assert found.misses == 0
