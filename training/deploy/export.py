"""Write a policy in one of its forms, and try whether the file does what the policy does.

It is tried on an episode of its own training task, and on records.
"""

from __future__ import annotations

import ctypes
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from cjt_gym.baselines.linear_law import MEASURED
from cjt_gym.disk import write_text
from cjt_gym.envs.core import Episodes
from cjt_gym.envs.foreign import ForeignEpisode
from cjt_gym.envs.observation import Layout
from cjt_gym.errors import ConfigurationError, check_name
from cjt_gym.export.c_files import Checked, ExportError, compiled
from cjt_gym.export.c_text import VALUES, identifier, parameters
from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.plant import Measurement
from cjt_gym.records import Record
from cjt_gym.training.deploy.c_header import c_header
from cjt_gym.training.deploy.exported import Exported, load_exported, save_exported
from cjt_gym.training.deploy.fast_policy import exported
from cjt_gym.training.deploy.onnx_file import OnnxStepper, write_onnx
from cjt_gym.training.deploy.shipped import load_agent
from cjt_gym.training.deploy.stepper import Stepper
from cjt_gym.training.learning.config import VALIDATION_SEEDS, environment_arguments
from cjt_gym.training.learning.policy import PolicyAgent

Run = tuple[list[tuple[Any, ...]], Floats]
STEPS: Final = 300  # of an episode, whose first few fill the memory of observations
FORMS = ("onnx", "numpy", "c")
TOLERANCE: Final = 2e-5
"""Largest difference of an action, in single precision [-]."""
REPEATS: Final = 2000  # calls that are timed: a fraction of a second
UNDISTURBED: Final = 0.1
"""Quantile of the times that counts: other programs only ever add to a step."""
SHIM: Final = f"""\
#include "policy.h"
static policy_state state;
void reset(void) {{ policy_reset(&state); }}
double step(const double *reference, {parameters("double")}) {{
  return policy_step(&state, reference, {VALUES});
}}
"""


class CStepper:
    """A running header, compiled for this machine."""

    def __init__(self, header: str, layout: Layout) -> None:
        self._library = compiled(SHIM, {"policy.h": header})
        self._step = self._library.step
        number = ctypes.c_double
        self._step.restype = number
        self._step.argtypes = [ctypes.POINTER(number), *[number] * len(MEASURED)]
        self._reference = (number * (layout.preview + 1))()

    def reset(self) -> None:
        """Forget the past."""
        self._library.reset()

    def step(self, reference: Any, /, *measured: float) -> float:
        """Return the motor torque to command [N m]; see `Stepper.step`."""
        self._reference[:] = reference
        return float(self._step(self._reference, *measured))


def check(
    agent: PolicyAgent | Exported,
    path: Path,
    target: str,
    header: str = "",
    records: Sequence[Record] = (),
) -> Checked:
    """Compare an exported file with its policy, on what that measures in an episode.

    The target is "numpy", "onnx" or "c", for which `header` is the text with the prefix "policy";
    records are recorded signals to compare on, too.
    """
    runs = [recorded(agent), *(replayed(agent, record) for record in records)]
    try:
        stepper = _stepper(path, target, header, agent.layout)
    except ConfigurationError as reason:
        return Checked(0, float("nan"), str(reason))
    error = 0.0
    for inputs, wanted in runs:
        stepper.reset()
        found = np.array([stepper.step(*row) for row in inputs])
        error = max(error, float(np.abs(found - wanted).max()) / agent.layout.action)
    inputs, times = runs[0][0], []
    for row in (inputs * (REPEATS // len(inputs) + 1))[:REPEATS]:
        begun = time.perf_counter()
        stepper.step(*row)
        times.append(time.perf_counter() - begun)
    steps = sum(len(inputs) for inputs, _ in runs)
    return Checked(steps, error, microseconds=1e6 * float(np.quantile(times, UNDISTURBED)))


def _stepper(
    path: Path, target: str, header: str, layout: Layout
) -> CStepper | OnnxStepper | Stepper:
    if target == "c":
        return CStepper(header, layout)
    if target == "onnx":
        return OnnxStepper(path)
    return Stepper(load_exported(path))


def recorded(agent: PolicyAgent | Exported) -> Run:
    """Return what a policy sees in an episode of its task, and what it commands.

    Returns:
        The arguments of every `step`, and the motor torques [N m], shape (steps,).
    """
    task = Episodes(1, **environment_arguments(agent.config.env))
    task.plant.seed(VALIDATION_SEEDS)
    task.reset()
    agent.begin()
    layout, inputs, wanted = agent.layout, [], []
    head = layout.preview + 1
    for _ in range(min(STEPS, task.settings.episode_steps)):
        observation = task.task.observation.copy()
        seen = task.plant.measurement()
        reference = observation[0, :head].astype(np.float64) * layout.torque
        reference[0] = task.task.reference[0]
        inputs.append((reference, *(float(getattr(seen, name)[0]) for name in MEASURED)))
        task.step(agent.act(observation))
        wanted.append(float(task.task.command[0]))
    return inputs, np.array(wanted)


def replayed(agent: PolicyAgent | Exported, record: Record) -> Run:
    """Return the signals of a record, and what policy and base controller command to them."""
    layout = agent.layout
    columns = _columns(record, exported(agent), layout)
    count, ahead = len(record), np.arange(layout.preview + 1)
    wanted = np.append(columns["tau_ref"], np.full(len(ahead), columns["tau_ref"][-1]))
    arguments = environment_arguments(agent.config.env) | {"reference": wanted}
    episode, zero = ForeignEpisode(Episodes(1, **arguments)), np.zeros(1)
    agent.begin()
    inputs: list[tuple[Any, ...]] = []
    commands: list[float] = []
    for k in range(count):
        seen = {name: columns[name][k : k + 1] for name in MEASURED}
        measured = Measurement(t=zero + k * layout.dt, i=zero, **seen)
        if k == 0:
            episode.begin(measured)
        else:
            episode.advance(measured)
            episode.conclude(commands[-1])
        commands.append(float(episode.choose(agent.act(episode.task.observation))[0]))
        inputs.append((wanted[k + ahead], *(float(x[0]) for x in seen.values())))
    return inputs, np.array(commands)


def _columns(record: Record, policy: Exported, layout: Layout) -> dict[str, Floats]:
    """Return the signals of a record, zeros for those that the policy does not need."""
    if abs(record.dt - layout.dt) > 1e-6 * layout.dt:
        raise ConfigurationError(
            f"{record.owner} has a sample time of {record.dt:g} s; the policy {policy.name} runs "
            f"every {layout.dt:g} s. Record at that rate."
        )
    used = policy.uses
    names = {"tau_ref": "reference", **{name: name for name in MEASURED}}
    missing = [name for name, signal in names.items() if signal in used and name not in record]
    if missing:
        raise ConfigurationError(
            f"{record.owner} lacks {', '.join(missing)}, which the policy {policy.name} needs. "
            "Take a record of  cjt-gym simulate  or  cjt-gym hardware."
        )
    nothing = np.zeros(len(record))
    return {name: np.array(record[name]) if name in record else nothing for name in names}


@dataclass(frozen=True)
class Written:
    """An exported policy."""

    path: Path
    form: str  # "onnx", "numpy" or "c"
    checked: Checked  # how it compares with the policy

    def to_dict(self) -> dict[str, Any]:
        """Return the same as plain data; what is not known is None."""
        numbers = {name: getattr(self.checked, name) for name in ("error", "microseconds")}
        known = {name: x if math.isfinite(x) else None for name, x in numbers.items()}
        steps, note = self.checked.steps, self.checked.note
        return {"file": str(self.path), "form": self.form, "steps": steps, **known, "note": note}

    def summary(self) -> str:
        """Return it in words."""
        c = self.checked
        if not c.steps:
            return f"{self.path}: not tried. {c.note}"
        return (
            f"{self.path}: the whole controller; commands as the run to {c.error:.1e} of the "
            f"policy's largest torque, over {c.steps} steps; {c.microseconds:.1f} us a step"
        )


def export_policy(
    run: str | Path, form: str, path: str | Path, records: Sequence[Record] = ()
) -> Written:
    """Write a policy in another form, and try the file on an episode of its training task.

    Args:
        run: The run folder, the file of an exported policy, or the name of one that ships.
        form: "onnx", "numpy" or "c".
        path: The file to write. Names in a C header begin with its name.
        records: Recorded signals on which the file is to be compared with the policy, too.

    Raises:
        UnknownNameError: There is no such form; or the run looks like a name, and no policy of that
            name ships.
        MissingFileError: There is no such path.
        ConfigurationError: It is not a run of cjt-gym, its network or its base controller cannot be
            exported, a record does not fit, or a package is missing.
        ExportError: The file gives other actions than the policy.
    """
    check_name("form", form, FORMS)
    path = Path(path)
    agent = load_agent(run)
    policy, header = exported(agent), ""
    if form == "onnx":
        write_onnx(policy, path)
    elif form == "numpy":
        save_exported(policy, path)
    else:
        header = c_header(policy)
        prefix = identifier(path.stem, "policy")
        named = header if prefix == "policy" else c_header(policy, prefix)
        write_text(path, named)
    checked = check(agent, path, form, header, records)
    if checked.steps and not checked.error <= TOLERANCE:
        raise ExportError(
            f"{path} gives torques that differ from those of {run} by {checked.error:.2g} of the "
            f"policy's largest one, more than {TOLERANCE:g}. Do not use it."
        )
    return Written(path, form, checked)
