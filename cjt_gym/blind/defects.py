"""Defects of real logs and datasheets, which a diagnosis must tolerate."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np

from cjt_gym.blind.joints import Datasheet
from cjt_gym.blind.plant import CHANNELS, Floats, Structure, World
from cjt_gym.errors import check_name

ROUGH: Final = ("noise", "jitter", "gaps", "missing", "guess", "command_only")
"""Wrongly stated noise, sampling jitter, gaps, a channel that was not recorded, guessed inertias,
and records with only the command and the motor angle."""
DEFECTS: Final = (*ROUGH, "bare")
"""The same, and a datasheet that states neither sensors nor tolerances nor a damping of the bar."""
NOISE: Final = (0.5, 3.0)
"""Stated noise over the true one."""
NOISIER: Final = 1.2
"""Ratio of true to stated noise above which it is correct to call a channel noisy."""
JITTER: Final = (0.02, 0.14)
"""Standard deviation of the sampling instants, as a share of the time between samples."""
GAPS: Final = (1, 5)
"""Number of gaps in a record: lower bound, and upper bound (exclusive)."""
LOST: Final = (0.02, 0.2)
"""Length of a gap [s]."""
MISSING: Final = ("i", "tau", "q_l")
"""Channels one of which may be missing."""
KEPT: Final = ("q_m",)
"""Channels recorded beside the command by `command_only`."""
GUESS: Final = (1.0 / 3.0, 3.0)
"""Guessed inertia over the true one."""

Columns = dict[str, Floats]


@dataclass(frozen=True)
class Defects:
    """The defects of a case."""

    kinds: tuple[str, ...] = ()  # names of its defects, of DEFECTS
    # stated noise over the true one, by channel
    noise: Mapping[str, float] = field(default_factory=dict)
    # standard deviation of the sampling instants [s]; None for the joint's own
    jitter: float | None = None
    # whether the record's time holds the true instants; otherwise it is evenly spaced
    stamped: bool = False
    empty: bool = False  # whether gaps are filled with NaN; otherwise their rows are missing
    missing: tuple[str, ...] = ()  # channels that were not recorded
    # guessed inertia over the stated one, by symbol
    guesses: Mapping[str, float] = field(default_factory=dict)

    def applied(self, world: World) -> World:
        """Return the joint as recorded."""
        return world if self.jitter is None else replace(world, jitter=self.jitter)

    def stated(self, sheet: Datasheet) -> Datasheet:
        """Return the datasheet supplied with the records."""
        return replace(
            sheet,
            noise=tuple(
                std * self.noise.get(name, 1.0)
                for name, std in zip(CHANNELS, sheet.noise, strict=True)
            ),
            channels=tuple(name for name in sheet.channels if name not in self.missing),
            values=sheet.values | {s: sheet.values[s] * f for s, f in self.guesses.items()},
            guesses=tuple(self.guesses),
            bare="bare" in self.kinds,
        )

    def lost(self, columns: Columns, dt: float, rng: np.random.Generator) -> Columns:
        """Return a record with its gaps."""
        if "gaps" not in self.kinds:
            return columns
        samples = len(columns["t"])
        gone = np.zeros(samples, dtype=bool)
        for _ in range(int(rng.integers(*GAPS))):
            length = max(round(rng.uniform(*LOST) / dt), 1)
            start = int(rng.integers(samples // 20, samples - samples // 20 - length))
            gone[start : start + length] = True
        if not self.empty:
            return {name: values[~gone] for name, values in columns.items()}
        known = ("t", "i_cmd")
        return {
            name: values if name in known else np.where(gone, np.nan, values)
            for name, values in columns.items()
        }

    def to_dict(self) -> dict[str, Any]:
        """Return the defects as plain values, by kind."""
        told = {
            "noise": {"stated_over_true": dict(self.noise)},
            "jitter": {"std": self.jitter, "stamped": self.stamped},
            "gaps": {"empty": self.empty},
            "missing": {"channels": list(self.missing)},
            "guess": {"guessed_over_stated": dict(self.guesses)},
            "command_only": {"channels": list(self.missing)},
            "bare": {},
        }
        return {kind: told[kind] for kind in self.kinds}


def check_defects(kinds: Iterable[str]) -> tuple[str, ...]:
    """Return the names of defects in the order of DEFECTS."""
    asked = set(kinds)
    for name in asked:
        check_name("defect", name, DEFECTS)
    return tuple(name for name in DEFECTS if name in asked)


def draw_defects(
    kinds: tuple[str, ...], structure: Structure, sheet: Datasheet, rng: np.random.Generator
) -> Defects:
    """Return random defects of given kinds."""
    noise, guesses = _factors(sheet.channels, NOISE, rng), _guesses(structure, rng)
    jitter, stamped = sheet.dt * rng.uniform(*JITTER), bool(rng.random() < 0.5)
    empty, absent = bool(rng.random() < 0.5), str(rng.choice(MISSING))
    missing: tuple[str, ...] = (absent,) if "missing" in kinds else ()
    if "command_only" in kinds:
        missing = tuple(name for name in CHANNELS if name not in KEPT)
    return Defects(
        kinds,
        noise if "noise" in kinds else {},
        jitter if "jitter" in kinds else None,
        stamped if "jitter" in kinds else False,
        empty,
        missing,
        guesses if "guess" in kinds else {},
    )


def _factors(
    names: Iterable[str], bounds: tuple[float, float], rng: np.random.Generator
) -> dict[str, float]:
    low, high = np.log(bounds)
    return {name: float(np.exp(rng.uniform(low, high))) for name in names}


def _guesses(structure: Structure, rng: np.random.Generator) -> dict[str, float]:
    """Return factors on the inertias of motor and gear, of a free load, or of both."""
    factors = _factors(("drive", "load"), GUESS, rng)
    which = "drive" if structure.is_locked else str(rng.choice(["drive", "load", "both"]))
    drive = {} if which == "load" else dict.fromkeys(("I_m", "I_g"), factors["drive"])
    load = {} if which == "drive" else {"I_l": factors["load"]}
    return drive | load


def not_counted(
    structure: Structure, sheet: Datasheet, world: World, hidden: Collection[str]
) -> list[str]:
    """Return the names that count neither as wrong nor as missing.

    A guessed inertia is expected to differ, and a channel noisier than stated may be called noisy
    ("noise:q_m") even if no such effect is hidden.
    """
    names = {"load_inertia" if symbol == "I_l" else "inertia" for symbol in sheet.guesses}
    if structure.name == "rigid" and names:
        names = {"inertia", "load_inertia"}
    noisy = {
        f"noise:{name}"
        for name, std, stated in zip(CHANNELS, world.noise, sheet.noise, strict=True)
        if name in sheet.channels and std > NOISIER * stated
    }
    return sorted(names | (noisy - set(hidden)))
