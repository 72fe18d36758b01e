"""Episodes whose arrays live on a CUDA device."""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np
import torch
from numba import config
from numpy.typing import NDArray

from cjt_gym.baselines.linear_law import (
    COMMAND,
    MEASURED,
    REFERENCE,
    TAU,
    LinearController,
    LinearLaw,
)
from cjt_gym.baselines.pd_feedforward import PdFeedForward
from cjt_gym.envs.core import Episodes
from cjt_gym.errors import ConfigurationError, SimulationError
from cjt_gym.joint.kernel.arrays import CHANNELS
from cjt_gym.training.gpu.host import Step
from cjt_gym.training.gpu.kernels import begin_episodes, cuda, step_episodes

THREADS = 64  # of a block: two warps, as each needs many registers
CHECKED_EVERY = 100  # steps, as to look stops the device
SIMULATED = bool(getattr(config, "ENABLE_CUDASIM", False))


class DeviceEpisodes:
    """Episodes stepped on a CUDA device by the code that the CPU runs, a thread for each.

    All arrays stay there; torch sees those of `HostEpisodes` and those below without a copy. All
    numbers are double precision, as on the CPU. Compiling takes a minute or two, once per process.

    A base controller must be a linear law, such as pd_feedforward: torch computes it on the device.

    Attributes:
        state: [q_m q_g q_l dq_m dq_g dq_l], shape (num_envs, 6) [rad, rad/s].
        measured: Measured channels, shape (num_envs, 8).
        reference: Reference torque now, shape (num_envs,) [N m].
    """

    def __init__(self, num_envs: int, **arguments: Any) -> None:
        """Prepare the episodes; arguments are those of `TorqueTrackingEnv`, checked as there.

        Raises:
            ConfigurationError: There is no CUDA device, or the base controller is no linear law.
        """
        if not cuda.is_available():
            raise ConfigurationError(
                "DeviceEpisodes needs a CUDA device and its driver, got none. Take HostEpisodes, "
                'or on a machine with one:  pip install "cjt-gym[gpu]"'
            )
        host = Episodes(num_envs, **arguments)
        self.num_envs = num_envs
        self.device = torch.device("cpu" if SIMULATED else "cuda")
        self.observation_space, self.action_space = host.observation_space, host.action_space
        self._law = self._law_of(host)
        plant = host.plant
        self._seed, self._host_rng = plant.seed, plant.batch.arrays.rng
        program, draws = plant.varying
        batch: Any = placed(plant.batch.arrays)
        task, control = placed(host.task), placed(host.control)
        numbers = batch.p.view(np.float64).reshape(draws.p.shape)
        draws = placed(draws)._replace(p=numbers)
        program, last = placed(program), place(np.zeros_like(host.task.observation))
        failed = place(np.zeros(1, dtype=np.int64))
        self._step_parts = batch, plant.batch.setup, task, control, program, draws, failed
        self._begin_parts = batch, plant.batch.setup, task, program, draws, last
        self.observation, self.last = tensor(task.observation), tensor(last)
        self.state, self.measured = tensor(batch.state), tensor(batch.measured)
        self.reference = tensor(task.reference)
        self._action, self._base = tensor(control.action), tensor(control.base)
        self._ends = tensor(task.reward), tensor(task.terminated), tensor(task.truncated)
        self._rng, self._new, self._failed = batch.rng, draws.fresh, tensor(failed)
        self._fresh = torch.ones(num_envs, dtype=torch.bool, device=self.device)
        self._steps = 0
        self._blocks = -(-num_envs // THREADS)
        self._threads = min(THREADS, num_envs)
        self._step, self._begin = kernels()

    def _law_of(self, host: Episodes) -> TorchLaw | None:
        controller = host.controller
        if controller is None:
            return None
        # Others with a `linear` form do more than that says: compensate friction, learn, predict.
        added = isinstance(controller, LinearController) and controller.addition is not None
        if added or not isinstance(controller, LinearController | PdFeedForward):
            raise ConfigurationError(
                "base_controller of DeviceEpisodes must be a linear law, such as pd_feedforward, "
                f"got {type(controller).__name__}. Take another, or HostEpisodes."
            )
        assert controller.linear is not None
        parts = controller.linear, controller.torque_limit, self.num_envs, self.device
        return TorchLaw(*parts, follows=isinstance(controller, PdFeedForward))

    def reset(self, seed: int) -> torch.Tensor:
        """Begin all episodes and return their observations; episode i draws with seed + i.

        Raises:
            SimulationError: A state had ceased to be finite before.
        """
        self.check()
        self._seed(seed)
        write(self._rng, self._host_rng)
        write(self._new, np.ones(self.num_envs, dtype=np.bool_))
        self._launch(self._begin, (*self._begin_parts, True))
        self._fresh[:] = True
        return self.observation

    def step(self, action: torch.Tensor) -> Step:
        """Advance all episodes by one control step, see `HostEpisodes`; actions are on the device.

        Raises:
            ConfigurationError: The action has the wrong shape.
            SimulationError: An action or a state ceased to be finite; looked for now and then,
                because looking makes the CPU wait for the device.
        """
        if action.shape != (self.num_envs, 1):
            raise ConfigurationError(
                f"The action must have the shape ({self.num_envs}, 1), got {tuple(action.shape)}."
            )
        self._action.copy_(action[:, 0])
        if self._law is not None:
            self._base.copy_(self._law.act(self.measured, self.reference, self._fresh))
        self._launch(self._step, self._step_parts)
        reward, terminated, truncated = self._ends
        torch.logical_or(terminated, truncated, out=self._fresh)
        self._launch(self._begin, (*self._begin_parts, False))
        self._steps += 1
        if self._steps % CHECKED_EVERY == 0:
            self.check()
        return self.observation, reward, terminated, truncated

    def check(self) -> None:
        """Raise SimulationError if an action or a state has ceased to be finite."""
        failed = int(self._failed[0]) - 1
        if failed >= 0:
            self._failed.zero_()
            raise SimulationError(
                f"The action or the state of episode {failed} ceased to be finite. Check the "
                "policy and the parameters; HostEpisodes says at which step."
            )

    def _launch(self, kernel: Any, parts: tuple[Any, ...]) -> None:
        kernel[self._blocks, self._threads](*parts)


@functools.cache
def kernels() -> tuple[Any, Any]:
    """Return the kernels of a step and of a begin, compiled when they are first called."""
    return cuda.jit(step_episodes), cuda.jit(begin_episodes)


def place(array: NDArray[Any]) -> Any:
    """Copy an array to the device; in the simulator, a plain copy takes its place."""
    if not SIMULATED:
        return cuda.to_device(array)
    copy = array.copy()
    return copy.view(np.recarray) if copy.dtype.names else copy


def placed(parts: Any) -> Any:
    """Return a named tuple with its arrays on the device."""
    return type(parts)(*(place(x) if isinstance(x, np.ndarray) else x for x in parts))


def write(array: Any, values: NDArray[Any]) -> None:
    """Write values into an array of the device."""
    if SIMULATED:
        array[:] = values
    else:
        array.copy_to_device(values)


def tensor(array: Any) -> torch.Tensor:
    """Return an array of the device as a tensor, without a copy."""
    if SIMULATED:
        return torch.from_numpy(array)
    return torch.as_tensor(array, device="cuda")


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
