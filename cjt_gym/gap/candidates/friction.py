"""Candidates of the friction family."""

from __future__ import annotations

import numpy as np

from cjt_gym.gap.candidates.candidate import BODIES, Apply, Candidate, Scales, Values, most_damping
from cjt_gym.gap.candidates.nuisances import stages_of
from cjt_gym.gap.candidates.number import Number, Starts
from cjt_gym.gap.recorded.fields import Fields
from cjt_gym.gap.recorded.setting import Setting
from cjt_gym.joint.effects.motor import DQ_0

SHARP = 0.03
"""Share of the typical speed over which the sign of dry friction may be smoothed in any case."""


def friction_rows(setting: Setting, size: Scales) -> list[Candidate]:
    """Return the laws of friction of the motor side."""
    bodies = "mg" if setting.has_gear else "m"
    return [row for body in bodies for row in friction_of(setting, size, body)]


def _widest(speed: float) -> float:
    """Return the largest velocity over which the sign of dry friction may be smoothed [rad/s].

    It is that of the effect table, in the unit of the axis, which speaks of the output of a joint;
    the friction of a much faster shaft is dry, too, if its sign is sharp in most of the motion.
    """
    return max(SHARP * speed, min(DQ_0.high, 3.0 * speed))


def friction_of(setting: Setting, size: Scales, body: str) -> list[Candidate]:
    """Return the laws of friction of one body, by its letter."""
    torque, speed = size.torque, size.speed
    p, n = f"d_c{body}", f"d_c{body}_n"
    force = Number(p, "N m", 0.0, torque, low=0.0)
    force_n = Number(n, "N m", 0.0, torque, low=0.0)
    rise = Number("d_s", "N m", 0.0, torque, low=0.0)  # of breakaway above the Coulomb level
    slow, fast = 1e-4 * speed, 20.0 * speed
    stribeck = Number("v_s", "rad/s", 0.1 * speed, 1.2, True, slow, fast, shape=True)
    slide = Number("z_s", "rad", 1e-3, 2.0, log=True, low=1e-6, high=0.3, shape=True)
    mu = Number("mu", "-", 0.0, 0.2, low=0.0, high=1.0)
    most = most_damping(setting, body)
    d_p = Number(f"d_{body}", "N m s/rad", 0.0, torque / speed, high=most)
    d_n = Number(f"d_{body}_n", "N m s/rad", 0.0, torque / speed, high=most)
    guess = 0.05 * torque
    travel = max(float(np.std(setting.series["q_m"])), 1e-9)

    widest = _widest(speed)
    smooth = Number(
        "dq_0", "rad/s", widest / 30.0, 1.5, True, 1e-4 * min(speed, widest), widest, shape=True
    )

    def row(
        name: str, unknowns: tuple[Number, ...], apply: Apply, starts: Starts, variant: str = ""
    ) -> Candidate:
        return Candidate(
            name,
            "load" if body == "l" else "motor",
            unknowns,
            apply,
            stages_of(setting, f"c_p_{body}"),
            body=BODIES[body],
            starts=starts,
            family="friction",
            variant=variant,
        )

    def add(f: Fields, **values: float) -> None:
        for key, value in values.items():
            f[f"{key}_{body}"] += value

    def apply_stribeck(f: Fields, v: Values) -> None:
        add(f, c_p=v[p], c_n=v[p], s_p=v["d_s"], s_n=v["d_s"])
        f[f"v_s_{body}"] = v["v_s"]

    def apply_presliding(f: Fields, v: Values) -> None:
        add(f, c_p=v[p], c_n=v[p])
        f[f"z_s_{body}"] = v["z_s"]

    name_c = "load_coulomb" if body == "l" else "coulomb"
    rows = [row(name_c, (force,), lambda f, v: add(f, c_p=v[p], c_n=v[p]), ((guess,),))]

    def apply_smooth(f: Fields, v: Values) -> None:
        add(f, c_p=v[p], c_n=v[p])
        f[f"dq_0_{body}"] = v["dq_0"]

    smooth_starts = tuple((guess, x * widest) for x in (0.01, 0.1, 0.8))
    if body != "l":
        rows.append(row(name_c, (force, smooth), apply_smooth, smooth_starts, "smooth"))
    rows += [
        row(
            "coulomb_asym",
            (force, force_n),
            lambda f, v: add(f, c_p=v[p], c_n=v[n]),
            ((guess, guess),),
        ),
        row(
            "stribeck",
            (force, rise, stribeck),
            apply_stribeck,
            tuple((guess, 0.6 * guess, x * speed) for x in (0.03, 0.15, 0.6)),
        ),
        row(
            "presliding",
            (force, slide),
            apply_presliding,
            tuple((guess, x * travel) for x in (0.003, 0.02, 0.12, 0.5)),
        ),
        row(
            "viscous_asym",
            (d_p, d_n),
            lambda f, v: add(f, d_p=v[f"d_{body}"], d_n=v[f"d_{body}_n"]),
            ((0.0, 0.0),),
        ),
    ]
    if body != "l":
        rows.append(row("load_friction", (mu,), lambda f, v: add(f, mu=v["mu"]), ((0.05,),)))
    return rows


def damping_of(setting: Setting, size: Scales, body: str) -> Candidate:
    """Return the viscous friction of one body, by its letter, beyond its tolerance."""
    touches = stages_of(setting, f"d_{body}")
    unit = setting.joint.parameters.unit(f"d_{body}")
    typical = size.torque / size.speed
    start = setting.nominal[f"d_{body}"]
    if body == "m" and not setting.has_gear:
        start += setting.nominal["d_g"]
        start += 0.0 if setting.has_spring else setting.nominal["d_l"]
    most = most_damping(setting, body)
    total = Number(f"d_{body}", unit, start, typical, low=0.0, high=start + most)

    def apply(f: Fields, v: Values) -> None:
        f[f"d_{body}"] += v[f"d_{body}"] - start

    return Candidate(
        "damping",
        touches[0],
        (total,),
        apply,
        touches,
        body=BODIES[body],
        starts=((start,),),
        family="nominal",
        releases=f"d_{body}",
    )
