"""Linear control laws as one state space, built from blocks, and the controller that runs one."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol, final

import numpy as np
from scipy.linalg import block_diag

from cjt_gym.baselines.controller import Controller, Floats, Mask, check_sampling
from cjt_gym.errors import ConfigurationError, check_name
from cjt_gym.joint.kernel.arrays import Complex
from cjt_gym.joint.linear import frequency_response
from cjt_gym.plant import Measurement
from cjt_gym.records import COLUMNS

MEASURED = ("tau", "q_m", "q_g", "q_l", "dq_m", "dq_g", "dq_l")
SIGNALS = ("reference", *MEASURED, "command")
INPUTS = {
    "reference": ("N m", "wanted joint torque; in an array, now and at the next control steps")
} | {name: (COLUMNS[name].units[0], COLUMNS[name].description) for name in MEASURED}
"""Unit and meaning of what a controller takes."""
SLOWEST, FASTEST = 1e-5, 0.5
"""Shares of the command's excess over a limit that integrals give back per sample."""

REFERENCE, TAU, COMMAND = 0, 1, len(SIGNALS) - 1


def signals(**weights: float) -> Floats:
    """Return the row that weighs `SIGNALS`, shape (9,).

    Example:
        >>> signals(reference=1.0, tau=-1.0)[:3].tolist()
        [1.0, -1.0, 0.0]
    """
    row = np.zeros(len(SIGNALS))
    for name, weight in weights.items():
        check_name("signal of a law", name, SIGNALS)
        row[SIGNALS.index(name)] = weight
    return row


@dataclass(frozen=True)
class Block:
    """A part of a law: x[k+1] = a x + b w + g (u - v), output c x + d w.

    With w the signals, u the command that was applied and v the sum of all blocks, which u is
    unless a limit acts. So g holds the state where the limit holds the command (back-calculation).

    References:
        Astrom, Rundqwist (1989), Integrator windup and how to avoid it, American Control
        Conference.
    """

    a: Floats  # shape (order, order)
    b: Floats  # shape (order, 9)
    c: Floats  # shape (order,)
    d: Floats  # shape (9,); nothing of it may hang on the present command
    g: Floats  # shape (order,)


def static(**weights: float) -> Block:
    """Return the block whose output is the weighted signals."""
    n = len(SIGNALS)
    return Block(np.zeros((0, 0)), np.zeros((0, n)), np.zeros(0), signals(**weights), np.zeros(0))


def through(
    system: tuple[Floats, Floats, Floats, float], gain: float = 1.0, **weights: float
) -> Block:
    """Return a discrete filter (a, b, c, d) of the weighted signals, times a gain."""
    a, b, c, d = system
    row = signals(**weights)
    return Block(a, np.outer(b, row), gain * c, gain * d * row, np.zeros(len(b)))


def integrator(rate: float, dt: float, direct: float, **weights: float) -> Block:
    """Return the integral of the weighted signals, forward Euler.

    While a limit holds the command, the law continues as if the reference had asked for just that
    command (conditioning).

    `rate` is the gain of the integral [1/s], 0 for none; `direct` says how much of a lasting
    reference the law feeds to the command at once, >= 0.

    References:
        Hanus, Kinnaert, Henrotte (1987), Conditioning technique, a general anti-windup and
        bumpless transfer method, Automatica 23(6).
    """
    if rate == 0.0:
        return static()
    row = dt * rate * signals(**weights)
    back = min(max(float(row[REFERENCE]) / max(direct, 1e-6), SLOWEST), FASTEST)
    return Block(np.eye(1), row[None, :], np.ones(1), np.zeros(len(SIGNALS)), np.array([back]))


def total(blocks: Sequence[Block]) -> Block:
    """Return the sum of blocks as one."""
    return Block(
        np.asarray(block_diag(*[block.a for block in blocks])).reshape(
            (sum(len(block.c) for block in blocks),) * 2
        ),
        np.concatenate([block.b for block in blocks]),
        np.concatenate([block.c for block in blocks]),
        np.sum([block.d for block in blocks], axis=0),
        np.concatenate([block.g for block in blocks]),
    )


def cascade(first: Block, second: Block) -> Block:
    """Return the second block with the output of the first as its reference."""
    b, d = second.b.copy(), second.d.copy()
    b[:, REFERENCE], d[REFERENCE] = 0.0, 0.0
    into, gain = second.b[:, REFERENCE], second.d[REFERENCE]
    m, n = len(first.c), len(second.c)
    a = np.zeros((m + n, m + n))
    a[:m, :m], a[m:, m:], a[m:, :m] = first.a, second.a, np.outer(into, first.c)
    return Block(
        a,
        np.concatenate([first.b, b + np.outer(into, first.d)]),
        np.concatenate([gain * first.c, second.c]),
        d + gain * first.d,
        np.concatenate([first.g, second.g]),
    )


@dataclass(frozen=True)
class LinearLaw:
    """A law x[k+1] = a x + b w, v = c x + d w, u = v within the limit.

    Its signals w are `SIGNALS`; the last one is the command u itself, which the law may remember
    (observers need it, and so does what keeps integrals from winding up) but not use at once.
    So a holds what happens while a limit holds the command: no eigenvalue is outside the unit
    circle, and nothing winds up. Unlimited, the law is (a + b_u c, b + b_u d, c, d).

    Attributes:
        a: Shape (order, order).
        b: Shape (order, 9).
        c: Shape (order,).
        d: Shape (9,).
        dt: Sample time [s].
        g: Shape (order,), see `Block`; a and b hold it, and only additions need it by itself.
    """

    a: Floats
    b: Floats
    c: Floats
    d: Floats
    dt: float
    g: Floats = field(default_factory=lambda: np.zeros(0))

    def unlimited(self) -> tuple[Floats, Floats]:
        """Return system and input matrix from reference and measurement where no limit acts."""
        own = self.b[:, COMMAND]
        return self.a + np.outer(own, self.c), self.b[:, :COMMAND] + np.outer(own, self.d[:COMMAND])

    def response(self, f: Floats) -> Complex:
        """Return the unlimited response from reference and measured signals to the command.

        Shape (points, 8) at frequencies f [Hz], in the order of `SIGNALS`.
        """
        a, b = self.unlimited()
        z = np.exp(2j * math.pi * f * self.dt)
        return frequency_response(a, b, self.c[None], self.d[None, :COMMAND], z)[:, 0]

    def at_rest(self) -> Floats:
        """Return the map from signals that stand still to the state, shape (order, 9)."""
        return np.asarray(np.linalg.solve(np.eye(len(self.c)) - self.a, self.b), np.float64)


def assemble(dt: float, *blocks: Block) -> LinearLaw:
    """Return the law whose command is the sum of blocks."""
    whole = total(blocks)
    b = whole.b - np.outer(whole.g, whole.d)
    b[:, COMMAND] += whole.g
    if whole.d[COMMAND] != 0.0:
        raise ConfigurationError("A law cannot use its own present command.")
    return LinearLaw(whole.a - np.outer(whole.g, whole.c), b, whole.c, whole.d, dt, whole.g)


class LawMemory:
    """A linear law in use by a batch of joints: its state, and how it advances.

    After a reset the memory is that of a joint that has been at rest under its present torque for
    ever, with that torque as reference and as command.
    """

    def __init__(self, law: LinearLaw) -> None:
        self.law = law
        self._rest = law.at_rest()
        self._x = np.zeros((len(law.c), 0))
        self._w = np.zeros((len(SIGNALS), 0))

    def propose(self, measurement: Measurement, reference: Floats, fresh: Mask) -> Floats:
        """Return the command that the law asks for [N m], shape (n,)."""
        self._w = stack(measurement, reference)
        self._x = begin(self._rest, self._x, self._w, fresh)
        return np.asarray(self.law.c @ self._x + self.law.d @ self._w)

    def commit(self, command: Floats, added: Floats | None = None) -> None:
        """Go on to the next sample with the command that was applied [N m], shape (n,).

        `added` is what was added to what the law proposed [N m], shape (n,), for which no limit has
        to answer.
        """
        self._w[COMMAND] = command
        self._x = self.law.a @ self._x + self.law.b @ self._w
        if added is not None:
            self._x -= np.outer(self.law.g, added)


class Addition(Protocol):
    """What is added to a linear law and is none: friction, or what is learnt."""

    def step(
        self, measurement: Measurement, reference: Floats, applied: Floats, fresh: Mask
    ) -> Floats:
        """Return what is added to the command [N m], shape (n,).

        `applied` is the motor torque since the sample before; of a fresh joint its joint torque.
        """
        ...


@final
@dataclass(eq=False, repr=False)
class LinearController(Controller):
    """Runs a linear law over a batch of joints, with or without an addition; see `LawMemory`."""

    law: LinearLaw
    torque_limit: float = math.inf  # largest motor torque that is commanded [N m]
    addition: Addition | None = None
    name: str = "linear law"  # that of its row of the table
    gains: Mapping[str, float] = field(default_factory=dict)  # those it was made with
    dt: float = field(init=False)

    def __post_init__(self) -> None:
        self.dt = self.law.dt
        check_sampling(self)
        self.linear = self.law
        self._memory = LawMemory(self.law)
        self._applied = np.zeros(0)

    def __repr__(self) -> str:
        gains = "".join(f", {name} = {value:.4g}" for name, value in self.gains.items())
        return f"<LinearController {self.name}: dt = {self.dt:g} s{gains}>"

    def _command(self, measurement: Measurement, reference: Floats, fresh: Mask) -> Floats:
        command = self._memory.propose(measurement, reference, fresh)
        added = None
        if self.addition is not None:
            applied = self._applied if len(self._applied) == len(fresh) else measurement.tau
            applied = np.where(fresh, measurement.tau, applied)
            added = self.addition.step(measurement, reference, applied, fresh)
            command = command + added
        self._applied = np.clip(command, -self.torque_limit, self.torque_limit)
        self._memory.commit(self._applied, added)
        return command


def stack(measurement: Measurement, reference: Floats) -> Floats:
    """Return `SIGNALS` with no command yet, shape (9, n)."""
    rows = [reference, *(getattr(measurement, name) for name in MEASURED)]
    return np.stack([*rows, np.zeros_like(reference)])


def begin(rest: Floats, x: Floats, w: Floats, fresh: Mask) -> Floats:
    """Return the state with that of fresh joints at `rest` under their present torque."""
    if x.shape[1] != len(fresh):
        x = np.zeros((len(rest), len(fresh)))
    if not fresh.any():
        return x
    still = w.copy()
    still[REFERENCE] = still[COMMAND] = w[TAU]
    return np.where(fresh, rest @ still, x)
