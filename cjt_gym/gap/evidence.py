"""Data behind a report's charts: regimes, maps, replays, and what a diagnosis was made from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from cjt_gym.joint.kernel.arrays import Floats


@dataclass(frozen=True)
class Regime:
    """Where in its operating range a stage's gap lies.

    Attributes:
        stage: The stage.
        variable: Column, "t", "frequency" or "cycles_per_rev".
        low: Low end of the range.
        high: High end of the range.
        unit: Unit of both.
        share: Share of the stage's excess residual; the shares over one variable sum to 1.
    """

    stage: str
    variable: str
    low: float
    high: float
    unit: str
    share: float


@dataclass(frozen=True)
class Step:
    """The replay error on held-out data of one model of the ladder from nominal to explained.

    Attributes:
        name: "nominal", "tolerances" or the effect that this model adds to the previous one.
        body: motor, gear or load, or None.
        channel: Channel of the effect, or None.
        error: Error relative to the rms of the signal.
        low: Low end of its 95 % interval, by a bootstrap over blocks.
        high: High end.
    """

    name: str
    body: str | None
    channel: str | None
    error: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class FrictionMap:
    """Unexplained torque of a body over its velocity.

    Torques have the sign of friction: positive if they resist positive motion.
    """

    stage: str  # motor or load
    speed: Floats  # velocity of the body [rad/s], shape (N,)
    before: Floats  # torque that the nominal joint does not explain [N m], shape (N,)
    after: Floats  # torque that the explained joint does not [N m], shape (N,)
    law_speed: Floats  # velocities of the law [rad/s], shape (M,)
    law: Floats  # friction that the effects add [N m], shape (M,)


@dataclass(frozen=True, eq=False)
class RippleSpectrum:
    """Torque on the motor that repeats with its angle."""

    # spatial frequency, cycles per revolution (per 2 pi m of a prismatic axis), shape (F,)
    cycles: Floats
    before: Floats  # amplitude left by the nominal joint [N m], shape (F,)
    after: Floats  # amplitude left by the explained one [N m], shape (F,)


@dataclass(frozen=True, eq=False)
class SpringLoop:
    """Transmitted torque over the deflection of the spring."""

    deflection: Floats  # [rad], shape (N,)
    measured: Floats  # measured torque [N m], shape (N,)
    before: Floats  # torque of the nominal spring [N m], shape (N,)
    after: Floats  # torque of the explained one [N m], shape (N,)
    stiffness: float  # nominal stiffness [N m/rad]


@dataclass(frozen=True)
class Source:
    """Inputs of the diagnosis."""

    joint: str = ""  # name of the nominal joint
    structure: str = ""  # how its bodies are joined
    fitted: tuple[str, ...] = ()  # description of the records used for the fit
    held_out: tuple[str, ...] = ()  # description of the records or parts withheld from it
    angle: str = "rad"  # unit of its angles, "rad" or "m"
    torque: str = "N m"  # unit of its torques, "N m" or "N"


@dataclass(frozen=True, eq=False)
class Evidence:
    """Data for a report's charts: maps of the fitted record, replays of the held-out one.

    Attributes:
        replays: Measured, nominal and explained signals by channel.
        replay_dt: Sample time of the replays [s].
        restarted: Interval after which each replay restarts from the measured state [s]; 0 for
            one replay of the whole record.
        ladder: Replay errors from the nominal joint to the explained one.
        regimes: For each stage with a gap its regimes before, and the remainder of each as a
            share of the same total; the stage with the largest gap first. Empty where the stages
            were not judged.
        friction: Friction maps.
        ripple: Torque that repeats with the motor's angle, if there is any motion.
        spring: Torque over deflection, if there is a spring between measurements.
        source: Inputs of the diagnosis.
    """

    replays: Mapping[str, Mapping[str, Floats]] = field(default_factory=dict)
    replay_dt: float = 1e-3
    restarted: float = 0.0
    ladder: tuple[Step, ...] = ()
    regimes: Mapping[str, tuple[tuple[Regime, ...], tuple[Regime, ...]]] = field(
        default_factory=dict
    )
    friction: tuple[FrictionMap, ...] = ()
    ripple: RippleSpectrum | None = None
    spring: SpringLoop | None = None
    source: Source = Source()
