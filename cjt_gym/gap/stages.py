"""The four stages of a joint, cut where it is measured.

========  ===================  ===================================
stage     from                 to
========  ===================  ===================================
drive     command              current
motor     current, torque      motor angle (innovations)
trans.    both angles          torque
load      torque               load angle (innovations)
========  ===================  ===================================

Each stage is driven by what was measured on both of its sides, so that an error in one does not
reach the next. Where the torque was not measured, motor, spring and load are one stage.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.signal import fftconvolve, savgol_filter

from cjt_gym.gap.chain import GEAR, LOAD, MOTOR, Chain, Link, build_chain, kalman_gain
from cjt_gym.gap.fields import CHAIN, Fields, friction_law, has_friction
from cjt_gym.gap.kernel import LAW_SIZE, predict
from cjt_gym.gap.setting import PROCESS_TORQUE, Setting
from cjt_gym.gap.signals import (
    ahead,
    commanded_current,
    joint_torque,
    motor_torque,
    periodic_torque,
    shift_noise,
    shifted,
    smooth_mean,
    weight,
)
from cjt_gym.gap.spring import spring_torque

Floats = NDArray[np.float64]
STAGES = ("drive", "motor", "transmission", "load")
PULSE = 800
SMOOTH = 21
RESPONSE = 200
"""Samples after which a predictor has forgotten a torque."""


@dataclass(eq=False)
class Gain:
    """A predictor's gain, held fixed while parameters are fitted.

    Attributes:
        k: Gain, shape (n, m).
        std: Deviation of the innovations, shape (m,).
        scatter: Deviation at every sample, with what jitter of the sampling adds, shape (N,).
    """

    k: Floats
    std: Floats
    scatter: Floats


@dataclass(eq=False)
class Prediction:
    """What a stage predicts.

    Attributes:
        residual: Normalised residual, shape (N,); zero where it does not count.
        states: Predicted states, shape (N, n); n = 0 for a stage without states.
        friction: Torque of friction on each body [N m], shape (N, bodies).
    """

    residual: Floats
    states: Floats
    friction: Floats


@dataclass(frozen=True, eq=False)
class Play:
    """Backlash in the gear as the kernel takes it; see `cjt_gym.gap.kernel.predict`."""

    play: Floats
    loose: Chain
    adrift: Floats
    entry: Floats


NO_PLAY = (np.zeros(0), *(np.zeros((0, 0)) for _ in range(3)), np.zeros(0))


@dataclass(eq=False)
class Stages:
    """All stages of one record.

    Attributes:
        setting: The record and its joint.
        gains: Predictor gains by stage, for the fields given to `tune`.
        process: Torque noise on the motor beyond what is specified [N m].
        allowance: Factor by which the motor's residual may exceed what white noise explains.
    """

    setting: Setting
    gains: dict[str, Gain] = field(default_factory=dict)
    process: float = 0.0
    allowance: float = 1.0
    _chains: dict[tuple[object, ...], Chain] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """Stages that this record allows."""
        s = self.setting
        there = {
            "drive": "i" in s.series and "i_cmd" in s.series,
            "motor": True,
            "transmission": s.cut_at_spring and ("q_l" in s.series or s.structure.output_fixed),
            "load": s.cut_at_spring and not s.structure.output_fixed and "q_l" in s.series,
        }
        return tuple(name for name in STAGES if there[name])

    def tune(self, fields: Fields) -> None:
        """Compute the predictors' gains for these fields."""
        for name in self.names:
            if name in ("motor", "load"):
                self.gains[name] = self._gain(name, fields)

    def predict(self, name: str, fields: Fields) -> Prediction:
        """Return the prediction of a stage."""
        run: dict[str, Callable[[Fields], Prediction]] = {
            "drive": self._drive,
            "motor": self._motor,
            "transmission": self._transmission,
            "load": self._load,
        }
        return run[name](fields)

    def residual(self, name: str, fields: Fields) -> Floats:
        """Return the normalised residual of a stage, shape (N,)."""
        return self.predict(name, fields).residual

    # ---- drive
    def _drive(self, fields: Fields) -> Prediction:
        s = self.setting
        error = s.series["i"] - commanded_current(fields, s.series) - fields["i_0"]
        std = np.full(len(s.series), s.std("i"))
        return _direct(error, std, s, ("i", "i_cmd"))

    # ---- motor
    def _motor(self, fields: Fields) -> Prediction:
        s = self.setting
        series = s.series
        chain = self.chain("motor", fields)
        transmitted = joint_torque(fields, series) if "tau" in series else np.zeros(len(series))
        ripple = periodic_torque(fields, series, transmitted + self._gear_inertia(fields))
        torque = motor_torque(fields, series) + smooth_mean(ripple)
        forced = torque[:, None] * chain.torque[:, MOTOR]
        if chain.groups[LOAD] >= 0:
            forced += smooth_mean(self._on_load(fields))[:, None] * chain.torque[:, LOAD]
        if s.cut_at_spring:
            mean = smooth_mean(transmitted)
            forced -= mean[:, None] * chain.torque[:, GEAR]
        elif s.has_spring and chain.groups[LOAD] < 0:
            forced += self._prescribed(chain, self._load_angle() + fields["q_0"])
        bodies = (("m", MOTOR),) if not s.has_gear else (("m", MOTOR), ("g", GEAR))
        if chain.groups[LOAD] >= 0:
            bodies = (*bodies, ("l", LOAD))
        play = None
        if fields["play_g"] > 0.0 and s.has_gear and s.cut_at_spring:
            loose = self.chain("motor loose", fields)
            adrift = (
                torque[:, None] * loose.torque[:, MOTOR] - mean[:, None] * loose.torque[:, GEAR]
            )
            bite = (chain.torque[:, MOTOR] - chain.torque[:, GEAR]) * fields["k_g"]
            play = _play(fields, np.array([1.0, -1.0, 0.0, 0.0]), bite, loose, adrift, None)
        return self._innovations("motor", "q_m", fields, chain, forced, bodies, transmitted, play)

    def _on_load(self, fields: Fields) -> Floats:
        """Return what acts on a load that is part of the motor's stage [N m]."""
        series = self.setting.series
        outside: Floats = series["tau_l"] if "tau_l" in series else np.zeros(len(series))
        if self.setting.has_spring:
            return outside
        return np.asarray(outside - weight(fields, series["q_m"]))

    def _gear_inertia(self, fields: Fields) -> Floats | float:
        """Return what a compliant gear carries on top of the joint torque, to move itself [N m]."""
        if not self.setting.has_gear or (fields["cog_f"] == 0.0 and fields["rip_f"] == 0.0):
            return 0.0
        speed, acceleration = self._motion
        return np.asarray(fields["I_g"] * acceleration + fields["d_g"] * speed)

    @cached_property
    def _motion(self) -> tuple[Floats, Floats]:
        """Velocity and acceleration of the motor, smoothed, each of shape (N,)."""
        q, dt = self.setting.series["q_m"], self.setting.series.dt
        speed, acceleration = (savgol_filter(q, SMOOTH, 3, deriv=d, delta=dt) for d in (1, 2))
        return speed, acceleration

    # ---- transmission
    def _transmission(self, fields: Fields) -> Prediction:
        s = self.setting
        series = s.series
        q_l = self._load_angle()
        q_g, states, friction = self._gear_angle(fields)
        torque = spring_torque(fields, q_g - q_l - fields["q_0"], series.dt)
        model = fields["gain"] * torque + fields["tau_0"]
        own, angles = self.spring_noise
        if fields["late"] != 0.0:
            model = shifted(model, -fields["late"] / series.dt)
            angles *= shift_noise(-fields["late"] / series.dt)
        model = model - fields["skew"] * series.speed("tau")
        slope = series.speed("tau") * s.noise["tau"].jitter
        std = np.sqrt(own**2 + angles**2 + slope**2 + self._shaken_angles)
        result = _direct(series["tau"] - model, std, s, ("tau", "q_m", "q_l"))
        return Prediction(result.residual, states, friction)

    @cached_property
    def _shaken_angles(self) -> Floats:
        """Variance of the spring's torque that jittering angles cause [N^2 m^2], shape (N,)."""
        s, f = self.setting, self.setting.nominal
        stiffness = {"q_m": f["k_b"], "q_l": f["k_b"]}
        if s.has_gear:
            stiffness["q_m"] = f["k_b"] * f["k_g"] / (f["k_b"] + f["k_g"])
        total: Floats = np.zeros(len(s.series))
        for channel, k in stiffness.items():
            if channel in s.series:
                total += (k * s.noise[channel].jitter * s.series.speed(channel)) ** 2
        return total

    @cached_property
    def spring_noise(self) -> tuple[float, float]:
        """Deviation of the transmission's error from the torque's noise and from the angles' [N m].

        Where the gear is compliant its angle is computed from the measured torque, so that the
        torque's noise enters twice; responses to a single wrong sample tell how much.
        """
        s, f, dt = self.setting, self.setting.nominal, self.setting.series.dt
        pulse = np.zeros(PULSE)
        pulse[PULSE // 4] = 1.0

        def bar(angle: Floats) -> Floats:
            return f["k_b"] * angle + f["d_gl"] * np.gradient(angle, dt)

        if not s.has_gear:
            angle = float(np.linalg.norm(bar(pulse)))
            return s.std("tau"), angle * float(np.hypot(s.std("q_m"), s.std("q_l")))
        chain = self.chain("transmission", f)
        drives = (
            -smooth_mean(pulse)[:, None] * chain.torque[:, GEAR],
            self._prescribed(chain, pulse),
        )
        nothing = np.zeros(PULSE)
        by_torque, by_motor = (
            _run(f, chain, drive, (), None, None, np.zeros(2), nothing, dt)[1][:, 0]
            for drive in drives
        )
        own = s.std("tau") * float(np.linalg.norm(pulse - bar(by_torque)))
        motor = s.std("q_m") * float(np.linalg.norm(bar(by_motor)))
        return own, float(np.hypot(motor, s.std("q_l") * np.linalg.norm(bar(pulse))))

    def _load_angle(self) -> Floats:
        series = self.setting.series
        return series["q_l"] if "q_l" in series else np.zeros(len(series))

    def _gear_angle(self, fields: Fields) -> tuple[Floats, Floats, Floats]:
        """Return the gear's angle [rad] from motor angle and torque, its states and friction."""
        s = self.setting
        series = s.series
        q_m = series["q_m"]
        if not s.has_gear:
            return q_m, np.zeros((len(q_m), 0)), np.zeros((len(q_m), 0))
        chain = self.chain("transmission", fields)
        transmitted = joint_torque(fields, series)
        mean = smooth_mean(transmitted)
        forced = self._prescribed(chain, q_m) - mean[:, None] * chain.torque[:, GEAR]
        x0 = np.array([q_m[0] - transmitted[0] / fields["k_g"] - fields["centre_g"], 0.0])
        play = None
        if fields["play_g"] > 0.0:
            loose = self.chain("transmission loose", fields)
            adrift = -mean[:, None] * loose.torque[:, GEAR]
            bite = -chain.torque[:, GEAR] * fields["k_g"]
            play = _play(fields, np.array([-1.0, 0.0]), bite, loose, adrift, q_m)
        load, bodies = np.abs(transmitted), (("g", GEAR),)
        _, states, friction = _run(
            fields, chain, forced, bodies, None, None, x0, load, series.dt, play
        )
        return states[:, 0], states, friction

    # ---- load
    def _load(self, fields: Fields) -> Prediction:
        s = self.setting
        series = s.series
        chain = self.chain("load", fields)
        torque = smooth_mean(joint_torque(fields, series))
        if fields["grav_a"] != 0.0 or fields["grav_b"] != 0.0:
            torque = torque - weight(fields, series["q_l"])
        if "tau_l" in series:
            torque = torque + smooth_mean(series["tau_l"])
        forced = torque[:, None] * chain.torque[:, LOAD]
        return self._innovations(
            "load", "q_l", fields, chain, forced, (("l", LOAD),), np.abs(torque)
        )

    # ---- shared
    def _prescribed(self, chain: Chain, q: Floats) -> Floats:
        """Return what a prescribed angle adds over each sample, shape (N, n)."""
        rate = (ahead(q) - q) / self.setting.series.dt
        return q[:, None] * chain.start + rate[:, None] * chain.slope

    def chain(self, name: str, fields: Fields) -> Chain:
        """Return the chain of a stage."""
        key = (name, *(fields[f] for f in CHAIN))
        if key not in self._chains:
            if len(self._chains) > 64:
                self._chains.clear()
            self._chains[key] = self._build(name, fields)
        return self._chains[key]

    def _build(self, name: str, fields: Fields) -> Chain:
        s = self.setting
        inertia = [fields[f] for f in ("I_m", "I_g", "I_l")]
        damping = [fields[f] for f in ("d_m", "d_g", "d_l")]
        gear = Link(MOTOR, GEAR, fields["k_g"], fields["d_mg"])
        dt = s.series.dt
        if name == "load":
            return build_chain((-1, -1, 0), inertia, damping, (), dt)
        if name == "transmission loose":
            return build_chain((-1, 0, -1), inertia, damping, (), dt)
        if name == "motor loose":
            return build_chain((0, 1, -1), inertia, damping, (), dt)
        if name == "transmission":
            entry = Link(GEAR, None, fields["k_g"], fields["d_mg"])
            return build_chain((-1, 0, -1), inertia, damping, (entry,), dt)
        gear_group = 1 if s.has_gear else 0
        links = (gear,) if s.has_gear else ()
        if s.cut_at_spring:
            return build_chain((0, gear_group, -1), inertia, damping, links, dt)
        if not s.has_spring:
            return build_chain((0, gear_group, gear_group), inertia, damping, links, dt)
        if s.structure.output_fixed or "q_l" in s.series:
            bar = Link(GEAR, None, fields["k_b"], fields["d_gl"])
            return build_chain((0, gear_group, -1), inertia, damping, (*links, bar), dt)
        bar = Link(GEAR, LOAD, fields["k_b"], fields["d_gl"])
        return build_chain((0, gear_group, gear_group + 1), inertia, damping, (*links, bar), dt)

    def _gain(self, name: str, fields: Fields) -> Gain:
        s = self.setting
        chain = self.chain(name, fields)
        current = s.std("i") if "i" in s.series else 0.0
        own = abs(fields["n"] * fields["k_t"]) * current
        tau = s.std("tau") / abs(fields["gain"]) if s.cut_at_spring else 0.0
        extra = max(PROCESS_TORQUE * float(np.hypot(own, tau)), self.process)
        torque = (np.hypot(own, extra), tau, tau) if name == "motor" else (0.0, 0.0, tau)
        channel = "q_m" if name == "motor" else "q_l"
        jitter = s.noise[channel].jitter * float(np.sqrt(np.mean(s.series.speed(channel) ** 2)))
        noise = float(np.hypot(s.std(channel), jitter))
        k, _ = kalman_gain(chain, (0,), torque, (noise,))
        std = _std(chain, k, torque, s.std(channel))
        shaken = s.noise[channel].jitter * s.series.speed(channel)
        variance = std[0] ** 2 + shaken**2
        if name == "motor" and "i" in s.series:
            torque_slope = fields["n"] * fields["k_t"] * s.series.speed("i")
            response = torque_response(chain, k, MOTOR)
            early = s.noise["i"].jitter * torque_slope
            variance += fftconvolve(early**2, response**2)[: len(early)]
        if s.cut_at_spring:
            late = s.noise["tau"].jitter * s.series.speed("tau")
            response = torque_response(chain, k, GEAR if name == "motor" else LOAD)
            variance += fftconvolve(late**2, response**2)[: len(late)]
        if name == "motor":
            variance *= self.allowance**2
        return Gain(k, std, np.sqrt(np.maximum(variance, 1e-300)))

    def _innovations(
        self,
        name: str,
        channel: str,
        fields: Fields,
        chain: Chain,
        forced: Floats,
        bodies: tuple[tuple[str, int], ...],
        transmitted: Floats,
        play: Play | None = None,
    ) -> Prediction:
        s = self.setting
        y = s.series[channel][:, None]
        x0 = self._initial(channel, chain, fields, transmitted)
        gain = self.gains[name]
        valid = s.series.valid[channel]
        load, dt = np.abs(transmitted), s.series.dt
        e, states, friction = _run(
            fields, chain, forced, bodies, gain.k, (y, valid), x0, load, dt, play
        )
        residual = np.where(valid, e[:, 0] / gain.scatter, 0.0)
        residual[: s.settle] = 0.0
        return Prediction(residual, states, friction)

    def _initial(self, channel: str, chain: Chain, fields: Fields, torque: Floats) -> Floats:
        """Return the first state: at the measured angle, at the velocity of the first samples."""
        y = self.setting.series[channel]
        speed = self.setting.series.first_speed(channel)
        x0 = np.zeros(chain.a.shape[0])
        x0[: chain.size], x0[chain.size :] = y[0], speed
        if self.setting.has_gear and channel == "q_m":
            x0[1] -= torque[0] / fields["k_g"] + fields["centre_g"]
        return x0


def _play(
    fields: Fields,
    signs: Floats,
    bite: Floats,
    loose: Chain,
    adrift: Floats,
    entry: Floats | None,
) -> Play:
    half = 0.5 * fields["play_g"]
    play = np.concatenate([[half], signs, bite * half])
    nothing = np.zeros(0)
    return Play(play, loose, adrift, nothing if entry is None else entry)


def torque_response(chain: Chain, k: Floats, body: int) -> Floats:
    """Return the innovations that one newton metre over one sample causes, shape (200,).

    Value 0 belongs to the sample in which it acts.
    """
    x = chain.torque[:, body].copy()
    out = np.zeros(RESPONSE)
    for t in range(1, RESPONSE):
        out[t] = x[0]
        x = chain.a @ (x - k[:, 0] * out[t])
    return out


def _std(chain: Chain, k: Floats, torque: tuple[float, ...], noise: float) -> Floats:
    """Return the innovations' deviation under a gain, shape (1,), without jitter."""
    n = chain.a.shape[0]
    c = np.zeros((1, n))
    c[0, 0] = 1.0
    keep = np.eye(n) - k @ c
    effect = chain.torque * np.array(torque)
    drive = effect @ effect.T + chain.a @ k @ k.T @ chain.a.T * noise**2
    p = drive.copy()
    step = chain.a @ keep
    for _ in range(40):  # doubling: the sum over 2^40 samples
        p = p + step @ p @ step.T
        step = step @ step
        if np.abs(step).max() < 1e-12:
            break
    return np.array([float(np.sqrt(p[0, 0] + noise**2))])


def _direct(error: Floats, std: Floats, s: Setting, channels: tuple[str, ...]) -> Prediction:
    residual = np.where(s.series.measured(*channels), error / std, 0.0)
    residual[: s.settle] = 0.0
    empty = np.zeros((len(error), 0))
    return Prediction(residual, empty, empty)


def _run(
    fields: Fields,
    chain: Chain,
    forced: Floats,
    bodies: tuple[tuple[str, int], ...],
    k: Floats | None,
    measured: tuple[Floats, NDArray[np.bool_]] | None,
    x0: Floats,
    load: Floats,
    dt: float,
    play: Play | None = None,
) -> tuple[Floats, Floats, Floats]:
    """Run the kernel with friction on those of the bodies that have any."""
    rough = [(letter, body) for letter, body in bodies if has_friction(fields, letter)]
    laws = np.zeros((len(rough), LAW_SIZE))
    g = np.zeros((chain.a.shape[0], len(rough)))
    for row, (letter, body) in enumerate(rough):
        laws[row] = friction_law(fields, letter)
        g[:, row] = chain.torque[:, body]
    velocities = np.array([chain.velocity(body) for _, body in rough], dtype=np.int64)
    if measured is None or k is None:
        y, valid = np.zeros((len(forced), 0)), np.zeros(len(forced), dtype=bool)
        k, outputs = np.zeros((len(x0), 0)), np.zeros(0, dtype=np.int64)
    else:
        y, valid = measured
        outputs = np.zeros(1, dtype=np.int64)
    gap: tuple[Floats, ...] = NO_PLAY
    if play is not None:
        slack = np.zeros_like(g)
        for row, (_, body) in enumerate(rough):
            slack[:, row] = play.loose.torque[:, body]
        loose = np.ascontiguousarray(play.loose.a)
        gap = (play.play, loose, np.ascontiguousarray(play.adrift), slack, play.entry)
    run: Callable[..., tuple[Floats, Floats, Floats]] = predict
    return run(
        np.ascontiguousarray(chain.a),
        g,
        np.ascontiguousarray(k),
        np.ascontiguousarray(forced),
        outputs,
        np.ascontiguousarray(y),
        valid,
        x0,
        laws,
        velocities,
        load,
        *gap,
        dt,
    )
