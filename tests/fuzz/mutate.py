"""Inputs that are almost right: seeds with parts changed, cut, repeated or exchanged."""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Sequence

NUMBERS = (0, 1, 2, 7, 8, 0x7F, 0x80, 0xFF, 0x7FFF, 0x8000, 0xFFFF, 2**31 - 1, 2**31, 2**32 - 1)
LARGE = (2**53, 2**62, 2**63 - 1, 2**63, 2**64 - 1)
WORDS = (
    *("nan", "-inf", "1e400", "1e-400", "-0", "0", "-1", "1" * 30, "9" * 400, "0x1", "1_0", "''"),
    *('""', "{}", "[]", "[[1], 2]", "{ a = 1 }", "true", "null", "None", '"\\u0000"', "\0", "\xb5"),
    *("1979-05-27", "07:32:00", "q_m", "rad", "N m", "../x", "a.b.c", "=", ",", ";", "\t", "\n"),
    *("#", "[x]", "[[x]]", '"', "'''", "\\", "\ufeff", "\U0001f600", "\ud7ff", "%s", "{0}", "$a$"),
)
WORD = re.compile(rb"[\w.+-]+")
Mutation = Callable[[random.Random, bytes], bytes]


def _flip(rng: random.Random, data: bytes) -> bytes:
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 4, 16))):
        out[rng.randrange(len(out))] ^= 1 << rng.randrange(8)
    return bytes(out)


def _cut(rng: random.Random, data: bytes) -> bytes:
    return data[: rng.randrange(len(data))]


def _remove(rng: random.Random, data: bytes) -> bytes:
    at = rng.randrange(len(data))
    return data[:at] + data[at + rng.choice((1, 2, 4, 8, 30)) :]


def _repeat(rng: random.Random, data: bytes) -> bytes:
    at = rng.randrange(len(data))
    end = at + rng.choice((1, 4, 8, 40))
    return data[:end] + data[at:end] * rng.choice((1, 2, 50)) + data[end:]


def _number(rng: random.Random, data: bytes) -> bytes:
    size = rng.choice((1, 2, 4, 4, 8))
    value = rng.choice(NUMBERS if size < 8 else (*NUMBERS, *LARGE)) % (1 << (8 * size))
    at = rng.randrange(len(data))
    at -= at % size if rng.random() < 0.7 else 0
    return data[:at] + value.to_bytes(size, rng.choice(("little", "big"))) + data[at + size :]


def _word(rng: random.Random, data: bytes) -> bytes:
    found = [match.span() for match in WORD.finditer(data[:20_000])]
    if not found:
        return _number(rng, data)
    begin, end = rng.choice(found)
    if rng.random() < 0.3:
        other, stop = rng.choice(found)
        return data[:begin] + data[other:stop] + data[end:]
    return data[:begin] + rng.choice(WORDS).encode("utf-8") + data[end:]


def _insert(rng: random.Random, data: bytes) -> bytes:
    at = rng.randrange(len(data) + 1)
    return data[:at] + rng.choice(WORDS).encode("latin-1", "ignore") + data[at:]


def _lines(rng: random.Random, data: bytes) -> bytes:
    lines = data.split(b"\n")
    one, other = rng.randrange(len(lines)), rng.randrange(len(lines))
    if rng.random() < 0.5:
        lines[one], lines[other] = lines[other], lines[one]
    else:
        del lines[one]
    return b"\n".join(lines)


BINARY: tuple[Mutation, ...] = (_flip, _flip, _number, _number, _cut, _remove, _repeat)
TEXT: tuple[Mutation, ...] = (_word, _word, _word, _insert, _lines, _flip, _cut, _repeat, _remove)


def is_text(data: bytes) -> bool:
    """Whether data look like text."""
    return b"\0" not in data[:200] and sum(c > 126 for c in data[:200]) < 20


def mutated(rng: random.Random, parts: Sequence[bytes]) -> tuple[bytes, ...]:
    """Return parts of a file of which one or two differ."""
    out = list(parts)
    for _ in range(rng.choice((1, 1, 2, 3))):
        k = rng.randrange(len(out))
        if out[k]:
            kinds = TEXT if is_text(out[k]) and rng.random() < 0.9 else BINARY
            out[k] = rng.choice(kinds)(rng, out[k])
    return tuple(out)
