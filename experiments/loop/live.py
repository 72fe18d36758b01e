"""A run of the second simulator that a program controls sample by sample."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from cjt_gym.blind.plant import CHANNELS, Floats, World
from cjt_gym.blind.run import FINE_STEP, bench_of, draw_chances, look, move, nothing_kept
from cjt_gym.blind.state import initial_state
from cjt_gym.errors import ConfigurationError


@dataclass(frozen=True)
class Sample:
    """A sampling instant.

    Attributes:
        measured: Measurement by channel [its unit].
        tau: True torque of the joint, which is not measured [N m].
    """

    measured: dict[str, float]
    tau: float


@final
class Live:
    """A run from rest in which a program decides at every sample.

    The same random numbers and commands give the same run as `cjt_gym.blind.run.run`.

    Example:
        >>> from cjt_gym.blind.bench import make_bench
        >>> live = Live(make_bench(3, "output_fixed").world, samples=50)
        >>> for _ in range(49):
        ...     sample = live.step(1.0)
        >>> sample.tau > 0.0
        True
    """

    def __init__(
        self, world: World, samples: int, seed: int = 0, fine_step: float = FINE_STEP
    ) -> None:
        """Begin."""
        chances = draw_chances(world, samples, np.random.default_rng(seed))
        self._bench, self._kept = bench_of(world, chances, fine_step), nothing_kept()
        self._x = initial_state(world)
        self._command: Floats = np.zeros(samples)
        self._k = 0
        self.sample = self._look()
        """The latest sample; at first that at rest."""

    def step(self, current: float) -> Sample:
        """Command a current [A], and return the next sample."""
        if self._k + 1 == len(self._command):
            raise ConfigurationError(f"The run ends after {self._k + 1} samples. Begin another.")
        self._command[self._k] = current
        move(self._bench, self._command, self._k, self._x, self._kept)
        self._k += 1
        self.sample = self._look()
        return self.sample

    def _look(self) -> Sample:
        clean, measured = np.zeros(len(CHANNELS)), np.zeros(len(CHANNELS))
        tau = look(self._bench, self._k, self._x, self._kept, clean, measured)
        return Sample(dict(zip(CHANNELS, measured.tolist(), strict=True)), float(tau))
