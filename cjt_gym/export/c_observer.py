"""An observer as a C header, with its memory in a struct."""

from __future__ import annotations

from typing import Final

from cjt_gym.baselines.observers import LinearObserver
from cjt_gym.export.c_text import common_values, filled, identifier


def observer_header(observer: LinearObserver, prefix: str, title: str, joint: str) -> str:
    """Return the text of the header."""
    name = identifier(prefix)
    tables = {
        "a": observer.a,
        "b": observer.b,
        "c": observer.c,
        "d": observer.d,
        "rest": observer.at_rest(),
    }
    places = [identifier(f"{name}_{one}".upper()) for one in observer.names]
    values = {"PLACES": ", ".join(places), "ESTIMATES": str(len(observer.names))}
    return filled(TEMPLATE, values | common_values(name, title, joint, observer.dt, tables))


TEMPLATE: Final = """\
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
