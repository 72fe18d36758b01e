"""One row of the effect table."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from cjt_gym.joint.structures import Structure

STAGES = ("drive", "motor", "transmission", "sensing", "load")
BODIES = {"m": "motor", "g": "gear", "l": "load"}
FRICTION_STEMS = ("d_", "d_c", "d_s", "mu_", "sigma_")
CHANNEL_UNITS = {"i": "A", "q_m": "rad", "q_g": "rad", "q_l": "rad", "tau": "N m"}
PLACES = {
    "": "everywhere",
    "spring": "a structure with a spring (not rigid)",
    "bar": "a structure with a torsion bar (not rigid)",
    "gear": "a structure with a compliant gearbox (full_dynamics, output_fixed)",
    "free_load": "a structure with a free load",
    "fixed_load": "a structure with a prescribed load motion (output_fixed...)",
    "voltage": "a drive with a voltage (static, rl, dq)",
}


@dataclass(frozen=True)
class EffectParameter:
    """One number (or series of numbers) of an effect.

    Attributes:
        symbol: Its name.
        unit: SI unit on the link side of a rotary joint.
        neutral: The value at which the effect is off; None where that is the joint's own value of
            `relative_to`.
        low: Low end of the plausible range.
        high: High end of the plausible range.
        description: What it is.
        fields: Kernel parameters to which it adds what differs from neutral; one that is the
            same as `relative_to` is replaced.
        joint_parameter: Parameter or `sensors.<channel>.<key>` of the joint file it defaults to.
        default: Value where neither the user nor the joint file gives one; None asks for it.
        relative_to: Kernel parameter whose value is neutral.
        series: Whether it is a series of numbers.
        shared: Whether it is one number per joint, which all effects that name it share.
        maximum: Value beyond which it has no meaning.
        typical: A material value for studies over all effects, in units of `typical_of`.
        typical_of: "torque" (peak motor torque), "current" (peak current), a joint parameter, or
            "" for the unit itself.
    """

    symbol: str
    unit: str
    neutral: float | None
    low: float
    high: float
    description: str
    fields: tuple[str, ...] = ()
    joint_parameter: str | None = None
    default: float | None = None
    relative_to: str | None = None
    series: bool = False
    shared: bool = False
    maximum: float = math.inf
    typical: float | tuple[float, ...] = 0.0
    typical_of: str = ""

    @property
    def signed(self) -> bool:
        """Whether it may be negative."""
        return self.low < 0.0

    @property
    def replaces(self) -> bool:
        """Whether it takes the place of a parameter of the joint."""
        return self.relative_to is not None and self.fields == (self.relative_to,)


def number(
    symbol: str,
    unit: str,
    high: float,
    description: str,
    *fields: str,
    low: float = 0.0,
    **more: Any,
) -> EffectParameter:
    """Return a parameter that is off at zero, whose typical value is its default unless given."""
    more = {"typical": more.get("default", 0.0)} | more
    return EffectParameter(symbol, unit, 0.0, low, high, description, fields, **more)


def own_value(
    symbol: str,
    unit: str,
    low: float,
    high: float,
    description: str,
    typical: float = 0.0,
    typical_of: str | None = None,
) -> EffectParameter:
    """Return a parameter that takes the place of the joint's own of the same name.

    Its typical value is in units of the joint's own unless `typical_of` says otherwise.
    """
    scaled: dict[str, Any] = {"typical": typical, "typical_of": typical_of or symbol}
    neutral = {"relative_to": symbol} | (scaled if typical else {})
    return EffectParameter(symbol, unit, None, low, high, description, (symbol,), **neutral)


@dataclass(frozen=True)
class Effect:
    """One row of the table.

    Attributes:
        name: Its name in every interface.
        stage: Where it shows itself, one of `STAGES`.
        summary: One line of physics.
        source: Where that comes from.
        parameters: Its numbers.
        size: Symbols that make it do something; the others only shape it. None shapes it only
            where this is left out.
        excludes: Effects that describe the same thing.
        needs: Where it can act, a key of `PLACES`.
    """

    name: str
    stage: str
    summary: str
    source: str
    parameters: tuple[EffectParameter, ...]
    size: tuple[str, ...] = ()
    excludes: tuple[str, ...] = ()
    needs: str = ""

    def __post_init__(self) -> None:
        if not self.size:
            object.__setattr__(self, "size", tuple(p.symbol for p in self.parameters))

    @property
    def bodies(self) -> tuple[str, ...]:
        """Bodies on which its friction acts; empty for other effects."""
        found = {body_of(p.symbol) for p in self.parameters}
        return tuple(name for name in BODIES.values() if name in found)

    @property
    def channels(self) -> tuple[str, ...]:
        """Measured channels on which it can act; empty where that is not a choice."""
        return tuple(p.symbol for p in self.parameters if p.symbol in CHANNEL_UNITS)

    def parameter(self, symbol: str) -> EffectParameter | None:
        """Return the parameter of that symbol, or None."""
        return next((p for p in self.parameters if p.symbol == symbol), None)

    def domain(self, parameter: EffectParameter) -> tuple[float, bool, float]:
        """Return the least value of a parameter, whether it is excluded, and the greatest.

        A number that is never zero in its range must be positive where it only shapes the effect
        or takes the place of a parameter of the joint.
        """
        if parameter.signed:
            return -math.inf, False, parameter.maximum
        shapes = parameter.symbol not in self.size
        return 0.0, (shapes or parameter.replaces) and parameter.low > 0.0, parameter.maximum

    def acts_in(self, structure: Structure, drive: str) -> bool:
        """Whether it can act in that structure with that drive."""
        motor, gear, load = structure.groups
        return {
            "": True,
            "spring": motor != load,
            "bar": gear != load,
            "gear": motor != gear,
            "free_load": load >= 0,
            "fixed_load": load < 0,
            "voltage": drive != "current",
        }[self.needs]


def effect(
    stage: str, name: str, summary: str, source: str, *parameters: EffectParameter, **more: Any
) -> Effect:
    """Return a row of a stage."""
    return Effect(name, stage, summary, source, parameters, **more)


def body_of(symbol: str) -> str | None:
    """Return the body on which a parameter of friction acts, or None."""
    core = symbol.removesuffix("_n")
    return BODIES.get(core[-1]) if core[:-1] in FRICTION_STEMS else None


def per_body(
    symbol: str,
    unit: str,
    high: float,
    text: str,
    typical: float,
    typical_of: str = "",
    *,
    fields: tuple[str, ...] | None = None,
    joint_parameter: str | None = None,
    relative_to: str | None = None,
) -> tuple[EffectParameter, ...]:
    """Return one parameter for each of motor, gear and load.

    The letter of the body replaces * in every name, and its name replaces {body} in the text.
    Kernel parameters are named like the symbol unless `fields` says otherwise. The typical value
    is that of the motor, and zero on the others.
    """

    def own(name: str | None, letter: str) -> str | None:
        return name and name.replace("*", letter)

    return tuple(
        EffectParameter(
            symbol.replace("*", letter),
            unit,
            None if relative_to else 0.0,
            0.0,
            high,
            text.replace("*", letter).format(body=body),
            tuple(field.replace("*", letter) for field in fields or (symbol,)),
            own(joint_parameter, letter),
            None if relative_to else 0.0,
            own(relative_to, letter),
            typical=typical if letter == "m" else 0.0,
            typical_of=typical_of if letter == "m" else "",
        )
        for letter, body in BODIES.items()
    )


def per_channel(
    stem: str,
    text: str,
    high: dict[str, float],
    typical: dict[str, float],
    *,
    unit: str | None = None,
    neutral: float = 0.0,
    signed: bool = False,
    sensor_key: str | None = None,
) -> tuple[EffectParameter, ...]:
    """Return one parameter for each channel named in `high`.

    Kernel parameters are `<stem>_<channel>`; the channel is added to the text. {} in the unit is
    that of the channel. The typical value is neutral where absent, and the default is what the
    joint file has under [sensors.<channel>] as `sensor_key`.
    """
    return tuple(
        EffectParameter(
            channel,
            (unit or "{}").format(CHANNEL_UNITS[channel]),
            neutral,
            -top if signed else 0.0,
            top,
            f"{text} of {channel}",
            (f"{stem}_{channel}",),
            f"sensors.{channel}.{sensor_key}" if sensor_key else None,
            default=neutral,
            typical=typical.get(channel, neutral),
        )
        for channel, top in high.items()
    )
