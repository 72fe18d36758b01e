"""What all stages of one diagnosis share: the record, the nominal joint and the noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cjt_gym.gap.recorded.cut import Cut, cut_of
from cjt_gym.gap.recorded.fields import Fields, nominal_fields
from cjt_gym.gap.recorded.listed import Place, with_listed
from cjt_gym.gap.recorded.noise import ChannelNoise, channel_noise
from cjt_gym.gap.recorded.series import Series, compliance, to_series
from cjt_gym.joint import JointFile, Structure
from cjt_gym.records import Record

PROCESS_TORQUE = 0.2
"""Torque noise on the motor, as a share of that equivalent to the noise of its signals."""
CLEAR = 0.5
"""Ratio of scatter from jitter to other noise above which a channel reveals the jitter."""
LEAST_JITTER = 0.5
"""Share of the stated jitter that is always allowed for."""
FOLLOWED = 0.1
"""Periods of a swing per sample up to which a slow log follows it."""
MOVES, FOLLOWS = 1.3, 5.0
"""Spread of a locked output's angle, in deviations of its noise, and its correlation with the
torque, in deviations of chance, from which it moves."""
STILL = 1e-12
"""Deviation of the angle of an output that does not move [rad]."""
SETTLE = 0.05
"""Settling time of a predictor before its residuals count [s]."""


@dataclass(frozen=True, eq=False)
class Setting:
    """One record, ready to be predicted.

    Attributes:
        series: The record's channels.
        structure: How the bodies are joined.
        joint: The nominal joint.
        nominal: Its fields.
        noise: Scatter of each channel.
        process: Torque noise on the motor beyond what is specified [N m].
        allowance: Factor by which the motor's residual may exceed what white noise explains.
        still_load: Whether a load that could move does not.
        listed: What each effect that the joint file lists adds to the fields.
    """

    series: Series
    structure: Structure
    joint: JointFile
    nominal: Fields
    noise: Mapping[str, ChannelNoise]
    process: float = 0.0
    allowance: float = 1.0
    still_load: bool = False
    listed: Mapping[str, Fields] = field(default_factory=dict)

    def std(self, channel: str) -> float:
        """Return the deviation of one sample of a channel; 0 where it is not measured."""
        return self.noise[channel].std if channel in self.noise else 0.0

    @property
    def has_spring(self) -> bool:
        """Whether a torsion bar separates motor side and load."""
        return self.structure.has_spring

    @property
    def has_gear(self) -> bool:
        """Whether the gearbox is compliant."""
        return self.structure.has_gear

    @cached_property
    def cut(self) -> Cut:
        """What cuts the joint at its spring."""
        measured = self.series.columns.keys() - self.series.derived
        return cut_of(self.structure, measured, still_load=self.still_load)

    def stages_of(self, *cut: str) -> tuple[str, ...]:
        """Return the stages in which something shows that would show in these of a cut joint.

        Where no torque was measured, a spring is part of the stages at its ends.
        """
        if self.cut is Cut.BY_TORQUE:
            return cut
        ends = ("motor", "load") if self.cut is Cut.BY_ANGLES else ("motor",)
        own = {"transmission": ends, "load": ends[-1:]}
        return tuple(dict.fromkeys(s for name in cut for s in own.get(name, (name,))))

    @property
    def sprung_torque(self) -> float:
        """Spread of the torque in the spring, measured or that of its deflection [N m]."""
        if "tau" in self.series:
            return float(np.std(self.series["tau"]))
        return self.nominal["k_b"] * float(np.std(self.twist)) if self.cut is Cut.BY_ANGLES else 0.0

    @property
    def current_unspecified(self) -> bool:
        """Whether the accuracy of the motor's torque is unspecified."""
        return "i" not in self.series or "i" not in self.joint.sensors

    @property
    def command_unit(self) -> str:
        """Return the unit of current and its command, which may be a voltage for some drives."""
        return "V" if self.joint.parameters.unit("k_t").endswith("/V") else "A"

    @property
    def too_slow(self) -> bool:
        """Whether the motor swings on its spring too fast for the log to follow its torque."""
        stiffness, inertia = self.nominal["k_b"], self.nominal["I_m"]
        if self.cut is Cut.NOWHERE or not self.series.slow or inertia <= 0.0:
            return False
        return float(np.sqrt(stiffness / inertia)) / (2.0 * np.pi) * self.series.dt > FOLLOWED

    def unseen(self, channel: str) -> NDArray[np.float64]:
        """Return the deviation due to not knowing when within a sample a signal changes."""
        if self.series.slow:
            return np.asarray(self.series.change(channel) / np.sqrt(12.0))
        slope = self.noise[channel].jitter if channel in self.noise else 0.0
        return np.asarray(slope * self.series.speed(channel))

    @property
    def twist(self) -> NDArray[np.float64]:
        """Difference of the angles at both ends of spring and gear, shape (N,)."""
        series = self.series
        return series["q_m"] - series["q_l"] if "q_l" in series else series["q_m"]

    @property
    def relaxed(self) -> float:
        """Difference at which the spring is relaxed [rad]: encoders have arbitrary zeros."""
        if self.cut is Cut.BY_ANGLES:
            return float(np.median(self.twist))
        if self.cut is not Cut.BY_TORQUE:
            return 0.0
        f = self.nominal
        stiffness = f["k_b"] * f["k_g"] / (f["k_b"] + f["k_g"]) if self.has_gear else f["k_b"]
        return float(np.median(self.twist - self.series["tau"] / stiffness))

    @property
    def settle(self) -> int:
        """Number of samples before residuals count."""
        return max(int(SETTLE / self.series.dt), 5)


def make_setting(
    record: Record,
    joint: JointFile,
    structure: Structure,
    zero_at: Mapping[str, float] | None = None,
    log: Sequence[Record] = (),
) -> Setting:
    """Return the setting of a record; see `to_series` for the arguments."""
    series = to_series(record, joint, structure, zero_at, log)
    sampling = joint.sampling.get("jitter")
    jitter = sampling.number if sampling is not None else 0.0
    logged = {name: record[name] for name in record.columns}
    noise = {
        name: channel_noise(series, joint, name, jitter, logged.get(name))
        for name in series.columns
        if name != "i_cmd"
    }
    shown = _common_jitter(series, noise, jitter)
    noise = {name: replace(known, jitter=shown) for name, known in noise.items()}
    still = "q_l" in series and _is_still(series, noise["q_l"])
    if structure.output_fixed and still:
        held = {"q_l": np.full(len(series), float(np.mean(series["q_l"])))}
        series = replace(series, columns={**series.columns, **held})
        noise["q_l"] = replace(noise["q_l"], std=STILL, jitter=0.0)
    if "q_m" in series.derived:
        std = noise["tau"].std * compliance(joint, structure)
        noise["q_m"] = replace(noise["q_m"], std=std, jitter=0.0)
    bare = Setting(series, structure, joint, nominal_fields(joint, structure), noise)
    in_gear = bare.has_gear and bare.cut is Cut.BY_TORQUE
    at = Place(series.zero.get("q_m", 0.0), bare.relaxed, in_gear, "tau" in series)
    nominal, listed = with_listed(joint, structure, bare.nominal, at)
    still_load = still and bare.has_spring and not structure.output_fixed
    return replace(bare, nominal=nominal, listed=listed, still_load=still_load)


def _is_still(series: Series, noise: ChannelNoise) -> bool:
    """Return whether a locked output shows no more than noise of its encoder.

    The angle of a yielding output follows the torque.
    """
    angle = series["q_l"] - np.mean(series["q_l"])
    spread = float(np.std(angle))
    if spread == 0.0:
        return True
    torque = series["tau"] - np.mean(series["tau"]) if "tau" in series else np.zeros(len(angle))
    follows = float(angle @ torque) / max(spread * float(np.std(torque)) * len(angle), 1e-300)
    return spread < MOVES * noise.std and abs(follows) < FOLLOWS / np.sqrt(len(angle))


def as_noisy(setting: Setting, known: Setting) -> Setting:
    """Return a setting with the noise that another record of the same joint has shown."""
    noise = {
        name: replace(own, std=max(own.std, known.noise[name].std), jitter=known.noise[name].jitter)
        if name in known.noise
        else own
        for name, own in setting.noise.items()
    }
    return replace(setting, noise=noise, process=known.process, allowance=known.allowance)


def _common_jitter(series: Series, noise: Mapping[str, ChannelNoise], stated: float) -> float:
    """Return the deviation of the sampling times [s], which all channels of a record share.

    It is that of the channel that reveals it best; if none does, the stated jitter.
    """

    def clear(name: str) -> float:
        fast = float(np.quantile(np.abs(series.speed(name)), 0.9))
        return max(stated, noise[name].jitter) * fast / noise[name].std

    smooth = [name for name in noise if name != "i"]  # a current may jump
    best = max(smooth, key=clear, default=None)
    if best is None or clear(best) < CLEAR:
        return stated
    return max(noise[best].jitter, LEAST_JITTER * stated)
