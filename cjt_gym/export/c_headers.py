"""Whole torque controllers and observers as C headers, each with its memory in one struct."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from cjt_gym.baselines.observers import LinearObserver
from cjt_gym.export.c_law import NOTHING, CLaw
from cjt_gym.export.c_text import common_values, filled, identifier, number


def controller_header(
    law: CLaw, prefix: str, title: str, joint: str, gains: Mapping[str, float]
) -> str:
    """Return the text of the header."""
    adds, renders = law.addition is not NOTHING, law.stiffness > 0.0 or law.damping > 0.0
    back = adds and law.linear.g.any()
    impedance = {"STIFFNESS": number(law.stiffness), "DAMPING": number(law.damping)}
    values = {
        "GAINS": ", ".join(f"{key} = {value:.6g}" for key, value in gains.items()) or "none",
        "LIMIT": number(law.limit),
        "START": "reference" if law.follows else "tau",
        "RENDER": filled(RENDER, impedance) if renders else "",
        "ADDITION_STATE": law.addition.state,
        "ADDITION": law.addition.code,
        "AFTER": law.addition.after,
        "LOCAL": law.addition.local,
        "ADDED": "added" if adds else "0.0",
        "BACK": " - @NAME@_back[i] * added" if back else "",
        "REST_STATE": "  @REAL@ rest; /* load angle at the start */\n" if renders else "",
    }
    more = {"back": law.linear.g} if back else {}
    common = common_values(identifier(prefix), title, joint, law.linear, **more)
    return filled(CONTROLLER, values | common)


def observer_header(observer: LinearObserver, prefix: str, title: str, joint: str) -> str:
    """Return the text of the header."""
    name = identifier(prefix)
    places = [identifier(f"{name}_{one}".upper()) for one in observer.names]
    values = {"PLACES": ", ".join(places), "ESTIMATES": str(len(observer.names))}
    return filled(OBSERVER, values | common_values(name, title, joint, observer))


RENDER: Final = """\
  /* A spring and a damper at the load, about where it stood at the start. */
  if (!state->begun) state->rest = q_l;
  reference += @STIFFNESS@ * (state->rest - q_l) - @DAMPING@ * dq_l;
"""
CONTROLLER: Final = """\
/* Torque controller @TITLE@, written by cjt-gym @VERSION@.
 *
 * For: @JOINT@.
 * Gains: @GAINS@.
 * Call @NAME@_step once in every control step of @DT@ s. It returns the motor torque to command
 * [N m], within @NAME@_LIMIT, and updates its state with the limited torque. Angles,
 * velocities and torques are those at the output side of the gear. One state per joint; no memory
 * is allocated, nothing is shared. Numbers are double unless @REAL@ is defined as another type
 * before this is included.
 *
 *   @NAME@_state state;
 *   @NAME@_reset(&state);
 *   torque = @NAME@_step(&state, reference, @VALUES@);
 */
#ifndef @GUARD@
#define @GUARD@

#include <math.h>

#ifndef @REAL@
#define @REAL@ double
#endif
#define @NAME@_DT @DT@       /* control step [s] */
#define @NAME@_LIMIT @LIMIT@ /* largest motor torque [N m] */

@ARRAYS@

typedef struct {
  @REAL@ x[@STATES@];
@ADDITION_STATE@@REST_STATE@  int begun;
} @NAME@_state;

/* Forget the past: the first step takes the joint to have been at rest under its torque. */
static inline void @NAME@_reset(@NAME@_state *state) { state->begun = 0; }

/* The motor torque to command until the next step [N m].
 *
@MEANINGS@
 */
static inline @REAL@ @NAME@_step(@NAME@_state *state, @REAL@ reference,
                                 @PARAMETERS@) {
  const @REAL@ limit = @NAME@_LIMIT;
  @REAL@ next[@STATES@], command@LOCAL@;
  int i, j;
@ADDITION@@RENDER@  @REAL@ w[@COUNT@] = {reference, @VALUES@, 0.0};
  if (!state->begun) {
    const @REAL@ still[@COUNT@] = {@START@, @VALUES@, tau};
    for (i = 0; i < @ORDER@; i++)
      for (state->x[i] = 0.0, j = 0; j < @COUNT@; j++)
        state->x[i] += @NAME@_rest[i * @COUNT@ + j] * still[j];
    state->begun = 1;
  }
  command = @ADDED@;
  for (i = 0; i < @ORDER@; i++) command += @NAME@_c[i] * state->x[i];
  for (j = 0; j < @COUNT@; j++) command += @NAME@_d[j] * w[j];
  command = command > limit ? limit : command < -limit ? -limit : command;
  w[@COUNT@ - 1] = command;
@AFTER@  for (i = 0; i < @ORDER@; i++) {
    for (next[i] = 0.0, j = 0; j < @ORDER@; j++)
      next[i] += @NAME@_a[i * @ORDER@ + j] * state->x[j];
    for (j = 0; j < @COUNT@; j++) next[i] += @NAME@_b[i * @COUNT@ + j] * w[j];
  }
  for (i = 0; i < @ORDER@; i++) state->x[i] = next[i]@BACK@;
  return command;
}

#endif
"""
OBSERVER: Final = """\
/* Observer @TITLE@, written by cjt-gym @VERSION@.
 *
 * For: @JOINT@.
 * Call @NAME@_step once in every control step of @DT@ s with what is measured and with the motor
 * torque since the step before; it gives the estimates at this sample. Angles, velocities and
 * torques are those at the output side of the gear, in SI units. One state per joint; no memory is
 * allocated, nothing is shared. Numbers are double unless @REAL@ is defined as another type before
 * this is included.
 *
 *   @NAME@_state state;
 *   @REAL@ found[@NAME@_ESTIMATES];
 *   @NAME@_reset(&state);
 *   @NAME@_step(&state, command, @VALUES@, found);
 */
#ifndef @GUARD@
#define @GUARD@

#ifndef @REAL@
#define @REAL@ double
#endif
#define @NAME@_DT @DT@ /* control step [s] */
#define @NAME@_ESTIMATES @ESTIMATES@

/* Where each estimate stands in what @NAME@_step finds. */
enum { @PLACES@ };

@ARRAYS@

typedef struct {
  @REAL@ x[@STATES@], w[@COUNT@];
  int begun;
} @NAME@_state;

/* Forget the past: the first step takes the joint to have been at rest under its torque. */
static inline void @NAME@_reset(@NAME@_state *state) { state->begun = 0; }

static inline void @NAME@_step(@NAME@_state *state, @REAL@ command,
                               @PARAMETERS@, @REAL@ *found) {
  const @REAL@ seen[@COUNT@] = {0.0, @VALUES@, 0.0};
  @REAL@ next[@STATES@];
  int i, j;
  if (state->begun) {
    state->w[@COUNT@ - 1] = command;
    for (i = 0; i < @ORDER@; i++) {
      for (next[i] = 0.0, j = 0; j < @ORDER@; j++)
        next[i] += @NAME@_a[i * @ORDER@ + j] * state->x[j];
      for (j = 0; j < @COUNT@; j++) next[i] += @NAME@_b[i * @COUNT@ + j] * state->w[j];
    }
    for (i = 0; i < @ORDER@; i++) state->x[i] = next[i];
  } else {
    const @REAL@ still[@COUNT@] = {tau, @VALUES@, tau};
    for (i = 0; i < @ORDER@; i++)
      for (state->x[i] = 0.0, j = 0; j < @COUNT@; j++)
        state->x[i] += @NAME@_rest[i * @COUNT@ + j] * still[j];
    state->begun = 1;
  }
  for (j = 0; j < @COUNT@; j++) state->w[j] = seen[j];
  for (i = 0; i < @ESTIMATES@; i++) {
    for (found[i] = 0.0, j = 0; j < @ORDER@; j++)
      found[i] += @NAME@_c[i * @ORDER@ + j] * state->x[j];
    for (j = 0; j < @COUNT@; j++) found[i] += @NAME@_d[i * @COUNT@ + j] * seen[j];
  }
}

#endif
"""
