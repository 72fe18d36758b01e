"""Typed access to the golden figures in this folder; their source is in README.md."""

from __future__ import annotations

import functools
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cjt_gym.joint import STRUCTURES, JointFile, JointParameters, Quantity, to_toml
from cjt_gym.joint.files.parameter_table import PARAMETERS

HERE: Final = Path(__file__).parent
Array = NDArray[Any]
Value = float | list[float]

SYMBOLS: Final = (
    *("I_m", "I_g", "I_l", "k_g", "k_b", "d_mg", "d_gl", "n", "k_t", "r", "l_a", "p", "v_0", "i_p"),
    *(f"d_{kind}{body}{way}" for kind in ("", "c") for body in "mgl" for way in ("", "_n")),
)
"""The parameters that dynamics and drives need."""


def oracle_sets() -> tuple[str, ...]:
    """Return the names of the parameter sets: eight of the toolbox, and oracle_asym."""
    return tuple(_json("params.json")["sets"])


def oracle_parameters(name: str) -> dict[str, Value]:
    """Return all 47 parameters of a set under the toolbox's symbols, the inductance also as l_a."""
    values: dict[str, Value] = dict(_json("params.json")["sets"][name])
    return values | {"l_a": values["x"]}


def oracle_numbers(name: str) -> dict[str, float]:
    """Return those parameters of a set that :data:`SYMBOLS` names, all of them plain numbers."""
    values = oracle_parameters(name)
    return {symbol: _number(values[symbol]) for symbol in SYMBOLS}


def write_joint(path: Path, name: str, replace: Mapping[str, float] | None = None) -> Path:
    """Write a parameter set as a joint file, with some values replaced; return its path."""
    values = oracle_numbers(name) | dict(replace or {})
    quantities = {
        symbol: Quantity(
            value, PARAMETERS[symbol].units["rotary"][0], asymmetric=symbol.endswith("_n")
        )
        for symbol, value in values.items()
    }
    parameters = JointParameters(path.stem, "golden parameter set", quantities)
    path.write_text(to_toml(JointFile(parameters)), encoding="utf-8")
    return path


def linear(name: str, structure: str, what: str) -> Array:
    """Return a linear figure of a set: A B C D I R K, zoh_A ... zoh_D (1 ms), eig, H (7, 2, 30)."""
    archive = _npz("linear.npz")
    return np.asarray(archive[f"{structure}/{what}"][_index(archive, name)])


def frequencies(structure: str) -> Array:
    """Return the frequencies of H, shape (30,) [Hz]."""
    return np.asarray(_npz("linear.npz")[f"{structure}/f_hz"])


def electrical(name: str, drive: str, what: str) -> Array:
    """Return an electrical figure of a set.

    Args:
        name: Parameter set.
        drive: ``"static"`` (D), ``"rl"`` (A B C D, sys_dc) or ``"dq"`` (x, u, x_dot, tau_m).
        what: Which figure.
    """
    archive = _npz("electrical.npz")
    return np.asarray(archive[f"{drive}/{what}"][_index(archive, name)])


def secondary(name: str) -> dict[str, float]:
    """Return the secondary properties of a set: i_c, t_r, dq_NL ..."""
    return dict(_json("secondary.json")[name])


def datasheet_sets() -> tuple[str, ...]:
    """Return the names of the sets that have curves of the data sheet."""
    return tuple(dict.fromkeys(key.split("/")[0] for key in _npz("datasheet.npz")))


def datasheet(name: str, curve: str) -> Array:
    """Return a curve of the data sheet of a set, such as ``"torque_speed/speed"``."""
    return _npz("datasheet.npz")[f"{name}/{curve}"]


@dataclass(frozen=True)
class NonlinearCase:
    """50 states of one set and structure, and the nonlinear torques there.

    Attributes:
        bodies: Angles and velocities of motor, gear and load, shape (50, 6); those of a fixed load
            are its angle and zero.
        torque: For each function of the toolbox the torque as it is meant, shape (50, coordinates).
        as_coded: The same as the toolbox computes it, NaN where it fails.
    """

    bodies: Array
    torque: dict[str, Array]
    as_coded: dict[str, Array]


NONLINEAR_SETS: Final = ("oracle_asym", "cjt_Lime_50_21000", "example_params")
NONLINEAR_TERMS: Final = (
    "coulomb",
    "coulomb_asym",
    "viscous_asym",
    "ripple_type1",
    "ripple_type2",
    "ripple_mixed",
)


def nonlinear(name: str, structure: str) -> NonlinearCase:
    """Return the states and nonlinear torques of a set and structure."""
    archive, base = _npz("nonlinear.npz"), f"{name}/{structure}/"
    return NonlinearCase(
        bodies=bodies_of(structure, archive[base + "X"].T),
        torque={term: archive[f"{base}{term}/tau_intended"].T for term in NONLINEAR_TERMS},
        as_coded={term: archive[f"{base}{term}/tau_cjt"].T for term in NONLINEAR_TERMS},
    )


def ripple_rows(term: str, kind: int) -> dict[str, tuple[float, ...]]:
    """Return f, a, b of the rows of a ripple term of a kind (1 additive, 2 proportional)."""
    archive = _npz("nonlinear.npz")
    pick = archive[f"{term}/rip_types"] == kind
    keys = {"f": "rip_f", "a": "rip_a1", "b": "rip_a2"}
    return {name: tuple(map(float, archive[f"{term}/{key}"][pick])) for name, key in keys.items()}


def bodies_of(structure: str, states: Array) -> Array:
    """Return a structure's states, (n, order), as angles and velocities of the bodies, (n, 6)."""
    row, result = STRUCTURES[structure], np.zeros((len(states), 6))
    for body, group in enumerate(row.groups):
        if group >= 0:
            result[:, body] = states[:, group]
            result[:, 3 + body] = states[:, row.order - row.size + group]
        else:
            result[:, body] = states[:, row.size]
    return result


def reduce_torque(structure: str, torque: Array) -> Array:
    """Return torques on the bodies, shape (..., 3), summed over the bodies that move together."""
    return np.asarray(torque @ STRUCTURES[structure].selection)


@dataclass(frozen=True)
class Trajectory:
    """One recorded simulation: inputs at every sample, states at every ``every``-th.

    Attributes:
        name: Its name.
        joint: Parameter set.
        structure: Structure.
        effects: The toolbox's nonlinear terms; none for a linear one.
        dt: Sample time [s].
        every: Interval of the kept states, in samples.
        inputs: Held from sample to sample, shape (n, 2): motor torque, or voltage; then load torque
            or load velocity. For the drive dq shape (n, 3): v_q, v_d, load velocity.
        states: Angles and velocities of the bodies, shape (n // every + 1, 6); the velocity of a
            fixed load is left zero.
        ripple: Lists kind (1 additive, 2 proportional), f, a, b; none without ripple.
        drive: Electrical drive.
        current: Current, shape (kept,), or [i_q, i_d], shape (kept, 2); empty for torques.
        tau_m: Motor torque, shape (kept,); empty where the torque is the input.
    """

    name: str
    joint: str
    structure: str
    effects: tuple[str, ...]
    dt: float
    every: int
    inputs: Array
    states: Array
    ripple: dict[str, list[float]]
    drive: str
    current: Array
    tau_m: Array


def mechanical_trajectories(nonlinear_ones: bool) -> tuple[Trajectory, ...]:
    """Return the 45 linear or the 38 nonlinear trajectories that are driven by a motor torque."""
    rows = _json("trajectories.json")["mechanical"]
    return tuple(
        _trajectory(row, row["input"], "x")
        for row in rows
        if bool(row["effects"]) == nonlinear_ones
    )


def electrical_trajectories() -> tuple[Trajectory, ...]:
    """Return the six trajectories that are driven by a voltage."""
    rows = _json("trajectories.json")["electrical"]
    return tuple(_trajectory(row, f"electrical/u/{row['name']}", "electrical/x") for row in rows)


def _trajectory(row: Mapping[str, Any], inputs: str, states: str) -> Trajectory:
    archive, name, none = _npz("trajectories.npz"), row["name"], np.empty(0)
    return Trajectory(
        name,
        row["joint"],
        row["structure"],
        tuple(row.get("effects", ())),
        row["dt"],
        row["every"],
        archive[inputs],
        bodies_of(row["structure"], archive[f"{states}/{name}"]),
        row.get("ripple", {}),
        row.get("drive", "current"),
        archive.get(f"electrical/i/{name}", none),
        archive.get(f"electrical/tau_m/{name}", none),
    )


def _number(value: Value) -> float:
    assert isinstance(value, int | float)
    return float(value)


def _index(archive: Mapping[str, Array], name: str) -> int:
    return list(archive["sets"]).index(name)


@functools.cache
def _json(name: str) -> dict[str, Any]:
    data: dict[str, Any] = json.loads((HERE / name).read_text(encoding="utf-8"))
    return data


@functools.cache
def _npz(name: str) -> dict[str, Array]:
    with np.load(HERE / name) as archive:
        return {key: archive[key] for key in archive.files}
