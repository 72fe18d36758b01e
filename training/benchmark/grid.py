"""The grid of the benchmark: joints x structures x agents x seeds, each cell run once and kept.

A cell is one agent on one joint, structure and seed, through all tasks. Its result is a file, so
that an interrupted benchmark is resumed, and cells run in parallel through joblib: on this
machine (loky), or on the workers of a Ray or Dask cluster.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cjt_gym.analysis import Loop, figures_of, probe_law, probe_plant, stiffest_rendered
from cjt_gym.baselines.gains import files_of
from cjt_gym.disk import write_text
from cjt_gym.errors import ConfigurationError, SimulationError, check_name
from cjt_gym.joint import get_structure, load_joint_file
from cjt_gym.training.benchmark import make_agents
from cjt_gym.training.benchmark.cluster import BACKENDS, cluster
from cjt_gym.training.benchmark.code_hash import code_hash
from cjt_gym.training.deploy.shipped import policy_path
from cjt_gym.training.evaluation.conditions import (
    BANDWIDTH_HIGH,
    BANDWIDTH_LOW,
    Asked,
    Conditions,
)
from cjt_gym.training.evaluation.evaluate import Evaluation, check_episodes, evaluate
from cjt_gym.training.evaluation.metrics import (
    command_above,
    command_change,
    effort_rms,
    frequency_response,
    squared_errors,
)
from cjt_gym.training.evaluation.rollout import Agent, ControllerAgent, Traces, joint_of
from cjt_gym.training.evaluation.tasks import get_task
from cjt_gym.training.tuning.limits import port_resistance

SHOWN_POINTS = 500  # of a curve, which is drawn about as many pixels wide
BODE_HZ = np.geomspace(0.5, 400.0, 120)
SPECTRUM_BANDS = np.geomspace(1.0, 450.0, 28)
FAST_HZ = 100.0  # above it a command holds noise rather than the task
HAND_SHARE = 0.05
"""Damping of a hand at the output where a stiffness is rendered, over `port_resistance`."""


@dataclass(frozen=True)
class Cell(Asked):
    """One agent on one joint, structure and seed."""

    agent: str  # what `choose` takes, or run folder of a policy
    is_policy: bool  # whether it is a run folder or an exported policy
    joint: str  # name of the joint, or path of its file
    structure: str
    tasks: tuple[str, ...]
    seed: int = 0  # which held-out episodes
    episodes: int = 32  # of each task
    amplitude: float | None = None  # of the references [N m]; None for that of the joint

    def conditions(self) -> Conditions:
        """Return the conditions of the comparison."""
        return self.conditions_on(self.joint, self.structure, torque_amplitude=self.amplitude)

    def key(self) -> str:
        """Return a name that changes with everything that the result depends on.

        That is the cell itself, the joint, what is in a gain file or a run folder, and the code
        with the gains that ship (`code_hash`).
        """
        content = ""
        if not self.is_policy:
            content = " ".join(path.read_text(encoding="utf-8") for path in files_of(self.agent))
        else:
            here = policy_path(self.agent)
            files = sorted(p for p in (here, *here.rglob("*")) if p.is_file())
            content = " ".join(f"{p.name} {p.stat().st_size} {p.stat().st_mtime_ns}" for p in files)
        joint = load_joint_file(self.joint).hash_hex()
        text = json.dumps([asdict(self), content, joint, code_hash()], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:20]

    def load(self) -> Agent:
        """Return the agent."""
        named = ([], [self.agent]) if self.is_policy else ([self.agent], [])
        return make_agents(*named)[0]


def run_cell(cell: Cell) -> dict[str, Any]:
    """Run a cell and return its result as plain data.

    Returns:
        "status": "done"; "refused" where the law does not hold for the joint; "failed" where the
        simulation left the finite numbers; for the last two, why. When done: the rows of
        the benchmark, squared errors of every episode, change, part above 100 Hz and effort of the
        command [N m], one episode, error spectra, the response to the sweep, and what the linear
        loop says.
    """
    agent = cell.load()
    base: dict[str, Any] = {"cell": asdict(cell), "agent": agent.name}
    base |= {"kind": agent.kind, "renders": agent.renders}

    def do() -> dict[str, Any]:
        conditions = cell.conditions()
        if not agent.arguments(conditions).get("observe_joint"):  # policies for many joints do
            base["trained_on"] = agent.trained_on
        base["effects"] = list(joint_of(conditions).effects)
        found = evaluate(agent, conditions, cell.tasks, cell.episodes, cell.seed)
        return {**_result(found), "linear": _linear(cell, agent)}

    return base | attempted(do)


def attempted(do: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Return what a function gives, with a "status"; "refused" or "failed", and why, if nothing."""
    try:
        return {"status": "done", **do()}
    except SimulationError as error:
        return {"status": "failed", "why": str(error)}
    except ConfigurationError as error:
        return {"status": "refused", "why": str(error)}


def _result(found: Evaluation) -> dict[str, Any]:
    f, response = frequency_response(found.sweep, BANDWIDTH_LOW, BANDWIDTH_HIGH)
    return {
        "rows": [row.to_json() for row in found.rows],
        "squares": {task: squared_errors(run).tolist() for task, run in found.traces.items()},
        "powers": {
            task: np.mean(run.reference**2, axis=1).tolist() for task, run in found.traces.items()
        },
        "commands": {
            task: {
                "change": command_change(run),
                "fast": command_above(run, FAST_HZ),
                "effort": effort_rms(run),
            }
            for task, run in found.traces.items()
        },
        "shown": {task: _shown(run) for task, run in found.traces.items()},
        "spectra": {task: _spectrum(run) for task, run in found.traces.items()},
        "sweep": {"f": _short(f), "gain": _short(np.abs(response)), "phase": _phase(response)},
    }


def _short(values: Iterable[float]) -> list[float | None]:
    """Return numbers with five digits, None for what is not finite."""
    return [float(f"{v:.5g}") if math.isfinite(v) else None for v in values]


def _phase(response: NDArray[np.complex128]) -> list[float | None]:
    return _short(np.rad2deg(np.unwrap(np.angle(response))))


def _shown(run: Traces) -> dict[str, list[float | None]]:
    """Return the first episode, thinned out."""
    step = max(1, run.tau.shape[1] // SHOWN_POINTS)
    series = {name: _short(getattr(run, name)[0, ::step]) for name in ("reference", "tau")}
    return {"t": _short(run.t[::step]), **series}


def _spectrum(run: Traces) -> dict[str, list[float | None]]:
    """Return the rms of the error in bands of frequency [N m], over all episodes."""
    f = np.fft.rfftfreq(run.error.shape[1], run.dt)
    power = np.mean(np.abs(np.fft.rfft(run.error, axis=1)) ** 2, axis=0)
    power *= 2.0 / run.error.shape[1] ** 2
    low, high = SPECTRUM_BANDS[:-1], SPECTRUM_BANDS[1:]
    sums = [power[(f >= a) & (f < b)].sum() for a, b in zip(low, high, strict=True)]
    kept = [k for k, total in enumerate(sums) if total > 0.0]
    return {
        "f": _short(np.sqrt(low * high)[kept]),
        "rms": _short(np.sqrt(np.array(sums)[kept])),
    }


def _linear(cell: Cell, agent: Agent) -> dict[str, Any] | None:
    """Return what the linear loop says of a classical controller; None of policies."""
    if (
        not isinstance(agent, ControllerAgent)
        or "k_b" not in get_structure(cell.structure).needed_parameters
    ):
        return None
    conditions = cell.conditions()
    joint = joint_of(conditions)
    law = probe_law(
        agent.base()["base_controller"](joint, conditions.dt_control), joint, conditions.dt_control
    )
    if not law.is_linear:
        return {"is_linear": False}
    loop = Loop(law, probe_plant(joint, conditions.dt_control))
    r = loop.responses(BODE_HZ)
    figures = figures_of(loop).to_dict()
    hand = HAND_SHARE * port_resistance(joint)
    figures["stiffest"] = stiffest_rendered(loop, environment=hand) if figures["stable"] else 0.0
    plain = {n: v if isinstance(v, bool) else _short([v])[0] for n, v in figures.items()}
    # Infinite margins are no missing ones: there is no feedback to lose.
    endless = [n for n, v in figures.items() if isinstance(v, float) and math.isinf(v)]
    return {
        "is_linear": True,
        "figures": plain,
        "infinite": endless,
        "f": _short(BODE_HZ),
        "gain": _short(np.abs(r.reference)),
        "phase": _phase(r.reference),
    }


def kept(cell: Cell, folder: Path) -> dict[str, Any] | None:
    """Return the result of a cell that was run before, None if there is none."""
    path = folder / f"{cell.key()}.json"
    try:
        result = json.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, ValueError):
        return None
    return result if isinstance(result, dict) else None


def _run_and_keep(cell: Cell, folder: Path) -> dict[str, Any]:
    text = json.dumps(run_cell(cell))
    write_text(folder / f"{cell.key()}.json", text)
    result: dict[str, Any] = json.loads(text)
    return result


def run_grid(
    cells: Sequence[Cell],
    folder: Path,
    jobs: int = 1,
    backend: str = "loky",
    report: Callable[[dict[str, Any]], None] = lambda result: None,
) -> list[dict[str, Any]]:
    """Run cells, or take what the folder keeps of them; return their results in order.

    The folder must be seen by workers on other machines too. `jobs` processes work side by side, -1
    for one per core. For "ray" and "dask" a cluster that is already there is used, as their
    environment variables say, else one on this machine.
    """
    check_name("backend", backend, BACKENDS)
    if jobs < 1 and jobs != -1:
        raise ConfigurationError(f"--jobs must be >= 1, or -1 for one per core, got {jobs}.")
    folder.mkdir(parents=True, exist_ok=True)
    folder = folder.resolve()
    results: dict[Cell, dict[str, Any]] = {}
    for cell in cells:
        known = kept(cell, folder)
        if known is not None:
            results[cell] = known
            report(known)
    missing = [cell for cell in cells if cell not in results]
    if backend == "loky" and (jobs == 1 or len(missing) < 2):
        for cell in missing:
            results[cell] = _run_and_keep(cell, folder)
            report(results[cell])
    elif missing:
        from joblib import Parallel, delayed

        with cluster(backend, jobs):
            # Ray's backend gives its results only all at once.
            way = "list" if backend == "ray" else "generator_unordered"
            tasks = (delayed(_numbered)(k, cell, folder) for k, cell in enumerate(missing))
            for k, result in Parallel(n_jobs=jobs, return_as=way)(tasks):
                results[missing[k]] = result
                report(result)
    return [results[cell] for cell in cells]


def _numbered(k: int, cell: Cell, folder: Path) -> tuple[int, dict[str, Any]]:
    return k, _run_and_keep(cell, folder)


def make_cells(
    controllers: Sequence[str],
    policies: Sequence[str],
    joints: Sequence[str],
    structures: Sequence[str],
    tasks: Sequence[str],
    seeds: Sequence[int],
    episodes: int,
    **others: Any,
) -> list[Cell]:
    """Return the cells of a grid; `others` are those that `Cell` inherits, and its amplitude.

    Tasks that do not exist for a structure are left out there.
    """
    agents = make_agents(controllers, policies)
    words = [(word, False) for word in controllers] + [(str(word), True) for word in policies]
    for joint in joints:
        load_joint_file(joint)
    for task in tasks:
        if not any(get_task(task).suits(s, a) for s in structures for a in agents):
            raise ConfigurationError(
                f"Task {task} does not exist for the structures {', '.join(structures)} and these "
                "agents. Leave it out, or add a structure."
            )
    check_episodes(episodes, min(seeds))
    return [
        Cell(word, is_policy, joint, structure, kept_tasks, seed, episodes, **others)
        for joint in joints
        for structure in structures
        for (word, is_policy), agent in zip(words, agents, strict=True)
        if (kept_tasks := tuple(t for t in tasks if get_task(t).suits(structure, agent)))
        for seed in seeds
    ]
