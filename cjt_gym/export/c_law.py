"""What a controller does, in the form that is written in C, with what some add to a linear law."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from cjt_gym.baselines import Controller, OpenLoop, PdFeedForward
from cjt_gym.baselines.adaptive_friction import LARGEST_SHARE, AdaptiveFriction
from cjt_gym.baselines.feedforward import SMOOTHING, KnownFriction, ReferenceVelocity
from cjt_gym.baselines.impedance import Impedance
from cjt_gym.baselines.linear_law import Addition as Added
from cjt_gym.baselines.linear_law import LinearController, LinearLaw, assemble, static
from cjt_gym.errors import ConfigurationError
from cjt_gym.export.c_text import filled, number


@dataclass(frozen=True)
class Addition:
    """Code that sets `added`, what is added to the command, with its fields and local variables.

    `state->begun` tells whether there is a past; `after` takes the command that was applied.
    """

    state: str
    local: str
    code: str
    after: str = ""


NOTHING = Addition("", "", "")


@dataclass(frozen=True)
class CLaw:
    """A linear law within a limit, with what may be added to it."""

    linear: LinearLaw  # the law
    limit: float  # largest motor torque [N m]
    # whether its memory begins as if the reference had long stood where it is, else as if it had
    # been the torque that is there
    follows: bool = False
    addition: Addition = NOTHING  # what is added to its command
    # of a spring that is rendered at the load by way of the reference [N m/rad]
    stiffness: float = 0.0
    damping: float = 0.0  # of a damper beside that [N m s/rad]


def law_of(controller: Controller, name: str) -> CLaw:
    """Return what a controller does; an error where C cannot do that."""
    limit = controller.torque_limit
    match controller:
        case OpenLoop():
            return CLaw(assemble(controller.dt, static(reference=1.0)), limit)
        case LinearController():
            added = addition_of(controller.addition)
            if added is not None:
                return CLaw(controller.law, limit, addition=added)
        case PdFeedForward():
            assert controller.linear is not None
            return CLaw(controller.linear, limit, follows=True)
        case Impedance():
            return CLaw(
                controller.inner,
                limit,
                stiffness=controller.stiffness,
                damping=controller.damping,
            )
    raise ConfigurationError(
        f"The controller {name} cannot be written in C: it learns series, solves programs while it "
        "runs, or is code of your own. Take a linear law, such as lqg, or one put together from "
        "parts, such as pid+reference+friction."
    )


def addition_of(added: Added | None) -> Addition | None:
    """Return what is added to a linear law; None where C cannot do that."""
    match added:
        case None:
            return NOTHING
        case KnownFriction():
            return known_friction(added)
        case AdaptiveFriction():
            return learnt_friction(added)
    return None


def known_friction(friction: KnownFriction) -> Addition:
    """Return the friction that a joint file names, at the velocity that the reference asks for."""
    values = {
        "SHARE": friction.share,
        "COULOMB": friction.coulomb,
        "VISCOUS": friction.viscous,
        "SMOOTHING": friction.smoothing,
    }
    code = filled(KNOWN, {key: number(value) for key, value in values.items()})
    return Addition(VELOCITY_STATE, ", added, velocity", _velocity(friction.velocity) + code)


def learnt_friction(law: AdaptiveFriction) -> Addition:
    """Return the friction whose level is learnt; see `cjt_gym.baselines.adaptive_friction`."""
    p, late = law.model.joint.parameters, law.model.loop.delay + 1
    values = {
        "MOTOR": p.I_m,
        "GEAR": p.get("I_g", 0.0),
        "INERTIA": law.model.inertia,
        "THRESHOLD": law.threshold,
        "GAIN": 2.0 * math.pi * law.rate_hz * law.dt,
        "DT": law.dt,
        "MOST": LARGEST_SHARE * law.torque_limit,
        "SHARE": law.share,
        "SMOOTHING": SMOOTHING,
    }
    texts = {key: number(value) for key, value in values.items()} | {"LATE": str(late)}
    state = VELOCITY_STATE + filled(LEARNT_STATE, texts)
    local = ", added, velocity, v, speed, change"
    code = filled(LEARNT, texts) + _velocity(law.velocity) + filled(LEVEL, texts)
    return Addition(state, local, code, "  state->applied = command;\n")


def _velocity(velocity: ReferenceVelocity) -> str:
    values = {
        "A": velocity.rate.a,
        "B": velocity.rate.b,
        "K": velocity.stiffness,
        "LOAD": velocity.share,
    }
    return filled(VELOCITY, {key: number(value) for key, value in values.items()})


VELOCITY_STATE: Final = """\
  @REAL@ reference, rate, load; /* of the velocity that the reference asks for */
"""
VELOCITY: Final = """\
  /* The velocity that the reference asks for. */
  if (!state->begun) {
    state->reference = reference;
    state->rate = 0.0;
    state->load = dq_l;
  } else {
    state->rate = @A@ * state->rate + @B@ * (reference - state->reference);
    state->reference = reference;
    state->load += @LOAD@ * (dq_l - state->load);
  }
  velocity = state->rate / @K@ + state->load;
"""
KNOWN: Final = """\
  added = @SHARE@ * (@COULOMB@ * tanh(velocity / @SMOOTHING@) + @VISCOUS@ * velocity);
"""
LEARNT_STATE: Final = """\
  @REAL@ level, speed, applied, sent[@LATE@]; /* of the friction that is learnt */
"""
LEARNT: Final = """\
  /* The level of friction, learnt while the motor moves. */
  v = (@MOTOR@ * dq_m + @GEAR@ * dq_g) / @INERTIA@;
  if (!state->begun) {
    state->level = 0.0;
    state->speed = v;
    for (i = 0; i < @LATE@; i++) state->sent[i] = tau;
  } else {
    for (i = @LATE@ - 1; i > 0; i--) state->sent[i] = state->sent[i - 1];
    state->sent[0] = state->applied;
    speed = fabs(state->speed);
    if (fabs(v) >= @THRESHOLD@ && speed >= @THRESHOLD@ && v * state->speed > 0.0) {
      change = (state->sent[@LATE@ - 1] - tau) * (v > 0.0 ? 1.0 : -1.0) - state->level;
      state->level += @GAIN@ * (change - @INERTIA@ * (fabs(v) - speed) / @DT@);
      if (state->level < 0.0) state->level = 0.0;
      if (state->level > @MOST@) state->level = @MOST@;
    }
    state->speed = v;
  }
"""
LEVEL: Final = """\
  added = @SHARE@ * state->level * tanh(velocity / @SMOOTHING@);
"""
