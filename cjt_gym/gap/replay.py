"""Open-loop replay: the whole joint, driven by the recorded command alone.

The predictors of the stages lean on measurements at every sample; a replay does not, which is why
it shows how far simulation and record are apart, and why it is not used to find the cause.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter, savgol_filter

from cjt_gym.gap.chain import GEAR, LOAD, MOTOR, Chain, Link, build_chain
from cjt_gym.gap.fields import Fields, friction_law
from cjt_gym.gap.kernel import LOADED, friction_torque
from cjt_gym.gap.setting import Setting
from cjt_gym.gap.signals import LEAST_TORQUE, commanded_current, interval_mean, shifted
from cjt_gym.gap.spring import yielding
from cjt_gym.joint.compiled import compiled

Floats = NDArray[np.float64]
SUBSTEP = 2.5e-4
SMOOTH = 11
"""Samples over which a prescribed angle of the load is smoothed."""
CONSTANTS = (
    "k_b", "d_gl", "hard", "play", "hyst", "hyst_z", "hyst_n", "k_g", "d_mg", "play_g",
    "cog_f", "cog_a", "cog_b", "rip_f", "rip_a", "rip_b", "grav_a", "grav_b", "q_0", "pull_g",
)  # fmt: skip
(K_B, D_GL, HARD, PLAY, HYST, HYST_Z, HYST_N, K_G, D_MG, PLAY_G,
 COG_F, COG_A, COG_B, RIP_F, RIP_A, RIP_B, GRAV_A, GRAV_B, Q_0, PULL_G) = range(20)  # fmt: skip


def replay(setting: Setting, fields: Fields) -> dict[str, Floats]:
    """Return the channels that the model gives for the recorded command, each of shape (N,).

    Channels are q_m, q_l, dq_m and, where there is a spring, tau.
    """
    series = setting.series
    count = max(int(np.ceil(series.dt / SUBSTEP)), 1)
    chain = _whole(setting, fields, series.dt / count)
    current = _current(setting, fields)
    torque = fields["n"] * fields["k_t"] * current
    if fields["derate"] != 0.0:
        a = np.exp(-series.dt / fields["heat"])
        warm = lfilter([0.0, 1.0 - a], [1.0, -a], current**2)
        torque *= np.maximum(1.0 - fields["derate"] * warm, LEAST_TORQUE)
    torque = torque + fields["offset"]
    q_l = series["q_l"] if "q_l" in series else np.zeros(len(series))
    if len(q_l) > SMOOTH and np.ptp(q_l) > 0.0:
        q_l = savgol_filter(q_l, SMOOTH, 3)  # a stiff spring would make torque of its noise
    out = _simulate(
        np.ascontiguousarray(chain.a),
        np.ascontiguousarray(chain.torque),
        chain.start,
        chain.slope,
        np.array(chain.groups),
        _first_state(setting, fields, chain),
        torque,
        q_l,
        series["tau_l"] if "tau_l" in series else np.zeros(len(series)),
        np.array([fields[name] for name in CONSTANTS]),
        np.stack([friction_law(fields, body) for body in "mgl"]),
        setting.has_spring,
        setting.has_gear,
        count,
        series.dt / count,
    )
    channels = {"q_m": out[:, 0], "q_l": out[:, 1], "dq_m": out[:, 2]}
    if setting.has_spring:
        tau = fields["gain"] * out[:, 3] + fields["tau_0"]
        channels["tau"] = shifted(tau, -fields["late"] / series.dt)
    return channels


def _current(setting: Setting, fields: Fields) -> Floats:
    series = setting.series
    if "i_cmd" in series:
        return interval_mean(commanded_current(fields, series), fields["w_i"])
    return interval_mean(series["i"] - fields["i_0"], fields["w_i"])


def _whole(setting: Setting, fields: Fields, dt: float) -> Chain:
    inertia = [fields[f] for f in ("I_m", "I_g", "I_l")]
    damping = [fields[f] for f in ("d_m", "d_g", "d_l")]
    groups = setting.structure.groups
    links = []
    if setting.has_gear:
        links.append(Link(MOTOR, GEAR, fields["k_g"], fields["d_mg"]))
    if setting.has_spring:
        other = LOAD if groups[2] >= 0 else None
        links.append(Link(GEAR, other, fields["k_b"], fields["d_gl"]))
    return build_chain(groups, inertia, damping, links, dt)


def _first_state(setting: Setting, fields: Fields, chain: Chain) -> Floats:
    series, size = setting.series, chain.size
    x = np.zeros(2 * size)
    speed = series.first_speed("q_m")
    x[size:] = speed
    x[chain.groups[MOTOR]] = q = series["q_m"][0]
    tau = float(np.mean(series["tau"][:5])) - fields["tau_0"] if "tau" in series else 0.0
    if setting.has_gear:
        x[chain.groups[GEAR]] = q = q - tau / fields["k_g"] - fields["centre_g"]
    if setting.has_spring and chain.groups[LOAD] >= 0:
        # The bar's coordinate is q_g - q_l with its relaxed deflection q_0 taken off the load.
        x[chain.groups[LOAD]] = q - tau / fields["k_b"]
    return x


@compiled
def _bar(c: Floats, x: float, v: float, z: float) -> float:
    """Return the torque of the bar [N m] at a deflection, its rate and its hysteresis' state."""
    half = 0.5 * c[PLAY]
    if half > 0.0:
        x = x - min(max(x, -half), half)
    return float(c[K_B] * x * (1.0 + c[HARD] * x * x) + c[D_GL] * v + c[HYST] * z)


@compiled
def _remember(c: Floats, z: float, move: float) -> float:
    """Return the hysteresis' state after a move of the deflection."""
    if c[HYST] == 0.0:
        return 0.0
    if c[HYST_N] == 0.0:
        return float(min(max(z + move / c[HYST_Z], -1.0), 1.0))
    step = move / c[HYST_Z]
    middle = z + 0.5 * yielding(z, step, c[HYST_N])
    return float(z + yielding(middle, step, c[HYST_N]))


@compiled
def _simulate(
    a: Floats,
    g: Floats,
    begin: Floats,
    slope: Floats,
    groups: NDArray[np.int64],
    x0: Floats,
    torque: Floats,
    q_l: Floats,
    tau_l: Floats,
    c: Floats,
    laws: Floats,
    spring: bool,
    gear: bool,
    count: int,
    h: float,
) -> Floats:
    """Return q_m, q_l, dq_m and tau at the samples, shape (N, 4)."""
    n, size = a.shape[0], torque.size
    half = n // 2
    out = np.zeros((size, 4))
    x, new, push = x0.copy(), np.zeros(n), np.zeros(3)
    free_load = groups[2] >= 0
    bristle, z = np.zeros(3), 0.0
    m, r = groups[0], groups[1]
    last = 0.0
    for t in range(size):
        rate = (q_l[min(t + 1, size - 1)] - q_l[t]) / (count * h)
        for k in range(count):
            there = x[groups[2]] if free_load else q_l[t] + rate * k * h + c[Q_0]
            speed = x[half + groups[2]] if free_load else rate
            deflection, velocity = x[r] - there, x[half + r] - speed
            if t == 0 and k == 0:
                last = deflection
            z = _remember(c, z, deflection - last)
            last = deflection
            tau = _bar(c, deflection, velocity, z) if spring else 0.0
            if k == 0:
                out[t, 0], out[t, 2], out[t, 3] = x[m], x[half + m], tau
                out[t, 1] = there - c[Q_0]
            extra = tau - c[K_B] * deflection - c[D_GL] * velocity if spring else 0.0
            transmitted = tau
            excess = 0.0
            if gear:
                twist, twisting = x[m] - x[r], x[half + m] - x[half + r]
                transmitted = c[K_G] * twist + c[D_MG] * twisting
                if c[PLAY_G] > 0.0:
                    loose = 0.5 * c[PLAY_G]
                    side = 1.0 if twist > 0.0 else -1.0
                    excess = c[K_G] * loose * side
                    parting = side * (transmitted - excess) < 0.0 and c[PULL_G] == 0.0
                    if abs(twist) <= loose or parting:
                        excess = transmitted
                    transmitted -= excess
            q = x[m]
            push[0] = torque[t] + excess
            push[0] += c[COG_A] * np.cos(c[COG_F] * q) + c[COG_B] * np.sin(c[COG_F] * q)
            push[0] += transmitted * (
                c[RIP_A] * np.cos(c[RIP_F] * q) + c[RIP_B] * np.sin(c[RIP_F] * q)
            )
            push[1] = -excess - extra
            push[2] = 0.0
            if free_load:
                push[2] = tau_l[t] + extra
                q = x[groups[2]] - c[Q_0]
                push[2] -= c[GRAV_A] * np.cos(q) + c[GRAV_B] * np.sin(q)
            for i in range(n):
                value = 0.0
                for b in range(3):
                    value += g[i, b] * push[b]
                for j in range(n):
                    value += a[i, j] * x[j]
                if not free_load:
                    value += begin[i] * there + slope[i] * rate
                new[i] = value
            for b in range(3):
                if groups[b] < 0 or not laws[b].any():
                    continue
                row = half + groups[b]
                load = laws[b, LOADED] * abs(tau)
                lam, spring_back, lost = friction_torque(
                    laws[b], x[row], new[row], g[row, b], load, h, bristle[b]
                )
                for i in range(n):
                    new[i] += g[i, b] * lam
                new[row - half] += lost
                bristle[b] = spring_back
            for i in range(n):
                x[i] = new[i]
    return out
