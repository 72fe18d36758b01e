"""A run of the second simulator that a program controls sample by sample."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from cjt_gym.blind.plant import CHANNELS, Floats, World, packed
from cjt_gym.blind.run import FINE_STEP, PAST, draw_chances, frame_of, look, move
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
        self._joint = (packed(world.plant), packed(world.drive), packed(world.sensing))
        self._frame, self._resolution = frame_of(world), np.array(world.resolution)
        self._chances = draw_chances(world, samples, np.random.default_rng(seed))
        self._fine_step = fine_step
        self._x = initial_state(world)
        self._kept = np.zeros((2, PAST)), np.zeros(2, dtype=np.int64), np.zeros(1)
        self._command: Floats = np.zeros(samples)
        self._k = 0
        self.sample = self._look()
        """The latest sample; at first that at rest."""

    def step(self, current: float) -> Sample:
        """Command a current [A], and return the next sample."""
        if self._k + 1 == len(self._command):
            raise ConfigurationError(f"The run ends after {self._k + 1} samples. Begin another.")
        self._command[self._k] = current
        past, counts, _ = self._kept
        move(
            self._joint,
            self._frame,
            self._chances,
            self._command,
            self._k,
            self._fine_step,
            self._x,
            (past, counts),
        )
        self._k += 1
        self.sample = self._look()
        return self.sample

    def _look(self) -> Sample:
        clean, measured = np.zeros(len(CHANNELS)), np.zeros(len(CHANNELS))
        where = (self._joint, self._frame, self._chances, self._resolution, self._k, self._x)
        tau = look(*where, self._kept, clean, measured)
        return Sample(dict(zip(CHANNELS, measured.tolist(), strict=True)), float(tau))
