"""What makes an observation out of measurements; see `TorqueTrackingEnv`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cjt_gym.envs.observe import CLIP, SIGNALS_PER_SAMPLE
from cjt_gym.envs.settings import Settings

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
    """

    preview: int
    history: int
    torque: float
    velocity: float
    action: float
    n: float
    dt: float

    @property
    def size(self) -> int:
        """Numbers of an observation."""
        return self.preview + 4 + PER_SAMPLE * self.history

    @property
    def head(self) -> int:
        """Numbers of an observation before its history."""
        return self.preview + 4


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
    )


class Observer:
    """Makes observations, one control step after the other."""

    def __init__(self, layout: Layout) -> None:
        """Begin an episode."""
        self.layout = layout
        self._observation = np.zeros(layout.size, dtype=np.float32)
        self.reset()

    def reset(self) -> None:
        """Forget the past; the next step is the first."""
        self._begun = False

    def observe(
        self,
        reference: Sequence[float],
        tau: float,
        q_m: float,
        dq_m: float,
        dq_l: float,
        command: float,
    ) -> Floats:
        """Return the observation of a control step, shape (size,); it is overwritten by the next.

        Arguments are those of `cjt_gym.training.deploy.exported.Stepper.step`.
        """
        layout, out = self.layout, self._observation
        head, torque, velocity = layout.head, layout.torque, layout.velocity
        for k, wanted in enumerate(reference):
            out[k] = _limited(wanted / torque)
        out[head - 3] = _limited((reference[0] - tau) / torque)
        rotor = layout.n * q_m
        out[head - 2], out[head - 1] = math.sin(rotor), math.cos(rotor)
        sample = (tau / torque, dq_m / velocity, dq_l / velocity, command / torque)
        if self._begun:
            out[head + PER_SAMPLE :] = out[head:-PER_SAMPLE]  # NumPy minds the overlap
            out[head : head + PER_SAMPLE] = [_limited(x) for x in sample]
        else:
            out[head:] = [_limited(x) for x in sample] * layout.history
            self._begun = True
        return out


def _limited(x: float) -> float:
    return LIMIT if x > LIMIT else -LIMIT if x < -LIMIT else x
