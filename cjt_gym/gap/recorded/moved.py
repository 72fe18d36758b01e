"""Values of the datasheet that a joint has otherwise, beside the effects that are named."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from typing import TypeGuard

from cjt_gym.gap.recorded.tolerances import SMOOTHING, assumed_tolerance, listed_values
from cjt_gym.joint import JointFile
from cjt_gym.joint.files.quantity import Quantity
from cjt_gym.joint.structures import get_structure

NOTABLE = 0.05
"""Relative change from which a value is told beside the effects that are named."""
STRAINED, FEWEST = 1.5, 2
"""Root mean square of the changes in units of the tolerances, and fewest values, from which these
contradict the record. Two normal deviations exceed it in a tenth of all joints, more in fewer."""


def moved_symbols(file: JointFile, found: JointFile, named: Collection[str]) -> tuple[str, ...]:
    """Return the symbols of values that differ notably from the datasheet and are not named.

    Inertias of bodies that move as one count together.

    Args:
        file: The datasheet.
        found: The joint that was found.
        named: Symbols whose values a diagnosis tells.
    """
    told = []
    for symbols, old, new in _totals(file, found):
        tolerance = max((q.tolerance or 0.0 for q in old if not q.guess), default=0.0)
        before, after = sum(q.number for q in old), sum(new)
        off = abs(after - before) > max(NOTABLE, tolerance) * abs(before)
        if off and not set(symbols) & set(named):
            told.append(symbols[0])
    return tuple(dict.fromkeys(told))


def strain(file: JointFile, found: JointFile, named: Collection[str]) -> float:
    """Return by how much a joint's values leave their tolerances, all in all; 1 if they do not.

    Args:
        file: The datasheet.
        found: The joint that was found.
        named: Symbols whose values a diagnosis tells: they need not keep theirs.
    """
    off = []
    for symbol, old in file.parameters.quantities.items():
        new = found.parameters.quantities.get(symbol)
        if new is None or old.guess or symbol in named or min(old.number, new.number) <= 0.0:
            continue
        if new.number != old.number:
            off.append(
                math.log(new.number / old.number) / (old.tolerance or assumed_tolerance(symbol))
            )
    size = math.sqrt(sum(x**2 for x in off) / max(len(off), 1))
    return size if len(off) >= FEWEST and size > STRAINED else 1.0


def _is_one(entry: object) -> TypeGuard[Quantity]:
    """Return whether an entry is one number, not a series or a word."""
    return isinstance(entry, Quantity) and not isinstance(entry.value, tuple)


def _totals(
    file: JointFile, found: JointFile
) -> Iterator[tuple[tuple[str, ...], list[Quantity], list[float]]]:
    """Yield symbols with what the datasheet says of them and what the joint has."""
    listed = {SMOOTHING, *listed_values(file)}
    known = {s: q for s, q in file.parameters.quantities.items() if s not in listed}
    groups: dict[object, list[str]] = {}
    bodies = get_structure(found.structure).groups if found.structure else (0, 1, 2)
    for symbol in known:
        body = symbol[2:] if symbol.startswith("I_") else ""
        key = bodies["mgl".index(body)] if body in ("m", "g", "l") and body else symbol
        groups.setdefault(key, []).append(symbol)
    for symbols in groups.values():
        yield (
            tuple(symbols),
            [known[s] for s in symbols],
            [_value(found, s, known[s]) for s in symbols],
        )
    for name, row in file.effects.items():
        for symbol, old in row.items():
            new = found.effects.get(name, {}).get(symbol)
            if symbol != SMOOTHING and _is_one(old) and _is_one(new) and old.number:
                yield (symbol,), [old], [new.number]


def _value(found: JointFile, symbol: str, old: Quantity) -> float:
    """Return a value of a joint, from the row of an effect that replaces it if there is one."""
    for row in found.effects.values():
        if _is_one(entry := row.get(symbol)):
            return entry.number
    return found.parameters.quantities.get(symbol, old).number
