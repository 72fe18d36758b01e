"""Parts that any torque controller can be put together from; see `cjt_gym.baselines.compose`.

Feedback of the torque error e = r - tau or of the motor's motion, feed-forward, and observers of
what disturbs the motor. Each adds its output to the command.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from cjt_gym.baselines.entry import FIXED, SPRUNG, Gain, Gains
from cjt_gym.baselines.feedforward import SHARE, SMOOTHING, KnownFriction
from cjt_gym.baselines.linear_law import Block, static, through, total
from cjt_gym.baselines.linear_row import MakeAddition
from cjt_gym.baselines.observers.disturbance import disturbance_observer
from cjt_gym.baselines.observers.extended_state import designed
from cjt_gym.baselines.observers.momentum import momentum_observer
from cjt_gym.baselines.pid import DOB_HZ, KD, KI, KP, LEAD, damper, damping_gains, pid
from cjt_gym.baselines.plant_model import SampledJoint
from cjt_gym.baselines.rational import (
    Rational,
    delayed,
    held_low_pass,
    inverse_times,
    low_pass,
    tustin,
)

FEEDBACK, FORWARD, OBSERVER = "feedback", "feed-forward", "disturbance observer"
Tries = Mapping[str, Sequence[float]]


@dataclass(frozen=True)
class Part:
    """What a controller can be put together from."""

    name: str
    kind: str  # one of `FEEDBACK`, `FORWARD`, `OBSERVER`; a controller has one observer at most
    summary: str  # what it adds to the command
    # its gains. A gain `ki` is that of an integral of e, which the controller adds
    tunable: tuple[Gain, ...]
    block: Callable[[SampledJoint, Gains], Block]  # makes it for a sampled joint and gains
    # values of its gains from which defaults are chosen; others have usual values
    tries: Callable[[SampledJoint], Tries] = lambda model: {}
    structures: tuple[str, ...] = SPRUNG  # the structures that it holds for
    # makes what it adds beside its block, where that is no linear law
    addition: MakeAddition | None = None


def _pid(model: SampledJoint, gains: Gains) -> Block:
    kp, kd, lead = (gains.get(name, 0.0) for name in ("kp", "kd", "lead"))
    return pid(kp, 0.0, kd, model.dt, lead)


def _pid_tries(*names: str) -> Callable[[SampledJoint], Tries]:
    def tries(model: SampledJoint) -> Tries:
        every = {
            "kp": (0.03, 0.1, 0.3, 0.6, 1.0, 1.5),
            "ki": (0.5, 2.0, 5.0, 10.0, 20.0, 40.0, 80.0),
            "kd": damping_gains(model, (0.0, 0.1, 0.2, 0.4)),
        }
        return {name: every[name] for name in names}

    return tries


def position_block(model: SampledJoint, gains: Gains) -> Block:
    """Return k_q (q_l + r / k - q_m) + d_q (dq_l - dq_m), k being the joint's own stiffness."""
    k, d = gains["position_kp"], gains["position_kd"]
    return static(reference=k / model.stiffness, q_m=-k, q_l=k, dq_m=-d, dq_l=d)


def _position_tries(model: SampledJoint) -> Tries:
    stiffness = [share * model.stiffness for share in (0.03, 0.1, 0.3, 0.6)]
    return {"position_kp": stiffness, "position_kd": damper(model, (0.0, 0.1, 0.2, 0.4))}


def passivity_block(model: SampledJoint, gains: Gains) -> Block:
    """Return the law of B / B_d [-] and D_s [N m s/rad]; see `cjt_gym.baselines.passivity`."""
    shaping, share = gains["shaping"], gains["shaping"] * gains["damping"]
    return static(reference=shaping, tau=1.0 - shaping, dq_m=-share, dq_l=share)


def _passivity_tries(model: SampledJoint) -> Tries:
    return {
        "shaping": (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0),
        "damping": damper(model, (0.0, 0.03, 0.1, 0.2, 0.3, 0.5)),
    }


def _observer_tries(name: str) -> Callable[[SampledJoint], Tries]:
    return lambda model: {name: (0.2, 2.0, 5.0, 10.0, 20.0, 40.0)}


@lru_cache(maxsize=64)
def inner_observer(model: SampledJoint, cutoff_hz: float) -> Block:
    """Return the block of -d; see `cjt_gym.baselines.pid_inner_dob`."""
    return disturbance_observer(model, cutoff_hz).block(disturbance=-1.0)


@lru_cache(maxsize=64)
def mass_observer(model: SampledJoint, cutoff_hz: float) -> Block:
    """Return the block of f; see `cjt_gym.baselines.mass_dob`."""
    p, dt, inertia = model.joint.parameters, model.dt, model.inertia
    damping = p.get("d_m", 0.0) + p.get("d_g", 0.0)
    low = low_pass(2, cutoff_hz)
    # A mass without friction has a pole at 0, which stands among the zeros of its inverse.
    mass = Rational(np.zeros(0, complex), np.array([-damping / inertia + 0j]), 1.0 / inertia)
    inverse = tustin(inverse_times(mass, low, "the motor's mass"), dt)
    seen, late = tustin(low, dt), delayed(held_low_pass(2, cutoff_hz, dt), model.loop.delay)
    return total(
        [
            through(late, command=1.0),
            through(seen, -1.0, tau=1.0),
            through(inverse, -1.0, dq_m=1.0),
        ]
    )


ROWS = (
    Part("p", FEEDBACK, "kp e", (KP,), _pid, _pid_tries("kp")),
    Part("i", FEEDBACK, "ki integral of e", (KI,), _pid, _pid_tries("ki"), FIXED),
    Part("pi", FEEDBACK, "p and i", (KP, KI), _pid, _pid_tries("kp", "ki"), FIXED),
    Part("pd", FEEDBACK, "p and kd F e or -kd F tau", (KP, KD, LEAD), _pid, _pid_tries("kp", "kd")),
    Part(
        "pid",
        FEEDBACK,
        "pd and i",
        (KP, KI, KD, LEAD),
        _pid,
        _pid_tries("kp", "ki", "kd"),
        FIXED,
    ),
    Part(
        "position_pd",
        FEEDBACK,
        "PD of the motor about the angle at which the spring has the torque",
        (
            Gain("position_kp", "N m/rad", 0.0, 1e5),
            Gain("position_kd", "N m s/rad", 0.0, 1000.0),
        ),
        position_block,
        _position_tries,
    ),
    Part(
        "passivity",
        FEEDBACK,
        "r, with the motor's inertia scaled down by shaping and a damper beside the spring",
        (Gain("shaping", "-", 1.0, 10.0), Gain("damping", "N m s/rad", 0.0, 1000.0)),
        passivity_block,
        _passivity_tries,
    ),
    Part(
        "damping",
        FEEDBACK,
        "a damper beside the spring, - damping (dq_m - dq_l)",
        (Gain("damping", "N m s/rad", 0.0, 1000.0),),
        lambda model, gains: static(dq_m=-gains["damping"], dq_l=gains["damping"]),
        lambda model: {"damping": damper(model, (0.0, 0.1, 0.2, 0.4))},
    ),
    Part("reference", FORWARD, "r", (), lambda model, gains: static(reference=1.0)),
    Part("torque", FORWARD, "tau, which compensates the spring", (), lambda m, g: static(tau=1.0)),
    Part(
        "friction",
        FORWARD,
        "known friction along the reference",
        (
            Gain("share", "-", 0.0, 1.5, usual=SHARE),
            Gain("smoothing", "rad/s", 1e-4, 1.0, log=True, usual=SMOOTHING),
        ),
        lambda model, gains: static(),
        addition=lambda model, gains, law, limit: KnownFriction(
            model.joint, model.dt, gains["share"], gains["smoothing"]
        ),
    ),
    Part(
        "inner_dob",
        OBSERVER,
        "from the inverse of the joint and the torque",
        (DOB_HZ,),
        lambda m, g: inner_observer(m, g["dob_hz"]),
        _observer_tries("dob_hz"),
        FIXED,
    ),
    Part(
        "mass_dob",
        OBSERVER,
        "from the inverse of the motor's mass and its velocity",
        (DOB_HZ,),
        lambda m, g: mass_observer(m, g["dob_hz"]),
        _observer_tries("dob_hz"),
    ),
    Part(
        "momentum_dob",
        OBSERVER,
        "from the motor's momentum",
        (Gain("bandwidth_hz", "Hz", 0.001, 200.0, log=True),),
        lambda m, g: momentum_observer(m, g["bandwidth_hz"]).block(disturbance=1.0),
        _observer_tries("bandwidth_hz"),
    ),
    Part(
        "extended_dob",
        OBSERVER,
        "from an extended-state observer of the torque",
        (Gain("observer_hz", "Hz", 0.1, 250.0, log=True),),
        lambda m, g: designed(m, g["observer_hz"]).block(disturbance=-1.0),
        _observer_tries("observer_hz"),
        FIXED,
    ),
)
PARTS = {part.name: part for part in ROWS}
