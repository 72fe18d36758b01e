"""What every controller is: measurements and references in, motor torques out."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, final

import numpy as np
from numpy.typing import NDArray

from cjt_gym.errors import ConfigurationError, check_range
from cjt_gym.plant import Measurement

if TYPE_CHECKING:
    from cjt_gym.baselines.linear_law import LinearLaw

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]


class Controller(ABC):
    """A discrete-time torque controller of a batch of joints.

    One instance serves a batch of any size: its memory takes the shape of the first measurement
    after a full `reset`. After a reset the first command is the one that the law gives at rest
    at the present measurement, so that nothing jumps for want of a past.

    A law implements `_command`; limits and bookkeeping are here, for all laws.

    Attributes:
        dt: Sample time for which the law is discretised [s].
        torque_limit: Largest motor torque that it commands [N m].
        linear: The law where no limit acts, friction models apart; None where it has none.
        command_gain: Motor torque to command for a motor torque of 1 N m: not 1 where a motor is
            known to make more or less torque than it is commanded [-].
    """

    dt: float
    torque_limit: float
    linear: LinearLaw | None = None
    command_gain: float = 1.0
    _fresh: Mask | None = None

    @final
    def reset(self, mask: Mask | None = None) -> None:
        """Forget the past of the joints in the mask, or of all, and then also their number.

        Args:
            mask: Which joints, shape (n,).

        Raises:
            ConfigurationError: The mask does not fit the batch.
        """
        if mask is None:
            self._fresh = None
            return
        if self._fresh is not None:
            self._check_size("mask", mask.shape)
            self._fresh |= mask

    @final
    def act(self, measurement: Measurement, reference: Floats) -> Floats:
        """Return the motor torque to command until the next sample.

        Args:
            measurement: What the joints report now, each channel of shape (n,).
            reference: Joint torque that is wanted now [N m], shape (n,).

        Returns:
            Motor torque to command, on the link side, within +- torque_limit times command_gain
            [N m], shape (n,).

        Raises:
            ConfigurationError: The number of joints changed without a full reset.
        """
        wanted = np.asarray(reference, dtype=np.float64)
        if self._fresh is None:
            self._fresh = np.ones(wanted.shape, dtype=np.bool_)
        self._check_size("reference", wanted.shape)
        self._check_size("measurement", measurement.tau.shape)
        command = self._command(measurement, wanted, self._fresh)
        self._fresh[:] = False
        limit = self.torque_limit  # np.clip takes several times as long
        return self.command_gain * np.minimum(np.maximum(command, -limit), limit)

    @abstractmethod
    def _command(self, measurement: Measurement, reference: Floats, fresh: Mask) -> Floats:
        """Return the unlimited motor torque [N m], shape (n,).

        Args:
            measurement: What the joints report.
            reference: Wanted joint torque [N m], shape (n,).
            fresh: Joints without a past, shape (n,): their memory starts at this measurement.
        """

    def _check_size(self, what: str, shape: tuple[int, ...]) -> None:
        assert self._fresh is not None
        if shape != self._fresh.shape:
            raise ConfigurationError(
                f"The {what} given to {type(self).__name__} must have the shape "
                f"{self._fresh.shape} it began with, got {shape}. Call reset() before another "
                "number of joints."
            )


def check_sampling(controller: Controller) -> None:
    """Raise ConfigurationError unless sample time and torque limit of a controller are > 0."""
    check(controller, "dt", "s", above=0.0)
    check(controller, "torque_limit", "N m", above=0.0, finite=False)


def check(
    owner: Controller,
    name: str,
    unit: str,
    *,
    above: float = -math.inf,
    low: float = -math.inf,
    finite: bool = True,
) -> None:
    """Check the range of one number of a controller.

    Args:
        owner: The controller.
        name: Name of the number.
        unit: Its unit, "" where it has none.
        above: It must be greater than this.
        low: It must not be less than this.
        finite: Whether infinity is refused.

    Raises:
        ConfigurationError: It is out of range.
    """
    what = f"{name} of {type(owner).__name__}"
    check_range(what, float(getattr(owner, name)), unit, low=low, above=above, finite=finite)
