"""A linear control law on the device, in torch."""

from __future__ import annotations

import math

import numpy as np
import torch

from cjt_gym.baselines.linear_law import COMMAND, MEASURED, REFERENCE, TAU, LinearLaw
from cjt_gym.joint.arrays import CHANNELS


class TorchLaw:
    """Does what a linear controller does, for joints whose measurements are a tensor."""

    def __init__(
        self, law: LinearLaw, limit: float, num: int, device: torch.device, *, follows: bool = False
    ) -> None:
        """Prepare for `num` joints, with the largest motor torque that is commanded [N m].

        If it `follows`, its memory begins as if the reference had long stood where it is, as that
        of `PdFeedForward` does; else as if it had been the torque that is there.
        """

        def tensor(values: object) -> torch.Tensor:
            return torch.as_tensor(np.asarray(values), dtype=torch.float64, device=device)

        self.columns = [CHANNELS.index(name) for name in MEASURED]
        self._a, self._b, self._c, self._d = (tensor(x) for x in (law.a, law.b, law.c, law.d))
        self._rest = tensor(law.at_rest())
        self._follows = follows
        self._limit = limit if math.isfinite(limit) else None
        self._x = torch.zeros(len(law.c), num, dtype=torch.float64, device=device)
        self._w = torch.zeros(len(law.d), num, dtype=torch.float64, device=device)

    def act(
        self, measured: torch.Tensor, reference: torch.Tensor, fresh: torch.Tensor
    ) -> torch.Tensor:
        """Return the motor torque to command until the next sample, shape (n,) [N m]."""
        w = self._w
        w[REFERENCE], w[1:COMMAND] = reference, measured[:, self.columns].T
        still = w.clone()
        still[COMMAND] = w[TAU]
        if not self._follows:
            still[REFERENCE] = w[TAU]
        self._x = torch.where(fresh, self._rest @ still, self._x)
        w[COMMAND] = 0.0
        command = self._c @ self._x + self._d @ w
        if self._limit is not None:
            command = command.clamp(-self._limit, self._limit)
        w[COMMAND] = command
        self._x = self._a @ self._x + self._b @ w
        return command
