"""The candidates: one row per effect that may explain a gap.

A row says which numbers the effect has, where a fit may start, and how it changes the model.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from cjt_gym.gap.fields import Fields
from cjt_gym.gap.nuisances import active_parameters, stages_of
from cjt_gym.gap.setting import Setting
from cjt_gym.gap.unknowns import Unknown

HYSTERESES = {"Bouc-Wen": 2.0, "Dahl": 1.0, "Maxwell slip": 0.0}
Values = Mapping[str, float]
Apply = Callable[[Fields, Values], None]
BODIES = {"m": "motor", "g": "gear", "l": "load"}
FRICTION = ("coulomb", "coulomb_asym", "stribeck", "presliding", "load_friction", "viscous_asym")


@dataclass(frozen=True)
class Hypothesis:
    """One effect that may explain a gap.

    Attributes:
        name: Name in the effect table.
        stage: Where the table says that it shows itself.
        unknowns: Its numbers.
        apply: Changes the fields of a model by its values.
        touches: Stages that it changes.
        body: motor, gear or load, where that is a choice.
        channel: Channel, where that is a choice.
        starts: Values of the unknowns at which a fit starts, each of their length.
        family: Effects that are compared among each other when one of them leads.
        releases: Field of the datasheet that it sets free, where it does only that.
        search: Kind of periodic torque whose frequency is searched in the residual, if any.
        variant: Which of several laws of the same effect.
    """

    name: str
    stage: str
    unknowns: tuple[Unknown, ...]
    apply: Apply
    touches: tuple[str, ...]
    body: str | None = None
    channel: str | None = None
    starts: tuple[tuple[float, ...], ...] = ()
    family: str = ""
    releases: str | None = None
    search: str | None = None
    variant: str = ""

    @property
    def strained(self) -> bool:
        """Whether a model without it could take its place by straining the datasheet."""
        return self.releases is not None or self.name in ("torque_gain", "torque_bias")

    @property
    def key(self) -> tuple[str, str | None, str | None, str]:
        """What tells it from the others."""
        return (self.name, self.body, self.channel, self.variant)


@dataclass(frozen=True)
class Scales:
    """Typical sizes in a record, from which starting points are taken.

    Attributes:
        torque: Of the motor [N m].
        speed: Of the motor [rad/s].
        deflection: Of the spring [rad].
        current: [A].
    """

    torque: float
    speed: float
    deflection: float
    current: float
    duration: float = field(default=10.0)


def scales(setting: Setting) -> Scales:
    """Return the typical sizes of a record."""
    s = setting.series
    drive = s["i"] if "i" in s else s["i_cmd"]
    current = max(float(np.std(drive)), 1e-9)
    torque = max(current * abs(setting.nominal["k_t"] * setting.nominal["n"]), 1e-9)
    speed = max(float(np.std(s.speed("q_m"))), 1e-9)
    bar = max(setting.nominal["k_b"], 1e-9)
    load = float(np.std(s["tau"])) if "tau" in s else torque
    # A deflection below what the encoder resolves is no scale to work with.
    deflection = max(load / bar, setting.std("q_m"), 1e-12)
    return Scales(torque, speed, deflection, current, len(s) * s.dt)


def hypotheses(setting: Setting, stages: tuple[str, ...]) -> tuple[Hypothesis, ...]:
    """Return all candidates that a record with these stages can show."""
    size = scales(setting)
    rows: list[Hypothesis] = []
    if "i_cmd" in setting.series:
        rows += _drive(setting, size)
    rows += _motor(setting, size)
    rows += _friction(setting, size)
    if setting.has_spring:
        rows += _transmission(setting, size)
    if setting.cut_at_spring:
        rows += _torque_sensor(setting, size)
    if not setting.structure.output_fixed:
        rows += _load(setting, size)
    kept = []
    for row in rows:
        touches = tuple(s for s in row.touches if s in stages)
        if touches:
            kept.append(_with_touches(row, touches))
    return tuple(kept)


def _with_touches(row: Hypothesis, touches: tuple[str, ...]) -> Hypothesis:
    values = {name: getattr(row, name) for name in row.__dataclass_fields__}
    return Hypothesis(**(values | {"touches": touches}))


# ---- drive
def _drive(setting: Setting, size: Scales) -> list[Hypothesis]:
    touches = ("drive",) if "i" in setting.series else ("motor",)
    dt = setting.series.dt
    peak = float(np.abs(setting.series["i_cmd"]).max()) or 1.0
    delay = Unknown("delay", "s", 0.0, 5.0 * dt, low=0.0, high=60.0 * dt)
    lag = Unknown("bandwidth", "Hz", 50.0, 1.5, log=True, low=0.5, high=0.45 / dt)
    limit = Unknown("i_max", "A", peak, 1.0, log=True, low=1e-3 * peak, high=peak)
    step = Unknown("resolution", "A", 0.05 * peak, 2.0, log=True, low=1e-4 * peak, high=0.5 * peak)

    def set_lag(f: Fields, v: Values) -> None:
        f["lag"] = 1.0 / (2.0 * np.pi * v["bandwidth"])

    return [
        Hypothesis(
            "command_delay",
            "drive",
            (delay,),
            lambda f, v: f.update(delay=f["delay"] + v["delay"]),
            touches,
            starts=tuple((k * dt,) for k in (0.5, 1.5, 3.0, 6.0, 12.0)),
            family="drive",
        ),
        Hypothesis(
            "current_lag",
            "drive",
            (lag,),
            set_lag,
            touches,
            starts=((300.0,), (100.0,), (30.0,), (8.0,)),
            family="drive",
        ),
        Hypothesis(
            "current_saturation",
            "drive",
            (limit,),
            lambda f, v: f.update(i_max=min(f["i_max"], v["i_max"])),
            touches,
            starts=tuple((x * peak,) for x in (0.85, 0.6, 0.35, 0.18)),
            family="drive",
        ),
        Hypothesis(
            "command_quantization",
            "drive",
            (step,),
            lambda f, v: f.update(step=v["resolution"]),
            touches,
            starts=(),
            family="drive",
            search="step",
        ),
    ]


# ---- motor
def _released(setting: Setting, name: str, effect: str, stage: str, field_name: str) -> Hypothesis:
    unit = setting.joint.parameters.unit(field_name)
    factor = Unknown(name, unit, setting.nominal[field_name], 0.5, log=True)
    body = {"m": "motor", "g": "gear", "l": "load"}.get(field_name[-1])
    if stage not in ("motor", "load") or field_name == "k_t":
        body = None

    def release(f: Fields, v: Values) -> None:
        f[field_name] *= v[name] / setting.nominal[field_name]

    return Hypothesis(
        effect,
        stage,
        (factor,),
        release,
        stages_of(setting, field_name),
        body=body,
        starts=((setting.nominal[field_name],),),
        family="nominal",
        releases=field_name,
    )


def _motor(setting: Setting, size: Scales) -> list[Hypothesis]:
    active = active_parameters(setting)
    rows = [_released(setting, "k_t", "torque_constant", "motor", "k_t")]
    rows.append(_released(setting, "I_m", "inertia", "motor", "I_m"))
    if "I_g" in active:
        rows.append(_released(setting, "I_g", "inertia", "motor", "I_g"))
    rows += [
        _damping(setting, size, body) for body in ("m", "g") if body == "m" or setting.has_gear
    ]
    heat = Unknown("time_constant", "s", 5.0, 0.8, log=True, low=0.2, high=500.0)
    derate = Unknown("loss", "1/A^2", 0.0, 0.3 / size.current**2, low=0.0)
    rows.append(
        Hypothesis(
            "thermal_derating",
            "motor",
            (derate, heat),
            lambda f, v: f.update(derate=v["loss"], heat=v["time_constant"]),
            ("motor",),
            starts=tuple((0.1 / size.current**2, tau) for tau in (2.0, 5.0, 15.0)),
            family="thermal",
        )
    )
    offset = Unknown("torque", "N m", 0.0, size.torque)
    rows.append(
        Hypothesis(
            "torque_offset",
            "motor",
            (offset,),
            lambda f, v: f.update(offset=f["offset"] + v["torque"]),
            ("motor",),
            starts=((0.0,),),
            family="offset",
        )
    )
    rows += [
        _periodic("cogging", "cog", size.torque, "N m"),
        _periodic("gear_ripple", "rip", 1.0, "-"),
    ]
    return rows


def _damping(setting: Setting, size: Scales, body: str) -> Hypothesis:
    unit = setting.joint.parameters.unit(f"d_{body}")
    typical = size.torque / size.speed
    start = setting.nominal[f"d_{body}"]
    if body == "m" and not setting.has_gear:
        start += setting.nominal["d_g"]
        start += 0.0 if setting.has_spring else setting.nominal["d_l"]
    total = Unknown(f"d_{body}", unit, start, typical, low=-start)

    def apply(f: Fields, v: Values) -> None:
        f[f"d_{body}"] += v[f"d_{body}"] - start

    return Hypothesis(
        "damping",
        "motor",
        (total,),
        apply,
        ("motor", "transmission") if body == "g" else ("motor",),
        body=BODIES[body],
        starts=((start,),),
        family="nominal",
        releases=f"d_{body}",
    )


def _periodic(name: str, prefix: str, scale: float, unit: str) -> Hypothesis:
    f = Unknown("f", "1/rev", 0.0, 1.0, low=0.0, flat=True)
    a = Unknown("a", unit, 0.0, scale)
    b = Unknown("b", unit, 0.0, scale)

    def apply(fields: Fields, v: Values) -> None:
        fields[f"{prefix}_f"], fields[f"{prefix}_a"], fields[f"{prefix}_b"] = v["f"], v["a"], v["b"]

    return Hypothesis(name, "motor", (f, a, b), apply, ("motor",), family="periodic", search=prefix)


# ---- friction
def _friction(setting: Setting, size: Scales) -> list[Hypothesis]:
    bodies = ["m", "g"] if setting.has_gear else ["m"]
    rows = []
    for body in bodies:
        touches = ("motor", "transmission") if body == "g" else ("motor",)
        rows += _friction_of(setting, size, body, "motor", touches)
    return rows


def _friction_of(
    setting: Setting, size: Scales, body: str, stage: str, touches: tuple[str, ...]
) -> list[Hypothesis]:
    torque, speed = size.torque, size.speed
    p, n = f"d_c{body}", f"d_c{body}_n"
    force = Unknown(p, "N m", 0.0, torque, low=0.0)
    force_n = Unknown(n, "N m", 0.0, torque, low=0.0)
    breakaway = Unknown("d_s", "N m", 0.0, torque, low=0.0)
    stribeck = Unknown(
        "v_s", "rad/s", 0.1 * speed, 1.2, log=True, low=1e-4 * speed, high=20 * speed
    )
    slide = Unknown("z_s", "rad", 1e-3, 2.0, log=True, low=1e-6, high=0.3)
    mu = Unknown("mu", "-", 0.0, 0.2, low=0.0, high=1.0)
    d_p = Unknown(f"d_{body}", "N m s/rad", 0.0, torque / speed)
    d_n = Unknown(f"d_{body}_n", "N m s/rad", 0.0, torque / speed)
    guess = 0.05 * torque
    travel = max(float(np.std(setting.series["q_m"])), 1e-9)

    def row(name: str, unknowns: tuple[Unknown, ...], apply: Apply, starts: object) -> Hypothesis:
        return Hypothesis(
            name,
            stage,
            unknowns,
            apply,
            touches,
            body=BODIES[body],
            starts=starts,  # type: ignore[arg-type]
            family="friction",
        )

    def add(f: Fields, **values: float) -> None:
        for key, value in values.items():
            f[f"{key}_{body}"] += value

    def apply_stribeck(f: Fields, v: Values) -> None:
        more = max(v["d_s"] - v[p], 0.0)
        add(f, c_p=v[p], c_n=v[p], s_p=more, s_n=more)
        f[f"v_s_{body}"] = v["v_s"]

    def apply_presliding(f: Fields, v: Values) -> None:
        add(f, c_p=v[p], c_n=v[p])
        f[f"z_s_{body}"] = v["z_s"]

    name_c = "load_coulomb" if body == "l" else "coulomb"
    rows = [row(name_c, (force,), lambda f, v: add(f, c_p=v[p], c_n=v[p]), ((guess,),))]
    if body == "l":
        return rows
    rows += [
        row(
            "coulomb_asym",
            (force, force_n),
            lambda f, v: add(f, c_p=v[p], c_n=v[n]),
            ((guess, guess),),
        ),
        row(
            "stribeck",
            (force, breakaway, stribeck),
            apply_stribeck,
            tuple((guess, 1.6 * guess, x * speed) for x in (0.03, 0.15, 0.6)),
        ),
        row(
            "presliding",
            (force, slide),
            apply_presliding,
            tuple((guess, x * travel) for x in (0.003, 0.02, 0.12, 0.5)),
        ),
        row("load_friction", (mu,), lambda f, v: add(f, mu=v["mu"]), ((0.05,),)),
        row(
            "viscous_asym",
            (d_p, d_n),
            lambda f, v: add(f, d_p=v[f"d_{body}"], d_n=v[f"d_{body}_n"]),
            ((0.0, 0.0),),
        ),
    ]
    return rows


# ---- transmission
def _hysteresis(exponent: float, f: Fields, v: Values) -> None:
    f["hyst"], f["hyst_z"], f["hyst_n"] = v["h"], v["z_h"], exponent


def _transmission(setting: Setting, size: Scales) -> list[Hypothesis]:
    touches = ("transmission",) if setting.cut_at_spring else ("motor",)
    rows = [_released(setting, "k_b", "stiffness", "transmission", "k_b")]
    if setting.has_gear:
        rows.append(_released(setting, "k_g", "gear_stiffness", "transmission", "k_g"))
    x = size.deflection
    play = Unknown("b", "rad", 0.0, x, low=0.0)
    centre = Unknown("centre", "rad", 0.0, x)
    hard = Unknown("c", "1/rad^2", 0.0, 0.3 / x**2)
    torque = Unknown("h", "N m", 0.0, setting.nominal["k_b"] * x)
    width = Unknown("z_h", "rad", 0.3 * x, 1.5, log=True, low=1e-3 * x, high=100 * x)

    def apply_play(f: Fields, v: Values) -> None:
        f["play"], f["q_0"] = v["b"], f["q_0"] + v["centre"]

    if setting.has_gear and setting.cut_at_spring:
        rows.append(_gear_play(setting, play, centre, x))
    rows += [
        Hypothesis(
            "backlash",
            "transmission",
            (play, centre),
            apply_play,
            touches,
            starts=tuple((w * x, c * w * x) for w in (0.03, 0.2) for c in (-0.4, 0.0, 0.4)),
            family="spring",
            variant="bar",
        ),
        Hypothesis(
            "hardening",
            "transmission",
            (hard,),
            lambda f, v: f.update(hard=v["c"]),
            touches,
            starts=((0.0,),),
            family="spring",
        ),
        *(
            Hypothesis(
                "spring_hysteresis",
                "transmission",
                (torque, width),
                partial(_hysteresis, exponent),
                touches,
                starts=tuple((0.02 * torque.scale, w * x) for w in (0.05, 0.3, 1.0)),
                family="spring",
                variant=variant,
            )
            for variant, exponent in HYSTERESES.items()
        ),
    ]
    return rows


def _gear_play(setting: Setting, play: Unknown, centre: Unknown, x: float) -> Hypothesis:
    def apply(f: Fields, v: Values) -> None:
        f["play_g"] = v["b"]
        f["centre_g"] = min(max(v["centre"], -0.5 * v["b"]), 0.5 * v["b"])
        f["q_0"] -= f["centre_g"]

    del setting
    return Hypothesis(
        "backlash",
        "transmission",
        (play, centre),
        apply,
        ("motor", "transmission"),
        starts=tuple((w * x, c * w * x) for w in (0.05, 0.25) for c in (-0.4, 0.0, 0.4)),
        family="spring",
        variant="gear",
    )


# ---- torque sensor
def _torque_sensor(setting: Setting, size: Scales) -> list[Hypothesis]:
    del size
    touches = ("motor", "transmission", "load")
    dt = setting.series.dt
    gain = Unknown("gain", "-", 1.0, 0.3, log=True, low=0.05, high=20.0)
    bias = Unknown("bias", "N m", 0.0, max(float(np.std(setting.series["tau"])), 1e-9))
    late = Unknown("delay", "s", 0.0, 3.0 * dt, low=0.0, high=60.0 * dt)

    def row(name: str, unknown: Unknown, apply: Apply, starts: object) -> Hypothesis:
        return Hypothesis(
            name,
            "sensing",
            (unknown,),
            apply,
            touches,
            channel="tau",
            starts=starts,  # type: ignore[arg-type]
            family="sensing",
        )

    return [
        row("torque_gain", gain, lambda f, v: f.update(gain=f["gain"] * v["gain"]), ((1.0,),)),
        row("torque_bias", bias, lambda f, v: f.update(tau_0=f["tau_0"] + v["bias"]), ((0.0,),)),
        row(
            "torque_delay",
            late,
            lambda f, v: f.update(late=f["late"] + v["delay"]),
            tuple((k * dt,) for k in (0.3, 1.0, 3.0, 8.0)),
        ),
    ]


# ---- load
def _load(setting: Setting, size: Scales) -> list[Hypothesis]:
    touches = ("load",) if setting.cut_at_spring else ("motor",)
    if not setting.cut_at_spring:
        if not setting.has_spring:
            turns = setting.joint.parameters.axis == "revolute"
            return [_gravity(size.torque, touches)] if turns else []
        return [_released(setting, "I_l", "load_inertia", "load", "I_l")]
    rows = [_released(setting, "I_l", "load_inertia", "load", "I_l")]
    rows += _friction_of(setting, size, "l", "load", touches)
    torque = max(float(np.std(setting.series["tau"])), 1e-9)
    return [*rows, _gravity(torque, touches)]


def _gravity(torque: float, touches: tuple[str, ...]) -> Hypothesis:
    return Hypothesis(
        "gravity",
        "load",
        (Unknown("a", "N m", 0.0, torque), Unknown("b", "N m", 0.0, torque)),
        lambda f, v: f.update(grav_a=v["a"], grav_b=v["b"]),
        touches,
        starts=((0.0, 0.0),),
        family="load",
    )
