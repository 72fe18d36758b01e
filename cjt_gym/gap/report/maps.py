"""Maps of the fitted record: friction over velocity, ripple over the angle, loops of the spring."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter

from cjt_gym.gap.evidence import FrictionMap, RippleSpectrum, SpringLoop
from cjt_gym.gap.judged.replay import Written
from cjt_gym.gap.recorded.fields import Fields
from cjt_gym.gap.recorded.setting import Setting
from cjt_gym.gap.recorded.signals import joint_torque, motor_torque, periodic_torque
from cjt_gym.gap.stages.cut import Stages
from cjt_gym.gap.stages.periodic import ripple_amplitudes
from cjt_gym.gap.stages.spring import spring_torque
from cjt_gym.joint import Joint
from cjt_gym.joint.kernel.arrays import Floats

WINDOW = 0.021
"""Time over which velocities and accelerations are smoothed [s]."""


def friction_maps(stages: Stages, before: Written, after: Written) -> tuple[FrictionMap, ...]:
    """Return the unexplained torques of motor and load over their velocities.

    Only the half of the samples in which the velocity changes least counts.
    """
    found = []
    for stage in ("motor", "load"):
        if stage not in stages.names or _transmitted(stages.setting, before.fields) is None:
            continue
        speed, calm, first = _lacking(stages, before.fields, stage)
        _, _, last = _lacking(stages, after.fields, stage)
        bodies = [b for b, g in enumerate(stages.chain(stage, before.fields).groups) if g >= 0]
        calm[: stages.setting.settle] = calm[-stages.setting.settle :] = False
        speed = speed[calm]
        at = _speeds(speed)
        load = float(np.mean(np.abs(_transmitted(stages.setting, before.fields))))  # type: ignore[arg-type]
        laws = [_friction(m.joint(stages.setting), bodies, at, load) for m in (before, after)]
        law = laws[1] - laws[0]
        found.append(FrictionMap(stage, speed, first[calm], last[calm], at, law))
    return tuple(found)


def _speeds(speed: Floats) -> Floats:
    """Return velocities at which a law is drawn, dense around zero, shape (201,)."""
    top = float(np.abs(speed).max())
    half = top * np.geomspace(1e-4, 1.0, 100)
    return np.concatenate([-half[::-1], [0.0], half])


def _transmitted(setting: Setting, fields: Fields) -> Floats | None:
    """Return the joint torque [N m], shape (N,); None if nothing determines it."""
    series = setting.series
    if not setting.has_spring:
        return np.zeros(len(series))
    if "tau" in series:
        return joint_torque(fields, series)
    if "q_l" in series or setting.structure.output_fixed:
        q_l = series.columns.get("q_l", 0.0)
        return spring_torque(fields, series["q_m"] - q_l - fields["q_0"], series.dt)
    return None


def _lacking(
    stages: Stages, fields: Fields, stage: str
) -> tuple[Floats, NDArray[np.bool_], Floats]:
    """Return velocity, whether it is nearly constant, and the resisting torque a model lacks.

    Each has the shape (N,). While the body accelerates, a small error of its inertia or of the
    acceleration, which is computed from an encoder, would mask the friction.
    """
    setting = stages.setting
    series, dt = setting.series, setting.series.dt
    q = series["q_l" if stage == "load" else "q_m"]
    transmitted = _transmitted(setting, fields)
    assert transmitted is not None
    if stage == "motor":
        torque = motor_torque(fields, series) - transmitted
        torque = torque + periodic_torque(fields, q, transmitted)
    else:
        torque = transmitted - fields["grav_a"] * np.cos(q) - fields["grav_b"] * np.sin(q)
        torque = torque + series.columns.get("tau_l", 0.0)
    friction = stages.predict(stage, fields).friction
    torque = torque + (friction.sum(axis=1) if friction.size else 0.0)
    groups = stages.chain(stage, fields).groups
    bodies = [b for b, g in zip("mgl", groups, strict=True) if g >= 0]
    inertia = sum(fields[f"I_{b}"] for b in bodies)
    damping = sum(fields[f"d_{b}"] for b in bodies)
    window = max(int(WINDOW / dt) // 2 * 2 + 1, 5)
    speed, acceleration = (savgol_filter(q, window, 3, deriv=d, delta=dt) for d in (1, 2))
    smooth = savgol_filter(torque, window, 3)
    size = np.abs(acceleration)
    return speed, size <= np.median(size), smooth - inertia * acceleration - damping * speed


def _friction(joint: Joint, bodies: Sequence[int], speed: Floats, load: float) -> Floats:
    """Return the friction of bodies that move at one velocity [N m], shape (M,).

    Args:
        joint: The joint.
        bodies: Their indices.
        speed: Their velocity [rad/s], shape (M,).
        load: Size of the transmitted torque [N m].
    """
    q, dq = np.zeros((2, len(speed), 3))
    dq[:, bodies] = speed[:, None]
    dry = joint.nonlinear_torque(q, q, load) - joint.nonlinear_torque(q, dq, load)
    record, _ = joint.packed()
    damping = sum(float(record[f"d_{'mgl'[b]}"][0]) for b in bodies)
    return np.asarray(dry[:, bodies].sum(axis=1) + damping * speed)


def ripple(
    stages: Stages, before: tuple[Fields, Floats], after: tuple[Fields, Floats]
) -> RippleSpectrum | None:
    """Return the torque that repeats with the motor's angle.

    Args:
        stages: The record.
        before: Fields of the nominal joint, and the motor's residual, shape (N,).
        after: The same for the explained joint.
    """
    cycles, first = ripple_amplitudes(stages, *before)
    _, last = ripple_amplitudes(stages, *after)
    return RippleSpectrum(cycles, first, last) if cycles.size else None


def spring_loop(stages: Stages, before: Fields, after: Fields) -> SpringLoop | None:
    """Return the torque of the spring over its deflection, as measured and by both models."""
    if "transmission" not in stages.names:
        return None
    setting = stages.setting
    models: list[tuple[Floats, Floats]] = [_bar(stages, fields) for fields in (before, after)]
    cut = slice(setting.settle, None)
    return SpringLoop(
        models[1][0][cut],
        setting.series["tau"][cut],
        models[0][1][cut],
        models[1][1][cut],
        before["k_b"],
    )


def _bar(stages: Stages, fields: Fields) -> tuple[Floats, Floats]:
    """Return the bar's deflection [rad] and the measured torque at that deflection [N m]."""
    series = stages.setting.series
    states = stages.predict("transmission", fields).states
    q_g = states[:, 0] if states.shape[1] else series["q_m"]
    x = q_g - series.columns.get("q_l", 0.0) - fields["q_0"]
    return x, fields["gain"] * spring_torque(fields, x, series.dt) + fields["tau_0"]
