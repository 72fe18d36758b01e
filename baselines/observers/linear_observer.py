"""What every linear observer is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cjt_gym.baselines.controller import Floats, Mask
from cjt_gym.baselines.linear_law import COMMAND, SIGNALS, Block, begin, stack
from cjt_gym.errors import ConfigurationError, check_name
from cjt_gym.plant import Measurement


@dataclass(eq=False)
class LinearObserver:
    """An observer x[k+1] = a x + b w, estimate[k] = c x + d w.

    With w the measured signals at sample k and the command that is applied from k on, as in
    `LinearLaw`. An estimate uses the measurement of its own sample (current observer).

    Attributes:
        a: Shape (order, order).
        b: Shape (order, 9).
        c: Shape (estimates, order).
        d: Shape (estimates, 9).
        names: What is estimated, in the order of the rows.
        dt: Sample time [s].
    """

    a: Floats
    b: Floats
    c: Floats
    d: Floats
    names: tuple[str, ...]
    dt: float

    def __post_init__(self) -> None:
        self._rest = self.at_rest()
        self._x = np.zeros((len(self.a), 0))
        self._w = np.zeros((len(SIGNALS), 0))

    def at_rest(self) -> Floats:
        """Return the map from signals that stand still to the state, shape (order, 9)."""
        return np.asarray(np.linalg.solve(np.eye(len(self.a)) - self.a, self.b), np.float64)

    def poles(self) -> Floats:
        """Return the poles of the estimation error, in the z plane."""
        return np.asarray(np.linalg.eigvals(self.a))

    def terms(self) -> Floats:
        """Return the sum of the magnitudes that make up each estimate, shape (estimates, n)."""
        return np.asarray(np.abs(self.c) @ np.abs(self._x) + np.abs(self.d) @ np.abs(self._w))

    def block(self, **weights: float) -> Block:
        """Return the weighted estimates as a block of a law.

        Raises:
            UnknownNameError: There is no such estimate.
        """
        row = np.zeros(len(self.names))
        for name, weight in weights.items():
            check_name("estimate", name, self.names)
            row[self.names.index(name)] = weight
        return Block(self.a, self.b, row @ self.c, row @ self.d, np.zeros(len(self.a)))

    def step(self, measurement: Measurement, command: Floats, fresh: Mask) -> dict[str, Floats]:
        """Return the estimates at this sample, each of shape (n,).

        Raises:
            ConfigurationError: The command does not fit the measurement.
        """
        if command.shape != measurement.tau.shape:
            raise ConfigurationError(
                f"The command given to an observer must have the shape {measurement.tau.shape} of "
                f"the measurement, got {command.shape}."
            )
        if self._w.shape[1] == len(command):
            self._w[COMMAND] = command
            self._x = self.a @ self._x + self.b @ self._w
        self._w = stack(measurement, np.zeros_like(command))
        self._x = begin(self._rest, self._x, self._w, fresh)
        return dict(zip(self.names, self.c @ self._x + self.d @ self._w, strict=True))
