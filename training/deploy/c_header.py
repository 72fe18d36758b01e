"""A policy as a C header that needs nothing but the mathematics of the standard library."""

from __future__ import annotations

import re
from collections.abc import Mapping
from importlib.metadata import version
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cjt_gym.export.c_text import comment, identifier
from cjt_gym.training.config import BASE_GAINS
from cjt_gym.training.deploy.exported import Exported
from cjt_gym.training.deploy.layout import LIMIT, PER_SAMPLE

PER_LINE: Final = 8
ACTIVATIONS: Final = {
    "tanh": "tanhf(x)",
    "relu": "x > 0.0f ? x : 0.0f",
    "elu": "x > 0.0f ? x : expm1f(x)",
    "none": "x",
}


def c_header(policy: Exported, prefix: str = "policy") -> str:
    """Return the text of the header.

    Args:
        policy: What it computes.
        prefix: What its names begin with.
    """
    name = identifier(prefix, "policy")
    layout, network = policy.layout, policy.on_its_joint
    values = {
        "NAME": name,
        "GUARD": f"{name.upper()}_H",
        "TITLE": comment(policy.name),
        "VERSION": version("cjt-gym"),
        "JOINT": comment(", ".join(policy.trained_on)),
        "BASE": comment(_base(policy.config.env)),
        "DT": f"{layout.dt:g}",
        "COUNT": str(layout.preview + 1),
        "SIZE": str(layout.size),
        "HEAD": str(layout.head),
        "HISTORY": str(layout.history),
        "SIGNALS": str(PER_SAMPLE),
        "TORQUE": _float(layout.torque),
        "VELOCITY": _float(layout.velocity),
        "ACTION": _float(layout.action),
        "GEAR": repr(layout.n),
        "LIMIT": _float(LIMIT),
        "CLIP": _float(network.clip),
        "WIDTH": str(max(len(layer.bias) for layer in network.layers)),
        "ARRAYS": "\n".join(_arrays(policy, name)),
        "LAYERS": "\n".join(_layers(policy, name)),
    }
    return re.sub("@([A-Z]+)@", lambda found: values[found[1]], TEMPLATE)


def _base(env: Mapping[str, Any]) -> str:
    gains = ", ".join(f"{name} = {value}" for name, value in (env.get(BASE_GAINS) or {}).items())
    name = str(env.get("base_controller") or "none: it commands alone")
    return f"{name} with {gains}" if gains else name


def _arrays(policy: Exported, name: str) -> list[str]:
    network = policy.on_its_joint
    found = [_array(f"{name}_mean", network.mean), _array(f"{name}_scale", network.scale)]
    for k, layer in enumerate(network.layers):
        found.append(_array(f"{name}_weight_{k}", layer.weight.ravel()))
        found.append(_array(f"{name}_bias_{k}", layer.bias))
    return found


def _array(name: str, values: NDArray[np.float32]) -> str:
    texts = [_float(float(value)) for value in values]
    lines = [", ".join(texts[k : k + PER_LINE]) for k in range(0, len(texts), PER_LINE)]
    body = ",\n  ".join(lines)
    return f"static const float {name}[{len(texts)}] = {{\n  {body}}};"


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
/* Torque policy @TITLE@, written by cjt-gym @VERSION@.
 *
 * Trained on: @JOINT@.  Base controller: @BASE@.
 * Call @NAME@_step once in every control step of @DT@ s. It returns a motor torque [N m] that is to
 * be added to that of the base controller, if there is one. Angles and velocities are on the link
 * side. One state per joint; no memory is allocated and nothing is shared.
 *
 *   @NAME@_state state;
 *   @NAME@_reset(&state);
 *   torque = base + @NAME@_step(&state, reference, tau, q_m, dq_m, dq_l, command);
 */
#ifndef @GUARD@
#define @GUARD@

#include <math.h>

#define @NAME@_REFERENCES @COUNT@ /* reference now and at the next control steps */
#define @NAME@_OBSERVATION @SIZE@

@ARRAYS@

typedef struct {
  float observation[@SIZE@];
  int begun;
} @NAME@_state;

static inline float @NAME@_limit(float x, float most) {
  return x > most ? most : x < -most ? -most : x;
}

static inline void @NAME@_reset(@NAME@_state *state) { state->begun = 0; }

/* The action, -1 to 1, for an observation as the environment gives it. */
static inline float @NAME@_act(const float *observation) {
  float in[@SIZE@], a[@WIDTH@], b[@WIDTH@];
  int i, j;
  for (i = 0; i < @SIZE@; i++)
    in[i] = @NAME@_limit((observation[i] - @NAME@_mean[i]) * @NAME@_scale[i], @CLIP@);
  (void)b;
@LAYERS@
}

/* The motor torque [N m].
 *
 * reference: wanted joint torque now and at the next steps [N m], @COUNT@ of them
 * tau:       measured joint torque [N m]
 * q_m:       measured motor angle, rotor angle / n [rad]
 * dq_m:      measured motor velocity [rad/s]
 * dq_l:      measured load velocity [rad/s]
 * command:   motor torque that was commanded in the step before, 0 in the first [N m]
 */
static inline float @NAME@_step(@NAME@_state *state, const float *reference, float tau, double q_m,
                                float dq_m, float dq_l, float command) {
  float *out = state->observation, sample[@SIGNALS@];
  int i, k;
  for (i = 0; i < @COUNT@; i++) out[i] = @NAME@_limit(reference[i] / @TORQUE@, @LIMIT@);
  out[@COUNT@] = @NAME@_limit((reference[0] - tau) / @TORQUE@, @LIMIT@);
  out[@COUNT@ + 1] = (float)sin(@GEAR@ * q_m);
  out[@COUNT@ + 2] = (float)cos(@GEAR@ * q_m);
  sample[0] = @NAME@_limit(tau / @TORQUE@, @LIMIT@);
  sample[1] = @NAME@_limit(dq_m / @VELOCITY@, @LIMIT@);
  sample[2] = @NAME@_limit(dq_l / @VELOCITY@, @LIMIT@);
  sample[3] = @NAME@_limit(command / @TORQUE@, @LIMIT@);
  for (k = @HISTORY@ - 1; k >= 0; k--)
    for (i = 0; i < @SIGNALS@; i++)
      out[@HEAD@ + @SIGNALS@ * k + i] =
          k > 0 && state->begun ? out[@HEAD@ + @SIGNALS@ * (k - 1) + i] : sample[i];
  state->begun = 1;
  return @ACTION@ * @NAME@_act(out);
}

#endif
"""
