"""Causes outside the effect table, so that no effect of the table is blamed for them.

They are fitted like the others and compete with them, but are never named as effects: where one of
them is needed, its stage is not explained by the table, and the diagnosis says what it looks like.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.signal import lfilter, savgol_filter

from cjt_gym.gap.candidates.candidate import Apply, Candidate, Scales, Values, scales
from cjt_gym.gap.candidates.disturbance import Disturbance, field_of
from cjt_gym.gap.candidates.number import Number, Starts
from cjt_gym.gap.recorded.cut import Cut
from cjt_gym.gap.recorded.fields import Fields
from cjt_gym.gap.recorded.series import Series
from cjt_gym.gap.recorded.setting import Setting
from cjt_gym.joint.kernel.arrays import Floats

Signal = Callable[[Series, Values], Floats]
TOUCHED = {
    "i": ("drive", "motor"),
    "tau": ("motor", "transmission", "load"),
    "q_m": ("motor", "transmission"),
    "q_l": ("transmission", "load"),
    "push_m": ("motor",),
    "push_l": ("load",),
    "bar": ("transmission",),
    "slack": ("transmission",),
    "rub_m": ("motor",),
}
SLOW = (1.0 / 3.0, 1.0 / 8.0)
"""Time constants of a drift, as shares of the record's length."""
SMOOTH = 15
"""Samples over which an acceleration is smoothed."""


@dataclass(eq=False)
class Outside:
    """The candidates outside the effect table, while they are collected."""

    setting: Setting
    size: Scales  # its typical magnitudes
    rows: list[Candidate] = field(default_factory=list)  # the candidates
    # what they add to the joint, by name
    disturbances: dict[str, Disturbance] = field(default_factory=dict)

    def add(
        self,
        name: str,
        text: str,
        channel: str,
        unknowns: tuple[Number, ...],
        signal: Signal,
        starts: Starts | None = None,
        search: str | None = None,
    ) -> None:
        """Add a candidate that adds a signal to a channel."""
        self.disturbances[name] = Disturbance(channel, signal)

        def apply(fields: Fields, values: Values) -> None:
            fields.update({field_of(name, symbol): value for symbol, value in values.items()})

        zero = (tuple(0.0 for _ in unknowns),)
        touched = self.setting.stages_of(*TOUCHED[channel])
        self.rows.append(
            Candidate(
                name,
                touched[0],
                unknowns,
                apply,
                touched,
                starts=zero if starts is None else starts,
                family="outside",
                search=search,
                outside=text,
            )
        )


def outside_rows(setting: Setting) -> Outside:
    """Return the candidates outside the effect table and what they add to the joint."""
    size = scales(setting)
    found = Outside(setting, size)
    if "i" in setting.series and "i_cmd" in setting.series:
        _drive(found)
    _on_body(found, "m", size.torque, size.speed)
    _rubbing(found)
    if "q_m" in setting.series.derived:
        return found
    _encoder(found, "q_m")
    if setting.cut is Cut.BY_TORQUE:
        _torque_sensor(found)
        _bar(found)
    sides = setting.cut is not Cut.NOWHERE
    if sides and not setting.structure.output_fixed and "q_l" in setting.series:
        speed = max(float(np.std(setting.series.speed("q_l"))), 1e-9)
        _on_body(found, "l", max(setting.sprung_torque, 1e-9), speed)
        _encoder(found, "q_l")
    return found


# ---- signals
def slow(series: Series, v: Values) -> Floats:
    """Return what grows slowly over a log from zero: a v["x"], v["y"], v["z"] of its ways."""
    x = series.log_time / series.log_length
    total = v["x"] * x
    for share, symbol in zip(SLOW, ("y", "z"), strict=True):
        total = total + v[symbol] * (1.0 - np.exp(-x / share))
    return np.asarray(total)


def wave_in_time(series: Series, v: Values) -> Floats:
    """Return a cos(f t) + b sin(f t)."""
    x = v["f"] * series.log_time
    return np.asarray(v["a"] * np.cos(x) + v["b"] * np.sin(x))


def memory(x: Floats, dt: float, time: float) -> Floats:
    """Return a signal after a first-order lag that starts relaxed to its first value."""
    a = float(np.exp(-dt / time))
    y, _ = lfilter([1.0 - a], [1.0, -a], x, zi=[a * x[0]])
    return np.asarray(y)


def absorbed(series: Series, v: Values, angle: str) -> Floats:
    """Return the torque of a mass on a spring that rides on a body: a of its force, b of its rate.

    The mass has the eigenfrequency v["f"] [rad/s] and a damping of 5 %.
    """
    q, dt, w = series[angle], series.dt, v["f"]
    acceleration = savgol_filter(q, SMOOTH, 3, deriv=2, delta=dt)
    r = float(np.exp(-0.05 * w * dt))
    poles = [1.0, -2.0 * r * np.cos(w * dt), r * r]
    y = lfilter([0.0, sum(poles)], poles, acceleration)
    return np.asarray(v["a"] * y + v["b"] * np.gradient(y, dt) / w)


# ---- rows
def _drive(found: Outside) -> None:
    series = found.setting.series
    peak = float(np.abs(series["i_cmd"]).max()) or 1.0
    fast = float(np.abs(np.diff(series["i_cmd"])).max()) / series.dt or 1.0
    dead = Number("width", "A", 0.02 * peak, 1.0, True, low=1e-4 * peak, high=0.8 * peak)
    slew = Number("slew", "A/s", 0.3 * fast, 1.5, True, low=1e-4 * fast, high=2.0 * fast)
    text = "a drive that does not respond to small commands"

    def gate(f: Fields, v: Values) -> None:
        f["dead"] = v["width"]

    def shrink(f: Fields, v: Values) -> None:
        f["dead"] = f["less"] = v["width"]

    def limit(f: Fields, v: Values) -> None:
        f["slew"] = v["slew"]

    for apply in (gate, shrink):
        starts = tuple((s * peak,) for s in (0.01, 0.05))
        found.rows.append(_of_drive("dead_zone", text, dead, apply, starts))
    text = "a current with a limited slew rate"
    starts = tuple((s * fast,) for s in (0.02, 0.1, 0.5))
    found.rows.append(_of_drive("slew_limit", text, slew, limit, starts))
    hum = "a current sensor that picks up the mains or another oscillation"
    found.add("hum", hum, "i", _wave(found.size.current, "A"), wave_in_time, search="i")


def _of_drive(name: str, text: str, unknown: Number, apply: Apply, starts: Starts) -> Candidate:
    return Candidate(
        name,
        "drive",
        (unknown,),
        apply,
        ("drive",),
        starts=starts,
        family="outside",
        variant=apply.__name__,
        outside=text,
    )


def _wave(scale: float, unit: str) -> tuple[Number, ...]:
    f = Number("f", "rad/s", 0.0, 1.0, low=0.0, prior=False)
    return f, Number("a", unit, 0.0, scale), Number("b", unit, 0.0, scale)


def _slow(scale: float, unit: str) -> tuple[Number, ...]:
    return tuple(Number(symbol, unit, 0.0, scale) for symbol in "xyz")


def _on_body(found: Outside, body: str, torque: float, speed: float) -> None:
    series, channel, angle = found.setting.series, f"push_{body}", f"q_{body}"
    of = {"m": "motor", "l": "load"}[body]

    def square(series: Series, v: Values) -> Floats:
        rate = series.speed(angle)
        return np.asarray(-v["drag"] * rate * np.abs(rate))

    drag = Number("drag", "N m s^2/rad^2", 0.0, 0.3 * torque / speed**2)
    text = f"friction of the {of} that grows with the square of its speed"
    found.add(f"square_{body}", text, channel, (drag,), square)
    text = f"a vibration that shakes the {of}"
    found.add(
        f"vibration_{body}", text, channel, _wave(torque, "N m"), wave_in_time, search=channel
    )
    text = f"a torque on the {of} that drifts slowly"
    found.add(f"drift_{body}", text, channel, _slow(torque, "N m"), slow)
    if body == "m" and "i" in series:
        cubic = Number("loss", "N m/A^3", 0.0, 0.3 * torque / found.size.current**3)
        text = "a torque that is not proportional to the current"
        found.add("saliency", text, channel, (cubic,), lambda s, v: -v["loss"] * s["i"] ** 3)
    if found.setting.current_unspecified:
        return  # the rest relies on the measured acceleration, whose noise is unspecified
    inertia = torque / max(float(np.std(np.gradient(series.speed(angle), series.dt))), 1e-9)
    ride = (
        Number("f", "rad/s", 80.0, 0.8, True, low=10.0, high=1.0 / series.dt),
        Number("a", "kg m^2", 0.0, inertia),
        Number("b", "kg m^2", 0.0, inertia),
    )
    text = f"a mass attached to the {of} by a spring"
    starts = tuple((2.0 * np.pi * f, 0.0, 0.0) for f in (6.0, 10.0, 16.0, 25.0, 40.0))
    found.add(
        f"rider_{body}", text, channel, ride, lambda s, v: absorbed(s, v, angle), starts=starts
    )


def _rubbing(found: Outside) -> None:
    series, torque = found.setting.series, found.size.torque
    level = Number("level", "N m", 0.0, torque)
    guess = 0.05 * torque

    def warming(series: Series, v: Values) -> Floats:
        return np.asarray(v["level"] + v["cold"] * np.exp(-series.log_time / v["time"]))

    time = Number("time", "s", 4.0, 0.7, True, low=0.3, high=300.0)
    cold = Number("cold", "N m", 0.0, torque)
    text = "dry friction of the motor that changes as it runs"
    starts = ((guess, 0.0, 2.0), (guess, 0.0, 8.0))
    found.add("warm_up", text, "rub_m", (level, cold, time), warming, starts=starts)
    turn = 2.0 * np.pi / max(float(np.ptp(series["q_m"])), 1e-9)
    f = Number("f", "1/rev", 2.0 * turn, 0.7, True, low=0.2 * turn, high=30.0 * turn)
    a, b = (Number(s, "N m", 0.0, torque) for s in "ab")
    spot_starts = tuple((guess, n * turn, 0.0, 0.0) for n in (0.6, 1.2, 2.0, 3.0, 4.2))
    text = "dry friction of the motor that depends on its angle"
    found.add("spot", text, "rub_m", (level, f, a, b), wave_in_angle("q_m"), starts=spot_starts)


def wave_in_angle(angle: str) -> Signal:
    """Return the signal level + a cos(f q) + b sin(f q)."""

    def signal(series: Series, v: Values) -> Floats:
        x = v["f"] * series[angle]
        return np.asarray(v.get("level", 0.0) + v["a"] * np.cos(x) + v["b"] * np.sin(x))

    return signal


def _encoder(found: Outside, angle: str) -> None:
    n = max(abs(found.setting.nominal["n"]), 1.0)
    scale = max(found.size.deflection, 10.0 * found.setting.std(angle))
    own = {1.0, 2.0, n, 2.0 * n} if angle == "q_m" else {1.0, 2.0}
    f = Number("f", "1/rev", 1.0, 1.0, low=0.2, high=4.0 * n, prior=False)
    unknowns = (f, Number("a", "rad", 0.0, scale), Number("b", "rad", 0.0, scale))
    text = f"an encoder of {angle} with a periodic error over a revolution"
    starts = tuple((x, 0.0, 0.0) for x in sorted(own))
    found.add(f"eccentric_{angle}", text, angle, unknowns, wave_in_angle(angle), starts=starts)


def _torque_sensor(found: Outside) -> None:
    scale = max(float(np.std(found.setting.series["tau"])), 1e-9)
    found.add("drift_tau", "a torque sensor that drifts slowly", "tau", _slow(scale, "N m"), slow)
    if "i" in found.setting.series:
        gain = Number("gain", "N m/A", 0.0, 0.3 * scale / found.size.current)
        text = "a torque sensor that also reads the current"
        found.add("crosstalk", text, "tau", (gain,), lambda s, v: v["gain"] * s["i"])
    bend = Number("skew", "-", 0.0, 0.2)
    text = "a torque sensor whose scale differs between the directions"
    found.add("lopsided", text, "tau", (bend,), lambda s, v: v["skew"] * np.abs(s["tau"]))


def _bar(found: Outside) -> None:
    skew = Number("skew", "-", 0.0, 0.2)
    text = "a spring that is stiffer in one direction than in the other"
    found.add("one_sided", text, "bar", (skew,), lambda s, v: v["skew"] * np.abs(s["tau"]))
    share = Number("share", "-", 0.0, 0.3)
    time = Number("time", "s", 0.4, 1.0, True, low=0.01, high=30.0)

    def yielded(series: Series, v: Values) -> Floats:
        return -v["share"] * memory(series["tau"], series.dt, v["time"])

    starts = tuple((0.0, t) for t in (0.05, 0.3, 1.5))
    text = "a spring that creeps"
    found.add("creep", text, "bar", (share, time), yielded, starts=starts)
    turn = 2.0 * np.pi / max(float(np.ptp(found.setting.series["q_m"])), 1e-9)
    x = found.size.deflection
    width = Number("level", "rad", 0.0, x)
    f = Number("f", "1/rev", 2.0 * turn, 0.7, True, low=0.2 * turn, high=30.0 * turn)
    a, b = (Number(s, "rad", 0.0, x) for s in "ab")
    loose = tuple((0.1 * x, n * turn, 0.0, 0.0) for n in (1.0, 2.0, 3.3))
    text = "a play that depends on the motor's angle"
    found.add("loose", text, "slack", (width, f, a, b), wave_in_angle("q_m"), starts=loose)
