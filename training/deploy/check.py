"""Whether an exported file does what the policy does, on episodes of its own training task."""

from __future__ import annotations

import ctypes
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from cjt_gym.envs.core import Episodes
from cjt_gym.errors import ConfigurationError
from cjt_gym.export.c_library import compiled
from cjt_gym.training.config import VALIDATION_SEEDS, environment_arguments
from cjt_gym.training.deploy.exported import Stepper, load_exported
from cjt_gym.training.deploy.layout import Layout
from cjt_gym.training.deploy.onnx_file import OnnxStepper
from cjt_gym.training.policy import PolicyAgent

STEPS: Final = 300
TOLERANCE: Final = 2e-5
"""Largest difference of an action, in single precision [-]."""
REPEATS: Final = 2000
UNDISTURBED: Final = 0.1
"""Quantile of the times that counts: other programs only ever add to a step."""
SHIM: Final = """\
#include "policy.h"
static policy_state state;
void reset(void) { policy_reset(&state); }
float step(const float *r, float tau, double q_m, float dq_m, float dq_l, float command) {
  return policy_step(&state, r, tau, q_m, dq_m, dq_l, command);
}
"""


class AnyStepper(Protocol):
    """Whatever computes a policy step by step."""

    def reset(self) -> None:
        """Forget the past."""

    def step(
        self, reference: Any, tau: float, q_m: float, dq_m: float, dq_l: float, command: float
    ) -> float:
        """Return the motor torque [N m]."""
        ...


@dataclass(frozen=True)
class Checked:
    """How an exported file compares with its policy.

    Attributes:
        steps: Control steps that were compared; 0 where nothing could be.
        error: Largest difference of the action [-].
        microseconds: Time of a step that nothing interrupts [us], for C with the call from Python.
        note: Why nothing was compared, else empty.
    """

    steps: int
    error: float
    microseconds: float
    note: str = ""


class CStepper:
    """A header at work, compiled for this machine."""

    def __init__(self, header: str, layout: Layout) -> None:
        """Compile it.

        Raises:
            ConfigurationError: There is no C compiler, or it does not take the header.
        """
        self._library = compiled(SHIM, {"policy.h": header})
        self._step = self._library.step
        number = ctypes.c_float
        self._step.restype = number
        self._step.argtypes = [
            ctypes.POINTER(number),
            number,
            ctypes.c_double,
            number,
            number,
            number,
        ]
        self._reference = (number * (layout.preview + 1))()

    def reset(self) -> None:
        """Forget the past."""
        self._library.reset()

    def step(
        self, reference: Any, tau: float, q_m: float, dq_m: float, dq_l: float, command: float
    ) -> float:
        """Return the motor torque [N m]; see `Stepper.step`."""
        self._reference[:] = reference
        return float(self._step(self._reference, tau, q_m, dq_m, dq_l, command))


def check(agent: PolicyAgent, path: Path, target: str, header: str = "") -> Checked:
    """Compare an exported file with its policy, on what that measures in an episode.

    Args:
        agent: The policy.
        path: The file.
        target: "numpy", "onnx" or "c".
        header: Text of the header, for "c", with the prefix "policy".
    """
    try:
        stepper = _stepper(path, target, header, agent.layout)
    except ConfigurationError as reason:
        return Checked(0, float("nan"), float("nan"), str(reason))
    inputs, wanted = recorded(agent)
    stepper.reset()
    found = np.array([stepper.step(*row) for row in inputs])
    error = float(np.abs(found - wanted).max()) / agent.layout.action
    times = []
    for row in (inputs * (REPEATS // len(inputs) + 1))[:REPEATS]:
        begun = time.perf_counter()
        stepper.step(*row)
        times.append(time.perf_counter() - begun)
    return Checked(len(inputs), error, 1e6 * float(np.quantile(times, UNDISTURBED)))


def _stepper(path: Path, target: str, header: str, layout: Layout) -> AnyStepper:
    if target == "c":
        return CStepper(header, layout)
    return Stepper(load_exported(path)) if target == "numpy" else OnnxStepper(path)


def recorded(agent: PolicyAgent) -> tuple[list[tuple[Any, ...]], NDArray[np.float64]]:
    """Return what a policy sees in an episode, and the motor torques that it adds.

    Returns:
        The arguments of every `step`, and the torques [N m], shape (steps,).
    """
    task = Episodes(1, **environment_arguments(agent.config.env))
    task.plant.seed(VALIDATION_SEEDS)
    task.reset()
    layout, inputs, wanted = agent.layout, [], []
    head = layout.preview + 1
    for _ in range(min(STEPS, task.settings.episode_steps)):
        observation = task.task.observation.copy()
        seen = task.measurement()
        reference = observation[0, :head].astype(np.float64) * layout.torque
        values = [float(x[0]) for x in (seen.tau, seen.q_m, seen.dq_m, seen.dq_l)]
        inputs.append((reference, *values, float(task.task.command[0])))
        action = agent.act(observation)
        wanted.append(float(action[0, 0]) * layout.action)
        task.step(action)
    return inputs, np.array(wanted)
