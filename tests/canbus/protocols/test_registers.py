"""Every field of every register, over the whole of its range."""

import math
import random
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cjt_gym.canbus.protocols import PROTOCOLS
from cjt_gym.canbus.protocols.layout import Field, Layout, nothing
from cjt_gym.errors import ProtocolError
from tests.canbus.protocols.line import DRIVES, started


def fields() -> Iterator[tuple[str, Field]]:
    for name, row in PROTOCOLS.items():
        for register in row.registers():
            for field in register.fields:
                if field.name:
                    yield f"{name} {register.name} {field.name}", field


FIELDS = dict(fields())


@given(data=st.data())
def test_values_come_back_within_half_a_step(data: st.DataObject) -> None:
    field = FIELDS[data.draw(st.sampled_from(sorted(FIELDS)))]
    if field.kind == "float":
        value = data.draw(st.floats(width=32, allow_nan=False, allow_infinity=False))
        assert field.from_bits(field.to_bits(value)) == value
        return
    low, high = field.range
    value = data.draw(st.floats(low, high))
    assert field.from_bits(field.to_bits(value)) == pytest.approx(
        value, abs=0.5 * abs(field.scale) * (1 + 1e-6) + 1e-12 * abs(high)
    )


@pytest.mark.parametrize("name", FIELDS)
def test_both_ends_and_beyond(name: str) -> None:
    field = FIELDS[name]
    if field.kind == "float":
        with pytest.raises(ProtocolError, match="must fit a float"):
            field.to_bits(1e300)
        return
    for end, raw in zip(field.range, field.raw_range, strict=True):
        assert field.to_bits(end) == raw & (1 << field.bits) - 1
        beyond = end + math.copysign(0.51 * field.scale, raw - sum(field.raw_range) / 2)
        with pytest.raises(ProtocolError, match="must lie in"):
            field.to_bits(beyond)


@given(bits=st.integers(0, 2**64 - 1), order=st.sampled_from(["little", "big"]))
def test_a_layout_is_one_to_one(bits: int, order: str) -> None:
    layout = Layout(
        (
            Field("a", 12),
            Field("b", 16, "int"),
            nothing(4),
            Field("c", 20, scale=0.5),
            Field("d", 12, "int", -2.0, 3.0),
        ),
        "little" if order == "little" else "big",
    )
    values = layout.decode(bits.to_bytes(8, "little"))
    assert layout.decode(layout.encode(values)) == values


@pytest.mark.parametrize("name", sorted(DRIVES))
@pytest.mark.parametrize("frames", [3000, pytest.param(200_000, marks=pytest.mark.slow)])
def test_true_frames_with_wrong_bits_are_values_or_one_clear_error(name: str, frames: int) -> None:
    line = started(name)
    line.pass_time(0.2, lambda: [*line.master.command(0.1), *line.master.poll()])
    rng = random.Random(5)
    known = line.sent + line.heard
    for _ in range(frames):
        frame = rng.choice(known)
        data = bytearray(frame.data)
        for _ in range(rng.randrange(1, 4) if data else 0):
            data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        wrong = frame.__copy__()
        wrong.data = data if rng.random() < 0.8 else data[: rng.randrange(len(data) + 1)]
        wrong.dlc = len(wrong.data)
        line.survive(wrong)
