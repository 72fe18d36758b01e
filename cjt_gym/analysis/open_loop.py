"""The joint without a controller, linear: from any input to any output, its modes and its step.

Inputs are those of `Joint.state_space` with the motor torque, or in its place the motor current "i"
(tau_m = k i with k = k_t n), or the voltage "v" at the drive of the joint: with "static"
k (v - k dq_m) / r, and with "rl" and "dq" behind the inductance, too. Its parameters are
`Joint.actual`; no other effect is in it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cjt_gym.analysis.figures import step_figures
from cjt_gym.analysis.system import Complex, Floats, System
from cjt_gym.errors import ConfigurationError, check_name
from cjt_gym.joint import Joint, linear
from cjt_gym.joint.linear import (
    OUTPUTS,
    body_matrices,
    state_matrices,
    state_names,
    zero_order_hold,
)

if TYPE_CHECKING:
    import control

Matrices = tuple[Floats, Floats, Floats, Floats]
INPUTS = ("tau_m", "i", "v", "load")
EMF = {"static": 1.0, "rl": 1.0, "dq": 2.0 / 3.0}
"""Back-EMF over k dq_m of each drive with a voltage, as in `cjt_gym.joint.kernel.drives`."""
STILL = 1e-9
"""Share of the fastest pole below which a pole or zero counts as zero."""


@dataclass(frozen=True)
class Mode:
    """A pole, or a pair of them, or of zeros.

    Attributes:
        name: Of an oscillation by where its energy is: "resonance" with motor and gear on the
            torsion bar, "torsion-bar mode" with the load on it, "gearbox mode" in the gearbox. Of
            a real pole likewise: "drag" of moving masses, "relaxation" of springs, "electrical";
            "free motion" at zero. Of zeros: "anti-resonance" for a pair, "zero" otherwise.
        value: The one with imaginary part >= 0 [rad/s].
    """

    name: str
    value: complex

    @property
    def frequency(self) -> float:
        """Undamped frequency [Hz]."""
        return float(abs(self.value) / (2.0 * np.pi))

    @property
    def damping(self) -> float:
        """Damping ratio [-]; NaN at zero."""
        return float(-self.value.real / abs(self.value)) if self.value != 0.0 else float("nan")


@dataclass(frozen=True)
class Step:
    """The answer to a step of one unit.

    Attributes:
        t: Times [s], shape (samples,).
        y: Answer, shape (samples,).
        final: Where it ends. This and what follows is NaN where it ends nowhere, or at zero.
        rise_s: From 10 to 90 % of it [s].
        overshoot: Over it [-].
        settling_s: Until it stays within 5 % of it [s]; infinite where that is later than `t`.
    """

    t: Floats
    y: Floats
    final: float
    rise_s: float
    overshoot: float
    settling_s: float


def matrices(joint: Joint, input: str = "tau_m", output: str = "tau") -> Matrices:
    """Return A, B, C, D from one input to one output.

    Args:
        joint: The joint; its drive matters for the input "v".
        input: "tau_m" [N m], "i" [A], "v" [V], or "load": load torque [N m], or velocity [rad/s]
            where the output is fixed.
        output: One of q_m, q_g, q_l, dq_m, dq_g, dq_l, tau.

    Raises:
        UnknownNameError: There is no such input or output.
        ConfigurationError: A voltage is asked for with the drive "current", or the torque of a
            joint without torsion bar.
    """
    check_name("input", input, INPUTS)
    check_name("output", output, OUTPUTS)
    if output == "tau" and joint.structure == "rigid":
        raise ConfigurationError(
            "The structure rigid has no torsion bar, so no output tau. Ask for dq_m, or take "
            "another structure."
        )
    p, row = joint.actual, joint.structure_row
    a, b, c, d = state_matrices(p, row)
    if row.output_fixed and input != "load":  # the load's angle only answers to its velocity
        kept = [k for k in range(row.order) if k != row.size]
        a, b, c = a[np.ix_(kept, kept)], b[kept], c[:, kept]
    place = OUTPUTS.index(output)
    speed = c[OUTPUTS.index("dq_m")]
    c, column = c[place : place + 1], int(input == "load")
    b, d = b[:, column : column + 1], d[place : place + 1, column : column + 1]
    if input in ("tau_m", "load"):
        return a, b, c, d
    k = p.k_t * p.n
    if input == "i":
        return a, k * b, c, k * d
    if joint.drive not in EMF:
        raise ConfigurationError(
            f"A voltage needs a drive with a voltage ({', '.join(EMF)}), got {joint.drive}. Load "
            "the joint with one, or ask for the input i."
        )
    back = EMF[joint.drive] * k
    if joint.drive == "static":
        return a - (k * back / p.r) * b @ speed[None, :], (k / p.r) * b, c, (k / p.r) * d
    order = len(a)
    joined = np.zeros((order + 1, order + 1))
    joined[:order, :order], joined[:order, order:] = a, k * b
    joined[order, :order], joined[order, order] = -back / p.l_a * speed, -p.r / p.l_a
    into = np.zeros((order + 1, 1))
    into[order] = 1.0 / p.l_a
    return joined, into, np.hstack([c, k * d]), np.zeros((1, 1))


def system(
    joint: Joint, input: str = "tau_m", output: str = "tau", dt: float | None = None
) -> control.StateSpace:
    """Return the joint from one input to one output as a python-control system.

    Args:
        joint: The joint.
        input: See `matrices`.
        output: See `matrices`.
        dt: Sample time for an input that is held [s]; None for the continuous joint.

    Raises:
        UnknownNameError, ConfigurationError: As for `matrices`.
    """
    import control

    a, b, c, d = matrices(joint, input, output)
    names = _names(joint, input, len(a))
    labels = {"states": names, "inputs": [input], "outputs": [output]}
    if dt is None:
        return control.ss(a, b, c, d, **labels)
    return control.ss(*zero_order_hold(a, b, dt), c, d, dt, **labels)


def frequency_response(
    joint: Joint, f: Floats, input: str = "tau_m", output: str = "tau", dt: float | None = None
) -> Complex:
    """Return the frequency response from one input to one output, shape (frequencies,).

    Args:
        joint: The joint.
        f: Frequencies [Hz].
        input: See `matrices`.
        output: See `matrices`.
        dt: Sample time for an input that is held [s]; None for the continuous joint.

    Raises:
        UnknownNameError, ConfigurationError: As for `matrices`.
    """
    a, b, c, d = matrices(joint, input, output)
    s = 2j * np.pi * np.asarray(f, dtype=np.float64)
    if dt is not None:
        (a, b), s = zero_order_hold(a, b, dt), np.exp(s * dt)
    return linear.frequency_response(a, b, c, d, s)[:, 0, 0]


def poles(joint: Joint, input: str = "tau_m") -> tuple[Mode, ...]:
    """Return the poles with their names, the slowest first.

    Args:
        joint: The joint.
        input: See `matrices`; a voltage closes the loop of the back-EMF.

    Raises:
        UnknownNameError, ConfigurationError: As for `matrices`.
    """
    a, *_ = matrices(joint, input, "dq_m")
    values, vectors = np.linalg.eig(a)
    scale = float(np.abs(values).max())
    found = []
    for k in np.argsort(np.abs(values)):
        value = complex(values[k])
        if abs(value) <= STILL * scale:
            found.append(Mode("free motion", 0j))
        elif value.imag >= 0.0:
            states = dict(zip(_names(joint, input, len(a)), vectors[:, k], strict=True))
            found.append(Mode(_pole_name(joint, states, value.imag > 0.0), value))
    return tuple(found)


def _names(joint: Joint, input: str, order: int) -> list[str]:
    row = joint.structure_row
    names = [x for x in state_names(row) if not (row.output_fixed and x == "q_l")]
    return [*(names if input != "load" else state_names(row)), "i"][:order]


def _pole_name(joint: Joint, states: dict[str, complex], oscillates: bool) -> str:
    """Return the mode's name by where most of its energy is."""
    p, row = joint.actual, joint.structure_row
    first = {g: body for body, g in reversed(list(zip("mgl", row.groups, strict=True)))}
    still = {"q_held": 0j, "dq_held": 0j}
    at = {body: first.get(g, "held") if g >= 0 else "held"
          for body, g in zip("mgl", row.groups, strict=True)}  # fmt: skip
    q = [(states | still)[f"q_{at[body]}"] for body in "mgl"]
    dq = [(states | still)[f"dq_{at[body]}"] for body in "mgl"]
    inertia, _, stiffness = body_matrices(p, row)
    moving = np.diag(inertia) * np.abs(dq) ** 2
    gear = -stiffness[0, 1] * abs(q[0] - q[1]) ** 2
    bar = stiffness[2, 2] * abs(q[1] - q[2]) ** 2
    magnetic = p.get("l_a", 0.0) * abs(states.get("i", 0j)) ** 2
    if not oscillates:
        kinds = {"drag": moving.sum(), "relaxation": gear + bar, "electrical": magnetic}
        return max(kinds, key=lambda kind: float(kinds[kind]))
    if gear > bar:
        return "gearbox mode"
    return "torsion-bar mode" if moving[2] > moving[0] + moving[1] else "resonance"


def zeros(joint: Joint, input: str = "tau_m", output: str = "tau") -> tuple[Mode, ...]:
    """Return the zeros from one input to one output with their names, the slowest first.

    Raises:
        UnknownNameError, ConfigurationError: As for `matrices`.
    """
    from scipy.linalg import eigvals

    a, b, c, d = matrices(joint, input, output)
    order = len(a)
    pencil = np.zeros((order + 1, order + 1))
    scale_b, scale_c = float(np.abs(b).max()), float(np.abs(c).max())
    pencil[:order, :order], pencil[:order, order:] = a, b / scale_b
    pencil[order:, :order], pencil[order:, order:] = c / scale_c, d / scale_b / scale_c
    weight = np.diag([*np.ones(order), 0.0])
    values = eigvals(pencil, weight)
    scale = float(np.abs(np.linalg.eigvals(a)).max())
    values = values[np.isfinite(values) & (np.abs(values) < 1e4 * scale)]
    found = []
    for value in sorted(values[values.imag >= 0.0], key=abs):
        if abs(value) <= 1e-6 * scale:
            found.append(Mode("zero", 0j))
        else:
            pair = value.imag > 1e-9 * abs(value)
            found.append(Mode("anti-resonance" if pair else "zero", complex(value)))
    return tuple(found)


def step(
    joint: Joint,
    input: str = "tau_m",
    output: str = "tau",
    duration: float | None = None,
    samples: int = 4000,
) -> Step:
    """Return the answer to a unit step with its figures.

    Args:
        joint: The joint.
        input: See `matrices`.
        output: See `matrices`.
        duration: [s]; if absent, until the slowest oscillation or decay has died away, 10 s at
            most.
        samples: Number of samples.

    Raises:
        UnknownNameError, ConfigurationError: As for `matrices`.
    """
    a, b, c, d = matrices(joint, input, output)
    rates = -np.linalg.eigvals(a).real
    decays = rates[rates > STILL * np.abs(rates).max(initial=1e-300)]
    if duration is None:
        duration = float(min(10.0, 5.0 / decays.min())) if len(decays) else 1.0
    dt = duration / samples
    y = System(*zero_order_hold(a, b, dt), c, d, dt).step(samples)[:, 0]
    t = np.asarray(dt * np.arange(samples), dtype=np.float64)
    final, peak = float(y[-samples // 20 :].mean()), float(np.abs(y).max())
    endless = Step(t, y, math.nan, math.nan, math.nan, math.nan)
    if abs(y[-1] - y[-samples // 10]) > 0.02 * peak or abs(final) <= 1e-3 * peak:
        return endless
    if np.abs(np.linalg.eigvals(a)).min() > STILL * np.abs(np.linalg.eigvals(a)).max():
        final = float((d - c @ np.linalg.solve(a, b))[0, 0])
        if abs(final) <= 1e-3 * peak:
            return endless
    figures = step_figures(y / final, dt)
    return Step(t, y, final, figures["rise_s"], figures["overshoot"], figures["settling_s"])
