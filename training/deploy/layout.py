"""What makes an observation out of measurements; see `TorqueTrackingEnv`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cjt_gym.envs.observe import CLIP, SIGNALS_PER_SAMPLE
from cjt_gym.envs.settings import Settings
from cjt_gym.errors import ConfigurationError
from cjt_gym.joint.border import checked_array
from cjt_gym.joint.compiled import inlined

Floats = NDArray[np.float32]
LIMIT: Final = CLIP
PER_SAMPLE: Final = SIGNALS_PER_SAMPLE


@dataclass(frozen=True)
class Layout:
    """The observation of a policy and the unit of its action.

    Attributes:
        preview: Future samples of the reference.
        history: Past samples of every measured signal.
        torque: Torque that observations are divided by [N m].
        velocity: Velocity that they are divided by [rad/s].
        action: Motor torque of an action of 1 [N m].
        n: Gear ratio; the rotor's angle is n q_m.
        dt: Control step [s].
        joint_numbers: What of the joint's datasheet ends an observation.
    """

    preview: int
    history: int
    torque: float
    velocity: float
    action: float
    n: float
    dt: float
    joint_numbers: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for name, least in (("preview", 0), ("history", 1)):
            number = getattr(self, name)
            if isinstance(number, bool) or not isinstance(number, int) or number < least:
                raise ConfigurationError(
                    f"{name} of a policy must be a whole number >= {least}, got {number!r}."
                )
        for name in ("torque", "velocity", "action", "n", "dt"):
            _check_positive(name, getattr(self, name))
        numbers = self.joint_numbers
        if len(numbers) > 0:
            what = "joint_numbers of a policy"
            numbers = tuple(checked_array(what, numbers, (None,)).tolist())
        object.__setattr__(self, "joint_numbers", tuple(numbers))

    @property
    def size(self) -> int:
        """Numbers of an observation without those of the datasheet, which stay what they are."""
        return self.preview + 4 + PER_SAMPLE * self.history

    @property
    def head(self) -> int:
        """Numbers of an observation before its history."""
        return self.preview + 4


def _check_positive(name: str, number: Any) -> None:
    real = isinstance(number, (int, float)) and not isinstance(number, bool)
    if not (real and math.isfinite(number) and number > 0.0):
        raise ConfigurationError(f"{name} of a policy must be a number > 0, got {number!r}.")


def layout_of(settings: Settings) -> Layout:
    """Return the layout of a task."""
    return Layout(
        preview=settings.preview,
        history=settings.history,
        torque=settings.torque_amplitude,
        velocity=settings.velocity_scale,
        action=settings.action_scale,
        n=float(settings.joint.parameters.n),
        dt=settings.dt,
        joint_numbers=settings.joint_numbers,
    )


@inlined
def _limited(x: float) -> float:
    return LIMIT if x > LIMIT else -LIMIT if x < -LIMIT else x


@inlined
def observe(
    scales: NDArray[np.float64],
    reference: NDArray[np.float64],
    tau: float,
    q_m: float,
    dq_m: float,
    dq_l: float,
    command: float,
    begun: bool,
    observation: Floats,
) -> None:
    """Make the observation of a control step out of that of the step before.

    Args:
        scales: Torque, velocity and n of a layout, shape (3,).
        reference: Wanted joint torque now and at the next steps, shape (preview + 1,) [N m].
        tau: Measured joint torque [N m].
        q_m: Measured motor angle, rotor angle / n [rad].
        dq_m: Measured motor velocity [rad/s].
        dq_l: Measured load velocity [rad/s].
        command: Motor torque that was commanded in the step before [N m].
        begun: Whether there was a step before; the first sample stands for all of the past.
        observation: What is overwritten, shape (size,).
    """
    torque, velocity, rotor = scales[0], scales[1], scales[2] * q_m
    count, size = reference.shape[0], observation.shape[0]
    for k in range(count):
        observation[k] = _limited(reference[k] / torque)
    observation[count] = _limited((reference[0] - tau) / torque)
    observation[count + 1], observation[count + 2] = math.sin(rotor), math.cos(rotor)
    past = observation[count + 3 : size]
    if begun:
        for k in range(past.shape[0] - 1, PER_SAMPLE - 1, -1):
            past[k] = past[k - PER_SAMPLE]
    past[0], past[1] = _limited(tau / torque), _limited(dq_m / velocity)
    past[2], past[3] = _limited(dq_l / velocity), _limited(command / torque)
    if not begun:
        for k in range(PER_SAMPLE, past.shape[0]):
            past[k] = past[k - PER_SAMPLE]
