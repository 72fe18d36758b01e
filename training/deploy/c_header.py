"""A policy with its base controller as a C header that needs nothing but `math.h`."""

from __future__ import annotations

import re
from importlib.metadata import version
from typing import Final

from cjt_gym.envs.observation import CLIP, PAST, PRESENT, Layout, Observed
from cjt_gym.export.c_headers import controller_header
from cjt_gym.export.c_text import (
    VALUES,
    array,
    comment,
    identifier,
    meanings,
    number,
    parameters,
)
from cjt_gym.training.deploy.exported import Exported

ACTIVATIONS: Final = {
    "tanh": "tanhf(x)",
    "relu": "x > 0.0f ? x : 0.0f",
    "elu": "x > 0.0f ? x : expm1f(x)",
    "none": "x",
}


def c_header(policy: Exported, prefix: str = "policy") -> str:
    """Return the text of the header."""
    policy.check_whole("C", linear=False)
    name = identifier(prefix, "policy")
    layout, network, base = policy.layout, policy.on_its_joint, policy.base
    joint = ", ".join(policy.trained_on)
    own = "" if base is None else f"{name}_base"
    values = {
        "NAME": name,
        "GUARD": f"{name.upper()}_H",
        "TITLE": comment(policy.name),
        "VERSION": version("cjt-gym"),
        "JOINT": comment(joint),
        "BASE": comment("none, it commands alone" if base is None else base.name),
        "BASEHEADER": ""
        if base is None
        else controller_header(base.law, own, base.name, joint, base.gains),
        "BASESTATE": f"  {own}_state base;\n" if own else "",
        "BASERESET": f"  {own}_reset(&state->base);\n" if own else "",
        "BASESTEP": f"{own}_step(&state->base, reference[0], {VALUES})" if own else "0.0",
        "MEANINGS": meanings(policy.uses),
        "PARAMETERS": parameters("double"),
        "VALUES": VALUES,
        "MOST": number(policy.limit),
        "DT": f"{layout.dt:g}",
        "COUNT": str(layout.preview + 1),
        "SIZE": str(layout.size),
        "HEAD": str(layout.head),
        "HISTORY": str(layout.history),
        "PRESENT": str(PRESENT),
        "PAST": str(PAST),
        "OBSERVED": "\n".join(_observed(layout, name)),
        "FIELDS": str(PRESENT + PAST),
        "TORQUE": number(layout.torque),
        "ACTION": number(layout.action),
        "LIMIT": _float(CLIP),
        "CLIP": _float(network.clip),
        "WIDTH": str(max(len(layer.bias) for layer in network.layers)),
        "ARRAYS": "\n".join(_arrays(policy, name)),
        "LAYERS": "\n".join(_layers(policy, name)),
    }
    return re.sub("@([A-Z]+)@", lambda found: values[found[1]], TEMPLATE)


def _observed(layout: Layout, prefix: str) -> list[str]:
    made = {
        "error": "(reference[0] - tau)",
        "sine": f"sin({number(layout.n)} * q_m)",
        "cosine": f"cos({number(layout.n)} * q_m)",
        "command": "state->command",
    }
    rows = zip(Observed._fields, layout.divisors, strict=True)
    scaled = [f"(float)({made.get(name, name)} / {number(by)})" for name, by in rows]
    end = f"{_float(CLIP)});"
    return [f"  now[{k}] = {prefix}_limit({x}, {end}" for k, x in enumerate(scaled)]


def _arrays(policy: Exported, name: str) -> list[str]:
    network = policy.on_its_joint
    tables = {"mean": network.mean, "scale": network.scale}
    for k, layer in enumerate(network.layers):
        tables |= {f"weight_{k}": layer.weight, f"bias_{k}": layer.bias}
    return [array("float", f"{name}_{key}", table, _float) for key, table in tables.items()]


def _layers(policy: Exported, name: str) -> list[str]:
    lines, source, size = [], "in", policy.layout.size
    for k, layer in enumerate(policy.on_its_joint.layers):
        target, outputs = ("a", "b")[k % 2], len(layer.bias)
        lines += [
            f"  for (i = 0; i < {outputs}; i++) {{",
            f"    float x = {name}_bias_{k}[i];",
            f"    for (j = 0; j < {size}; j++)",
            f"      x += {name}_weight_{k}[i * {size} + j] * {source}[j];",
            f"    {target}[i] = {ACTIVATIONS[layer.activation]};",
            "  }",
        ]
        source, size = target, outputs
    return [*lines, f"  return {name}_limit({source}[0], 1.0f);"]


def _float(value: float) -> str:
    text = f"{value:.9g}"
    return (text if any(c in text for c in ".en") else f"{text}.0") + "f"


TEMPLATE: Final = """\
/* Torque controller @TITLE@, a trained policy, written by cjt-gym @VERSION@.
 *
 * Trained on: @JOINT@.  Base controller, inside: @BASE@.
 * Call @NAME@_step once in every control step of @DT@ s. It returns the motor torque to command
 * [N m], that of base controller and policy together, within @NAME@_LIMIT. Angles, velocities and
 * torques are those at the output side of the gear. One state per joint; no memory is allocated and
 * nothing is shared.
 *
 *   @NAME@_state state;
 *   double reference[@NAME@_REFERENCES]; // now and at the next control steps
 *   @NAME@_reset(&state);
 *   torque = @NAME@_step(&state, reference, @VALUES@);
 */
#ifndef @GUARD@
#define @GUARD@

#include <math.h>

@BASEHEADER@
#define @NAME@_REFERENCES @COUNT@ /* reference now and at the next control steps */
#define @NAME@_DT @DT@ /* control step [s] */
#define @NAME@_LIMIT @MOST@ /* largest motor torque [N m] */
#define @NAME@_OBSERVATION @SIZE@

@ARRAYS@

typedef struct {
@BASESTATE@  float observation[@SIZE@];
  double command; /* of the step before [N m]; overwrite it where the drive applied another one */
  int begun;
} @NAME@_state;

static inline float @NAME@_limit(float x, float most) {
  return x > most ? most : x < -most ? -most : x;
}

/* Forget the past: the next step is the first. */
static inline void @NAME@_reset(@NAME@_state *state) {
@BASERESET@  state->command = 0.0;
  state->begun = 0;
}

/* The action, -1 to 1, for an observation as the environment gives it. */
static inline float @NAME@_act(const float *observation) {
  float in[@SIZE@], a[@WIDTH@], b[@WIDTH@];
  int i, j;
  for (i = 0; i < @SIZE@; i++)
    in[i] = @NAME@_limit((observation[i] - @NAME@_mean[i]) * @NAME@_scale[i], @CLIP@);
  (void)b;
@LAYERS@
}

/* The motor torque to command until the next step [N m].
 *
@MEANINGS@
 */
static inline double @NAME@_step(@NAME@_state *state, const double *reference,
                                 @PARAMETERS@) {
  const double limit = @NAME@_LIMIT;
  float *out = state->observation, now[@FIELDS@];
  double torque = @BASESTEP@;
  int i, k;
  (void)q_g, (void)q_l, (void)dq_g;
  for (i = 0; i < @COUNT@; i++) out[i] = @NAME@_limit((float)(reference[i] / @TORQUE@), @LIMIT@);
@OBSERVED@
  for (i = 0; i < @PRESENT@; i++) out[@COUNT@ + i] = now[i];
  for (k = @HISTORY@ - 1; k >= 0; k--)
    for (i = 0; i < @PAST@; i++)
      out[@HEAD@ + @PAST@ * k + i] =
          k > 0 && state->begun ? out[@HEAD@ + @PAST@ * (k - 1) + i] : now[@PRESENT@ + i];
  state->begun = 1;
  torque += (double)@ACTION@ * @NAME@_act(out);
  state->command = torque > limit ? limit : torque < -limit ? -limit : torque;
  return state->command;
}

#endif
"""
