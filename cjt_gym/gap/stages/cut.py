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
reach the next. Where the torque was not measured, but both angles, each of motor and load hangs on
a spring whose other end moves as measured; where neither was, motor, spring and load are one stage.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.signal import savgol_filter

from cjt_gym.gap.candidates.disturbance import corrected, disturbing
from cjt_gym.gap.candidates.outside import Outside, outside_rows
from cjt_gym.gap.recorded.cut import Cut
from cjt_gym.gap.recorded.fields import CHAIN, Fields, of_record
from cjt_gym.gap.recorded.series import Series
from cjt_gym.gap.recorded.setting import Setting
from cjt_gym.gap.recorded.signals import (
    MEAN,
    ahead,
    commanded_current,
    interval_mean,
    joint_torque,
    motor_torque,
    shift_noise,
    shifted,
    smooth_mean,
    torque_rise,
    weight,
    within,
)
from cjt_gym.gap.stages.chain import GEAR, LOAD, MOTOR, Chain
from cjt_gym.gap.stages.gains import gain_of
from cjt_gym.gap.stages.kernel import Measured
from cjt_gym.gap.stages.predictor import (
    Gain,
    Piece,
    Prediction,
    backlash,
    direct,
    run_predictor,
)
from cjt_gym.gap.stages.spring import spring_torque
from cjt_gym.gap.stages.stage_chains import stage_chain
from cjt_gym.joint.kernel.arrays import Floats

Added = Mapping[str, Floats]
STAGES = ("drive", "motor", "transmission", "load")
CHANNELS: Mapping[str, tuple[str, ...]] = {
    "drive": ("i", "i_cmd"),
    "motor": ("q_m",),
    "transmission": ("tau", "q_m", "q_l"),
    "load": ("q_l",),
}
"""Channels that must be measured for a sample of a stage to count."""
SPRINGS = ("k_b", "k_g")
"""Fields that noise of the angles is multiplied by."""
BENDS = ("play", "hard", "hyst")
"""Fields of a bar whose torque is not in proportion to its deflection."""
WAVES = 4
"""Number of frequencies for which sines and cosines of the motor's angles are kept."""
PULSE = 800
SMOOTH = 21


@dataclass(eq=False)
class Stages:
    """All stages of one record.

    Attributes:
        setting: The record and its joint.
        gains: Predictor gains by stage, for the fields given to `tune`.
        others: The stages of further records of the same joint, to be explained together.
        springs: What multiplies noise of the angles: the nominal joint with the stiffnesses of the
            fields given to `tune`.
    """

    setting: Setting
    gains: dict[str, Gain] = field(default_factory=dict)
    others: tuple[Stages, ...] = ()
    springs: Fields = field(default_factory=dict)
    _chains: dict[tuple[object, ...], Chain] = field(default_factory=dict)
    _seen_waves: dict[float, tuple[Floats, Floats]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.springs = self.springs or self.setting.nominal

    @property
    def names(self) -> tuple[str, ...]:
        """Stages that this record allows."""
        s = self.setting
        there = {
            "drive": "i" in s.series and "i_cmd" in s.series,
            "motor": True,
            "transmission": s.cut is Cut.BY_TORQUE
            and ("q_l" in s.series or s.structure.output_fixed)
            and "q_m" not in s.series.derived,
            "load": s.cut is Cut.BY_ANGLES
            or (
                s.cut is Cut.BY_TORQUE
                and not s.structure.output_fixed
                and "q_l" in s.series
                and not s.still_load
            ),
        }
        return tuple(name for name in STAGES if there[name])

    @cached_property
    def outside(self) -> Outside:
        """Causes outside the effect table that may act beside the model."""
        return outside_rows(self.setting)

    def tune(self, fields: Fields) -> None:
        """Compute the predictors' gains, and noise effects in the springs, for these fields."""
        self.springs = self.setting.nominal | {name: fields[name] for name in SPRINGS}
        for cached in ("spring_noise", "_shaken_angles"):
            self.__dict__.pop(cached, None)
        for name in self.names:
            if name in ("motor", "load"):
                chain = self.chain(name, fields)
                self.gains[name] = gain_of(self.setting, self.springs, name, fields, chain)
        for number, other in enumerate(self.others, 1):
            other.tune(of_record(fields, number))

    def predict(self, name: str, fields: Fields) -> Prediction:
        """Return the prediction of a stage."""
        added = self._added(fields)
        series = corrected(self.setting.series, added)
        run: dict[str, Callable[[Fields, Series, Added], Prediction]] = {
            "drive": self._drive,
            "motor": self._motor,
            "transmission": self._transmission,
            "load": self._load,
        }
        return run[name](fields, series, added)

    def _added(self, fields: Fields) -> Added:
        """Return the sum of the causes outside the effect table on each channel."""
        if not any("." in key for key in fields):
            return {}
        return disturbing(fields, self.setting.series, self.outside.disturbances)

    def residual(self, name: str, fields: Fields) -> Floats:
        """Return the normalised residual of a stage over all records, shape (N,)."""
        own = self.predict(name, fields).residual
        more = [
            other.residual(name, of_record(fields, number))
            for number, other in enumerate(self.others, 1)
            if name in other.names
        ]
        return np.concatenate([own, *more]) if more else own

    def count(self, name: str) -> int:
        """Return how many samples of a stage count, over all records.

        A residual may well be zero where it counts: a simulated record without noise fits exactly.
        """
        good = self.setting.series.measured(*CHANNELS[name])
        more = (other.count(name) for other in self.others if name in other.names)
        return int(np.count_nonzero(good[self.setting.settle :])) + sum(more)

    def first(self, residuals: Mapping[str, Floats]) -> dict[str, Floats]:
        """Return the part of the residuals that belongs to the first record."""
        return {name: r[: len(self.setting.series)] for name, r in residuals.items()}

    # ---- drive
    def _drive(self, fields: Fields, series: Series, added: Added) -> Prediction:
        s = self.setting
        error = series["i"] - commanded_current(fields, series) - fields["i_0"]
        std = np.hypot(s.std("i"), s.unseen("i_cmd"))
        return direct(error, std, s, CHANNELS["drive"])

    # ---- motor
    def _motor(self, fields: Fields, series: Series, added: Added) -> Prediction:
        s = self.setting
        chain = self.chain("motor", fields)
        transmitted = self.transmitted(fields, series)
        torque = motor_torque(fields, series) + added.get("push_m", 0.0)
        if fields["cog_f"] != 0.0 or fields["rip_f"] != 0.0:
            torque += self._ripple(fields, series, transmitted)
        forced = torque[:, None] * chain.torque[:, MOTOR]
        forced += torque_rise(fields, series)[:, None] * chain.ramp[:, MOTOR]
        if chain.groups[LOAD] >= 0 and (outside := self._on_load(fields)) is not None:
            forced += passed_on(chain, LOAD, outside)
        if s.cut is Cut.BY_TORQUE:
            forced -= passed_on(chain, GEAR, transmitted)
        elif s.has_spring and chain.groups[LOAD] < 0:
            forced += self._hung(chain, load_angle(series) + fields["q_0"], GEAR, fields["k_b"])
            if (bent := self._bent(fields, series)) is not None:
                forced -= passed_on(chain, GEAR, bent)
        bodies = (("m", MOTOR),) if not s.has_gear else (("m", MOTOR), ("g", GEAR))
        if chain.groups[LOAD] >= 0:
            bodies = (*bodies, ("l", LOAD))
        play = None
        if fields["play_g"] > 0.0 and s.has_gear and s.cut is Cut.BY_TORQUE:
            loose = self.chain("motor loose", fields)
            adrift = torque[:, None] * loose.torque[:, MOTOR] - passed_on(loose, GEAR, transmitted)
            bite = (chain.torque[:, MOTOR] - chain.torque[:, GEAR]) * fields["k_g"]
            play = backlash(fields, np.array([1.0, -1.0, 0.0, 0.0]), bite, loose, adrift, None)
        piece = Piece(chain, forced, bodies, transmitted, play, added.get("rub_m"))
        return self._innovations("motor", series, fields, piece)

    def transmitted(self, fields: Fields, series: Series) -> Floats:
        """Return the torque through the joint [N m], zeros if it is not seen; shape (N,)."""
        if "tau" in series:
            return joint_torque(fields, series)
        if self.setting.cut is not Cut.BY_ANGLES:
            return np.zeros(len(series))
        return self._by_angles(fields, series, self._bent(fields, series))

    def _by_angles(self, fields: Fields, series: Series, bent: Floats | None) -> Floats:
        """Return the torque of a bar by its deflection, undamped [N m], shape (N,)."""
        torque = fields["k_b"] * self._deflection(fields, series)
        return torque if bent is None else np.asarray(torque + bent)

    def _deflection(self, fields: Fields, series: Series) -> Floats:
        """Return the bar's share of the difference of the two angles [rad], shape (N,)."""
        turned = series["q_m"] - load_angle(series) - fields["q_0"]
        if not self.setting.has_gear:
            return turned
        return np.asarray(turned * fields["k_g"] / (fields["k_g"] + fields["k_b"]))

    def _bent(self, fields: Fields, series: Series) -> Floats | None:
        """Return what a bar's torque differs from a linear one's [N m], None for a linear one."""
        if not any(fields[name] for name in BENDS):
            return None
        turned = self._deflection(fields, series)
        undamped = fields if fields["play"] > 0.0 else fields | {"d_gl": 0.0}
        linear = fields["k_b"] * turned
        if fields["play"] > 0.0:
            linear = linear + fields["d_gl"] * np.gradient(turned, series.dt)
        return spring_torque(undamped, turned, series.dt) - linear

    def _on_load(self, fields: Fields) -> Floats | None:
        """Return what acts on a load that is part of the motor's stage [N m], None for nothing."""
        series = self.setting.series
        outside: Floats | None = None
        if "tau_l" in series:
            outside = series["tau_l"]
        if self.setting.has_spring or (fields["grav_a"] == 0.0 and fields["grav_b"] == 0.0):
            return outside
        hanging = -weight(fields, series["q_m"])
        return hanging if outside is None else np.asarray(outside + hanging)

    def _ripple(self, fields: Fields, series: Series, transmitted: Floats) -> Floats:
        """Return the mean of the periodic torques over each interval [N m], shape (N,)."""
        q = series["q_m"]
        total = np.zeros(len(q))
        if fields["cog_f"] != 0.0:
            cosine, sine = self._waves(fields["cog_f"], q)
            total += MEAN @ (fields["cog_a"] * cosine + fields["cog_b"] * sine)
        if fields["rip_f"] != 0.0:
            if self.setting.has_gear:  # a compliant gear also carries what moves itself
                speed, acceleration = self._motion
                transmitted = transmitted + fields["I_g"] * acceleration + fields["d_g"] * speed
            cosine, sine = self._waves(fields["rip_f"], q)
            share = fields["rip_a"] * cosine + fields["rip_b"] * sine
            total += MEAN @ (share * within(transmitted))
        return total

    def _waves(self, frequency: float, q: Floats) -> tuple[Floats, Floats]:
        """Return cosine and sine of a multiple of angles between the samples, shape (5, N) each."""
        own = q is self.setting.series["q_m"]
        found = self._seen_waves.get(frequency) if own else None
        if found is None:
            x = frequency * (self._angles_within if own else within(q))
            found = np.cos(x), np.sin(x)
            if own:
                if len(self._seen_waves) > WAVES:
                    self._seen_waves.clear()
                self._seen_waves[frequency] = found
        return found

    @cached_property
    def _angles_within(self) -> Floats:
        """Angles of the motor between the samples, shape (5, N)."""
        return within(self.setting.series["q_m"])

    @cached_property
    def _motion(self) -> tuple[Floats, Floats]:
        """Velocity and acceleration of the motor, smoothed, each of shape (N,)."""
        q, dt = self.setting.series["q_m"], self.setting.series.dt
        speed, acceleration = (savgol_filter(q, SMOOTH, 3, deriv=d, delta=dt) for d in (1, 2))
        return speed, acceleration

    # ---- transmission
    def _transmission(self, fields: Fields, series: Series, added: Added) -> Prediction:
        s = self.setting
        q_l = load_angle(series)
        q_g, states, friction = self._gear_angle(fields, series)
        deflection = q_g - q_l - fields["q_0"]
        torque = spring_torque(fields, deflection, series.dt, added.get("slack"))
        torque += added.get("bar", 0.0)
        model = fields["gain"] * torque + fields["tau_0"]
        own, angles = self.spring_noise
        if fields["late"] != 0.0:
            model = shifted(model, -fields["late"] / series.dt)
            angles *= shift_noise(-fields["late"] / series.dt)
        model = model - fields["skew"] * series.speed("tau")
        slope = series.speed("tau") * s.noise["tau"].jitter
        std = np.sqrt(own**2 + angles**2 + slope**2 + self._shaken_angles)
        result = direct(series["tau"] - model, std, s, CHANNELS["transmission"])
        return Prediction(result.residual, states, friction)

    @cached_property
    def _shaken_angles(self) -> Floats:
        """Variance of the spring's torque that jittering angles cause [N^2 m^2], shape (N,)."""
        s, f = self.setting, self.springs
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
        s, f, dt = self.setting, self.springs, self.setting.series.dt
        pulse = np.zeros(PULSE)
        pulse[PULSE // 4] = 1.0

        def bar(angle: Floats) -> Floats:
            return f["k_b"] * angle + f["d_gl"] * np.gradient(angle, dt)

        if not s.has_gear:
            angle = float(np.linalg.norm(bar(pulse)))
            return s.std("tau"), angle * float(np.hypot(s.std("q_m"), s.std("q_l")))
        chain = self.chain("transmission", f)
        drives = (
            -passed_on(chain, GEAR, pulse),
            self._prescribed(chain, pulse),
        )
        nothing = np.zeros(PULSE)
        by_torque, by_motor = (
            run_predictor(f, Piece(chain, drive, (), nothing), np.zeros(2), dt)[1][:, 0]
            for drive in drives
        )
        own = s.std("tau") * float(np.linalg.norm(pulse - bar(by_torque)))
        motor = s.std("q_m") * float(np.linalg.norm(bar(by_motor)))
        return own, float(np.hypot(motor, s.std("q_l") * np.linalg.norm(bar(pulse))))

    def _gear_angle(self, fields: Fields, series: Series) -> tuple[Floats, Floats, Floats]:
        """Return the gear's angle [rad] from motor angle and torque, its states and friction."""
        s = self.setting
        q_m = series["q_m"]
        if not s.has_gear:
            return q_m, np.zeros((len(q_m), 0)), np.zeros((len(q_m), 0))
        chain = self.chain("transmission", fields)
        transmitted = joint_torque(fields, series)
        forced = self._prescribed(chain, q_m) - passed_on(chain, GEAR, transmitted)
        x0 = np.array([q_m[0] - transmitted[0] / fields["k_g"] - fields["centre_g"], 0.0])
        play = None
        if fields["play_g"] > 0.0:
            loose = self.chain("transmission loose", fields)
            adrift = -passed_on(loose, GEAR, transmitted)
            bite = -chain.torque[:, GEAR] * fields["k_g"]
            play = backlash(fields, np.array([-1.0, 0.0]), bite, loose, adrift, q_m)
        piece = Piece(chain, forced, (("g", GEAR),), transmitted, play)
        _, states, friction = run_predictor(fields, piece, x0, series.dt)
        return states[:, 0], states, friction

    # ---- load
    def _load(self, fields: Fields, series: Series, added: Added) -> Prediction:
        s, chain = self.setting, self.chain("load", fields)
        bodies: tuple[tuple[str, int], ...] = (("l", LOAD),)
        if s.cut is Cut.BY_ANGLES:
            bent = self._bent(fields, series)
            transmitted = self._by_angles(fields, series, bent)
            torque = np.zeros(len(series)) if bent is None else bent
            bodies = bodies if not s.has_gear else (*bodies, ("g", GEAR))
        else:
            transmitted = torque = joint_torque(fields, series)
        if fields["grav_a"] != 0.0 or fields["grav_b"] != 0.0:
            torque = torque - weight(fields, series["q_l"])
        if "tau_l" in series:
            torque = torque + series["tau_l"]
        torque = torque + added.get("push_l", 0.0)
        forced = passed_on(chain, LOAD, torque)
        if s.cut is Cut.BY_ANGLES:
            body, stiffness = (GEAR, fields["k_g"]) if s.has_gear else (LOAD, fields["k_b"])
            forced += self._hung(chain, series["q_m"] - fields["q_0"], body, stiffness)
            if s.has_gear and bent is not None:
                forced -= passed_on(chain, GEAR, bent)
        piece = Piece(chain, forced, bodies, transmitted)
        return self._innovations("load", series, fields, piece)

    # ---- shared
    def _prescribed(self, chain: Chain, q: Floats) -> Floats:
        """Return the contribution of a prescribed angle over each sample, shape (N, n)."""
        rate = (ahead(q) - q) / self.setting.series.dt
        return q[:, None] * chain.start + rate[:, None] * chain.slope

    def _hung(self, chain: Chain, q: Floats, body: int, stiffness: float) -> Floats:
        """Return the contribution of the measured far end of a spring on a body, shape (N, n).

        Within a sample a motor that accelerates strays from a straight line by more torque than
        noise of fine encoders makes.
        """
        strays = stiffness * (smooth_mean(q) - interval_mean(q, 0.5))
        return self._prescribed(chain, q) + strays[:, None] * chain.torque[:, body]

    def chain(self, name: str, fields: Fields) -> Chain:
        """Return the chain of a stage."""
        key = (name, *(fields[f] for f in CHAIN))
        found = self._chains.get(key)
        if found is None:
            if len(self._chains) > 64:
                self._chains.clear()
            self._chains[key] = found = stage_chain(self.setting, name, fields)
        return found

    def _innovations(self, name: str, series: Series, fields: Fields, piece: Piece) -> Prediction:
        channel = "q_m" if name == "motor" else "q_l"
        x0 = self._initial(series, channel, fields, piece)
        gain = self.gains[name]
        y = np.ascontiguousarray(series[channel])
        seen = Measured(gain.k, y, series.valid[channel])
        e, states, friction = run_predictor(fields, piece, x0, series.dt, seen)
        residual = np.where(seen.valid, e / gain.scatter, 0.0)
        first = residual[: len(gain.start)]
        first -= gain.start @ (gain.start.T @ first)
        residual[: self.setting.settle] = 0.0
        return Prediction(residual, states, friction)

    def _initial(self, series: Series, channel: str, fields: Fields, piece: Piece) -> Floats:
        """Return the first state: at the measured angle, at the velocity of the first samples."""
        chain = piece.chain
        x0 = np.zeros(chain.a.shape[0])
        x0[: chain.size], x0[chain.size :] = series[channel][0], series.first_speed(channel)
        if self.setting.has_gear and channel == "q_m":
            x0[1] -= piece.transmitted[0] / fields["k_g"] + fields["centre_g"]
        elif chain.size > 1 and channel == "q_l":
            x0[1] += piece.transmitted[0] / fields["k_b"]
        return x0


def passed_on(chain: Chain, body: int, torque: Floats) -> Floats:
    """Return the contribution of a smooth torque on a body over each sample, shape (N, n).

    Args:
        chain: The stage's piece of the joint.
        body: MOTOR, GEAR or LOAD.
        torque: At the samples [N m], shape (N,).
    """
    rise = ahead(torque) - torque
    return np.asarray(
        smooth_mean(torque)[:, None] * chain.torque[:, body] + rise[:, None] * chain.ramp[:, body]
    )


def load_angle(series: Series) -> Floats:
    """Return the angle of the load [rad], shape (N,); zero where it is not measured."""
    return series["q_l"] if "q_l" in series else np.zeros(len(series))
