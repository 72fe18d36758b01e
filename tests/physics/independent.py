"""An independent simulator of the nonlinear three-mass joint, to measure the kernel against.

It shares no formula with the package: forces are written out body by body, the five structures
add them up, and SciPy's explicit Runge-Kutta method of order 8 (dop853, Hairer, Norsett, Wanner
1993) integrates them to rtol 1e-10, restarted at every sample because the inputs are held there.
An explicit method is the right one here: the torsion bar's mode (up to 14.5 krad/s, hardly
damped) has to be resolved anyway, and at the steps that this takes nothing else is stiff.
Compiled right-hand side: about 1 to 3 s for one second of a stiff joint.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import ode, solve_ivp

FloatArray = NDArray[np.float64]
Groups = NDArray[np.int64]

COORDINATES: Final[dict[str, tuple[int, int, int]]] = {
    "full_dynamics": (0, 1, 2),
    "rigid_gearbox": (0, 0, 1),
    "rigid": (0, 0, 0),
    "output_fixed": (0, 1, -1),
    "output_fixed_rigid_gearbox": (0, 0, -1),
}
LINEAR: Final = ("I_m", "I_g", "I_l", "k_g", "k_b", "d_m", "d_g", "d_l", "d_mg", "d_gl")
I_M, I_G, I_L, K_G, K_B, D_M, D_G, D_L, D_MG, D_GL = range(10)
FRICTION: Final = 10  # per body: Coulomb level up, down, additional damping at negative speed
DQ_0, TAU_M, LOAD, ELASTIC, SIZE = 19, 20, 21, 22, 23
RTOL, ATOL = 1e-10, 1e-15


def reference_states(
    parameters: Mapping[str, Any],
    structure: str,
    effects: Mapping[str, Mapping[str, Any]],
    tau_m: ArrayLike,
    load: ArrayLike | None,
    dt: float,
    elastic_ripple: bool = False,
) -> FloatArray:
    """Return the states [q_m q_g q_l dq_m dq_g dq_l] at every sample, shape (n, 6) [rad, rad/s].

    Args:
        parameters: Symbols and values of the joint, SI.
        structure: One of the five structures.
        effects: Smooth effects by name: coulomb, coulomb_asym, viscous_asym, cogging, gear_ripple.
            What is not given there is taken from ``parameters``; dq_0 defaults to 0.002.
        tau_m: Motor torque, held from its sample to the next, shape (n,) [N m].
        load: Load torque [N m] or, where the output is fixed, load velocity [rad/s]; shape (n,).
        dt: Sample time [s].
        elastic_ripple: Whether gear ripple sees the toolbox's transmitted torque, without damping
            and 1 N m if the joint is rigid, in place of the physical one.
    """
    torque = np.asarray(tau_m, dtype=np.float64)
    loads = np.zeros_like(torque) if load is None else np.asarray(load, dtype=np.float64)
    constants = _constants(parameters, effects, elastic_ripple)
    ripple = _ripple_table(effects)
    groups = np.array(COORDINATES[structure])
    # First angle and the stretches after it, then the same as rates: tolerances are relative to
    # each entry, and a stretch of a microradian would drown in an angle.
    state = np.zeros(2 * (groups.max() + 1) + int(groups[2] < 0))
    solver = ode(_slope).set_f_params(constants, ripple, groups)
    solver.set_integrator("dop853", rtol=RTOL, atol=ATOL, nsteps=1_000_000)
    states = np.empty((len(torque), 6))
    for k in range(len(torque)):
        constants[TAU_M], constants[LOAD] = torque[k], loads[k]
        states[k] = _bodies(groups, state, loads[k])
        if k + 1 < len(torque):
            solver.set_initial_value(state, 0.0)
            state = solver.integrate(dt)
            if not solver.successful():
                raise RuntimeError(
                    f"dop853 failed at sample {k} with code {solver.get_return_code()}"
                )
    if groups[2] < 0:
        states[1:, 2] = dt * np.cumsum(loads[:-1])
    return states


def joint_torque(parameters: Mapping[str, Any], states: FloatArray) -> FloatArray:
    """Return the torque of the torsion bar for states of shape (n, 6), shape (n,) [N m]."""
    spring = parameters["k_b"] * (states[:, 1] - states[:, 2])
    return np.asarray(spring + parameters.get("d_gl", 0.0) * (states[:, 4] - states[:, 5]))


def peak_errors(states: FloatArray, reference: FloatArray) -> FloatArray:
    """Return the largest deviation of each column relative to the reference's peak, shape (6,)."""
    peak = np.abs(reference).max(axis=0)
    return np.asarray(np.abs(states - reference).max(axis=0) / np.where(peak > 0.0, peak, 1.0))


def _constants(
    parameters: Mapping[str, Any], effects: Mapping[str, Mapping[str, Any]], elastic: bool
) -> FloatArray:
    c = np.zeros(SIZE)
    c[: len(LINEAR)] = [parameters.get(symbol, 0.0) for symbol in LINEAR]
    c[DQ_0], c[ELASTIC] = 0.002, float(elastic)
    for name, given in effects.items():
        values = {**parameters, **given}
        for body, letter in enumerate("mgl"):
            _add_friction(c[FRICTION + 3 * body : FRICTION + 3 * body + 3], name, values, letter)
        if name.startswith("coulomb"):
            c[DQ_0] = given.get("dq_0", 0.002)
    return c


def _add_friction(row: FloatArray, effect: str, values: Mapping[str, Any], letter: str) -> None:
    up = values.get(f"d_c{letter}", 0.0)
    if effect == "coulomb":
        row[:2] += up
    elif effect == "coulomb_asym":
        row[:2] += up, values.get(f"d_c{letter}_n", up)
    elif effect == "viscous_asym":
        both = values.get(f"d_{letter}", 0.0)
        row[2] += values.get(f"d_{letter}_n", both) - both


def _ripple_table(effects: Mapping[str, Mapping[str, Any]]) -> FloatArray:
    rows = [
        (*series, share)
        for name, share in (("cogging", 0.0), ("gear_ripple", 1.0))
        if name in effects
        for series in zip(*(np.atleast_1d(effects[name][key]) for key in "fab"), strict=True)
    ]
    return np.array(rows, dtype=np.float64).reshape(-1, 4)


def _bodies(groups: Groups, state: FloatArray, load: float) -> FloatArray:
    """Return angles and velocities of the three bodies, shape (6,)."""
    size = groups.max() + 1
    angles = state[0] - np.concatenate([[0.0], np.cumsum(state[1:-size])])
    speeds = state[-size] - np.concatenate([[0.0], np.cumsum(state[len(state) - size + 1 :])])
    return np.concatenate([angles[groups], np.append(speeds, load)[groups]])


@njit(cache=True)
def _drag(c: FloatArray, body: int, v: float) -> float:
    """Return the nonlinear friction torque of a body, against its motion."""
    up, down, extra = c[FRICTION + 3 * body], c[FRICTION + 3 * body + 1], c[FRICTION + 3 * body + 2]
    if v > 0.0:
        return float(-up * np.tanh(v / c[DQ_0]))
    return float(-down * np.tanh(v / c[DQ_0]) - extra * v)


@njit(cache=True)
def _series(ripple: FloatArray, q: float) -> tuple[float, float]:
    """Return the additive ripple [N m] and the ripple per transmitted torque [-]."""
    added, share = 0.0, 0.0
    for row in ripple:
        value = row[1] * np.cos(row[0] * q) + row[2] * np.sin(row[0] * q)
        if row[3] == 0.0:
            added += value
        else:
            share += value
    return added, share


@njit(cache=True)
def _slope(
    t: float, x: FloatArray, c: FloatArray, ripple: FloatArray, groups: Groups
) -> FloatArray:
    """Return dx/dt: the forces on each body, summed over the bodies that move together."""
    gear_at, load_at, free = groups[1], groups[2], groups[2] >= 0
    size = x.size // 2
    rates = x[x.size - size :]
    gear_stretch, gear_rate, bar_stretch, bar_rate = 0.0, 0.0, 0.0, 0.0
    if gear_at > 0:
        gear_stretch, gear_rate = x[gear_at], rates[gear_at]
    v_m = rates[0]
    v_g = v_m - gear_rate
    if not free:
        bar_stretch, bar_rate = x[size], v_g - c[LOAD]
    elif load_at > gear_at:
        bar_stretch, bar_rate = x[load_at], rates[load_at]
    v_l = v_g - bar_rate
    gear = c[K_G] * gear_stretch + c[D_MG] * gear_rate
    bar = c[K_B] * bar_stretch + c[D_GL] * bar_rate
    added, share = _series(ripple, x[0])
    on_motor = c[TAU_M] + added - c[D_M] * v_m + _drag(c, 0, v_m) - gear
    on_gear = gear - c[D_G] * v_g + _drag(c, 1, v_g) - bar
    on_load = bar - c[D_L] * v_l + _drag(c, 2, v_l) + c[LOAD]
    dx = np.zeros_like(x)
    dx[0] = v_m
    if free and load_at == 0:
        # the transmitted torque is I_l ddq - on_load, and feeds back through the ripple
        force, inertia = on_motor + on_gear + on_load, c[I_M] + c[I_G] + c[I_L]
        if c[ELASTIC] > 0.0:
            dx[1] = (force + share) / inertia
        else:
            dx[1] = (force - share * on_load) / (inertia - share * c[I_L])
        return dx
    if c[ELASTIC] > 0.0:
        on_motor += share * (c[K_G] * gear_stretch if gear_at > 0 else c[K_B] * bar_stretch)
    else:
        on_motor += share * (gear if gear_at > 0 else bar)
    if gear_at > 0:
        a_m, a_g = on_motor / c[I_M], on_gear / c[I_G]
        dx[1], dx[x.size - size + 1] = gear_rate, a_m - a_g
    else:
        a_m = a_g = (on_motor + on_gear) / (c[I_M] + c[I_G])
    dx[x.size - size] = a_m
    if free:
        dx[load_at], dx[x.size - size + load_at] = bar_rate, a_g - on_load / c[I_L]
    else:
        dx[size] = bar_rate
    return dx


@dataclass
class EffectJoint:
    """Three bodies with bristles, play, hardening, hysteresis, weight and contact, in plain Python.

    The state holds angles and speeds of motor, gear and load, three bristle deflections and the
    Bouc-Wen state. Bodies that are one mass add up their forces and inertias.

    Attributes:
        parameters: Symbols and values of the joint, SI.
        structure: One of the five structures.
        level: Dry friction of each body with bristles over its speed [N m].
        sigma: Stiffness of the bristles of each body, none where zero [N m/rad].
        sigma_1: Their damping [N m s/rad].
        gap: Play of gear spring, or of the bar where the gear is rigid [rad].
        k_3: Cubic stiffness of the bar [N m/rad^3].
        tau_h: Height of the Bouc-Wen loop [N m].
        delta_h: Its deflection [rad].
        weight: Weight times arm of the load [N m].
        contact: Stiffness, exponent, damping, position of what the load meets.
        mu: Friction of each body per torque of the first spring, smoothed over dq_0.
        dq_0: Width of that smoothing [rad/s].
    """

    parameters: Mapping[str, Any]
    structure: str
    level: tuple[Callable[[float], float], ...] = (float, float, float)
    sigma: tuple[float, float, float] = (0.0, 0.0, 0.0)
    sigma_1: float = 0.0
    gap: float = 0.0
    k_3: float = 0.0
    tau_h: float = 0.0
    delta_h: float = 1.0
    weight: float = 0.0
    contact: tuple[float, float, float, float] = (0.0, 1.0, 0.0, 0.0)
    mu: tuple[float, float, float] = (0.0, 0.0, 0.0)
    dq_0: float = 0.002

    def states(self, tau_m: ArrayLike, load: ArrayLike, dt: float, x0: ArrayLike) -> FloatArray:
        """Return states, bristles and Bouc-Wen state at every sample, shape (n, 10).

        Inputs are held over a sample; samples of equal input are integrated in one go.
        """
        torque, loads = np.asarray(tau_m, float), np.asarray(load, float)
        y = np.concatenate([np.asarray(x0, float), np.zeros(4)])
        out, k = np.empty((len(torque), 10)), 0
        while k < len(torque):
            end = k + 1
            while end < len(torque) and torque[end] == torque[k] and loads[end] == loads[k]:
                end += 1
            found = solve_ivp(
                self._slope,
                (0.0, (end - k) * dt),
                y,
                "DOP853",
                np.arange(end - k + 1) * dt,
                args=(torque[k], loads[k]),
                rtol=RTOL,
                atol=1e-13,
                max_step=dt,
            )
            out[k:end], y = found.y.T[:-1], found.y[:, -1]
            if COORDINATES[self.structure][2] < 0:
                out[k:end, 5] = loads[k]
            k = end
        return out

    def _spring(self, which: int, x: float, rate: float, zeta: float) -> tuple[float, float]:
        """Return the torque of a spring and the speed of its hysteresis."""
        p, first = self.parameters, COORDINATES[self.structure][0] != COORDINATES[self.structure][1]
        k, d = (p["k_g"], p["d_mg"]) if which == 0 else (p["k_b"], p["d_gl"])
        if self.gap > 0.0 and (which == 0) == first:
            if abs(x) <= 0.5 * self.gap:
                return 0.0, 0.0
            side = 1.0 if x > 0.0 else -1.0
            return side * max(0.0, side * (k * (x - side * 0.5 * self.gap) + d * rate)), 0.0
        torque, turn = k * x + d * rate, 0.0
        if which == 1:
            torque += self.k_3 * x**3 + self.tau_h * zeta
            turn = (rate - 0.5 * (abs(rate) * zeta + rate * abs(zeta))) / self.delta_h
        return torque, turn

    def _slope(self, t: float, y: FloatArray, tau_m: float, load: float) -> FloatArray:
        p, groups = self.parameters, COORDINATES[self.structure]
        q, v, z, dy = y[:3], y[3:6].copy(), y[6:9], np.zeros(10)
        if groups[2] < 0:
            v[2] = load
        force = np.array([tau_m, 0.0, load if groups[2] >= 0 else 0.0])
        transmitted = 0.0
        for which in (0, 1):
            if groups[which] != groups[which + 1]:
                pull, turn = self._spring(
                    which, q[which] - q[which + 1], v[which] - v[which + 1], y[9]
                )
                force[which] -= pull
                force[which + 1] += pull
                dy[9] += turn
                if which == 0 or groups[0] == groups[1]:
                    transmitted = pull
        for body, letter in enumerate("mgl"):
            speed = v[body]
            force[body] -= p[f"d_{letter}"] * speed
            force[body] -= self.mu[body] * abs(transmitted) * np.tanh(speed / self.dq_0)
            if self.sigma[body] > 0.0:
                g = self.level[body](speed)
                dz = speed - self.sigma[body] * abs(speed) * z[body] / g
                damping = self.sigma_1
                if damping * abs(speed) > 4.0 * g:
                    damping = 4.0 * g / abs(speed)
                force[body] -= self.sigma[body] * z[body] + damping * dz
                dy[6 + body] = dz
        force[2] -= self.weight * np.sin(q[2])
        stiffness, exponent, damping, position = self.contact
        depth = max(0.0, q[2] - position)
        force[2] -= stiffness * depth**exponent * max(0.0, 1.0 + damping * v[2])
        inertia = np.array([p["I_m"], p["I_g"], p["I_l"]])
        for body in range(3):
            group = [b for b in range(3) if groups[b] == groups[body] and groups[b] >= 0]
            if group:
                dy[3 + body] = force[group].sum() / inertia[group].sum()
        dy[:3] = v
        return dy
