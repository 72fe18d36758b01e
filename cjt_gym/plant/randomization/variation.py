"""How one number varies: the user's side of randomisation."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from cjt_gym.errors import (
    ConfigurationError,
    UnknownNameError,
    check_name,
    check_range,
    unknown_name,
)

OPERATIONS = ("set", "scale", "add")
TIMES = ("once", "reset", "interval", "drift")
ROUNDING = 1e-12  # of a sum of squares that is 1
TAILS = 4.0  # standard deviations at which a normal draw is cut off unless told otherwise
TAKES = {  # what a distribution needs, and what it may have besides
    "uniform": (("low", "high"), ()),
    "log_uniform": (("low", "high"), ()),
    "normal": (("mean", "std"), ("low", "high")),
    "choice": (("values",), ("weights",)),
}
DISTRIBUTIONS = tuple(TAKES)
SHAPES = ("low", "high", "mean", "std", "values", "weights")


@dataclass(frozen=True)
class Variation:
    """How one number varies.

    `low`, `high`, `mean`, `std` and `values` are factors where `operation` is "scale", otherwise
    in the unit of what varies. A normal draw is always cut off, as no parameter is unbounded.

    Attributes:
        low: Low end of the draw; of a normal one mean - 4 std if absent.
        high: High end of the draw; of a normal one mean + 4 std if absent.
        distribution: "uniform", "log_uniform", "normal" or "choice".
        operation: "scale" multiplies the nominal value, "add" adds to it, "set" replaces it.
        mean: Mean of a normal draw, before it is cut off.
        std: Its standard deviation, in the same unit.
        values: What a choice is made from.
        weights: How likely each value is, in any unit; equally if absent.
        when: "reset", at each start of an episode; "once", at the first one after seeding;
            "interval", at the start and every `interval` within the episode; "drift", at the start
            and then slowly, such that at any time the value has the distribution (an
            Ornstein-Uhlenbeck walk of its normal score).
        interval: Time between two draws [s], to the nearest control step.
        time_constant: Time over which the correlation of a drift falls to 37 % [s].
        group: Names with the same group share one draw; of several groups, a mixture.
        correlation: Correlation of the normal score with that of the group, in [-1, 1]; of several
            groups, with that of each.

    Raises:
        UnknownNameError: A distribution, operation or time is not known.
        ConfigurationError: A number is missing, not finite, out of range, or has no meaning here.

    Example:
        >>> Variation(distribution="normal", mean=1.0, std=0.05).high
        1.2
    """

    low: float | None = None
    high: float | None = None
    distribution: str = "uniform"
    operation: str = "scale"
    mean: float | None = None
    std: float | None = None
    values: tuple[float, ...] = ()
    weights: tuple[float, ...] = ()
    when: str = "reset"
    interval: float | None = None
    time_constant: float | None = None
    group: str | tuple[str, ...] | None = None
    correlation: float | tuple[float, ...] = 1.0

    def __post_init__(self) -> None:
        for key, known in (
            ("distribution", DISTRIBUTIONS),
            ("operation", OPERATIONS),
            ("when", TIMES),
        ):
            check_name(key, getattr(self, key), known)
        _check_keys(self)
        for key in ("low", "high", "mean", "std", "interval", "time_constant"):
            if getattr(self, key) is not None:
                object.__setattr__(self, key, _finite(key, getattr(self, key)))
        for key in ("values", "weights"):
            object.__setattr__(self, key, _series(key, getattr(self, key)))
        if self.distribution == "choice":
            self._check_choice()
        else:
            self._check_range()
        self._check_time()
        self._check_group()

    def _check_choice(self) -> None:
        if self.weights and len(self.weights) != len(self.values):
            raise ConfigurationError(
                f"weights must be as many as values, got {len(self.weights)} for "
                f"{len(self.values)}."
            )
        if self.weights and (min(self.weights) < 0.0 or sum(self.weights) <= 0.0):
            raise ConfigurationError(
                f"weights must be >= 0 and not all zero, got {list(self.weights)}."
            )

    def _check_range(self) -> None:
        if self.distribution == "normal":
            assert self.mean is not None
            assert self.std is not None
            check_range("std of a normal draw", self.std, low=0.0)
            if self.low is None:
                object.__setattr__(self, "low", self.mean - TAILS * self.std)
            if self.high is None:
                object.__setattr__(self, "high", self.mean + TAILS * self.std)
        assert self.low is not None
        assert self.high is not None
        if not self.low <= self.high:
            raise ConfigurationError(
                f"A variation must have finite low <= high, got {self.low:g} and {self.high:g}."
            )
        if self.distribution == "log_uniform":
            check_range("low of a log_uniform draw", self.low, above=0.0)

    def _check_time(self) -> None:
        for key, when in (("interval", "interval"), ("time_constant", "drift")):
            value = getattr(self, key)
            if self.when == when and (value is None or value <= 0.0):
                raise ConfigurationError(
                    f'when = "{when}" needs {key} > 0 s, got {value}. Give {key}.'
                )
            if self.when != when and value is not None:
                raise ConfigurationError(
                    f'{key} belongs to when = "{when}", got when = "{self.when}". Remove it or '
                    "change when."
                )

    def _check_group(self) -> None:
        if not isinstance(self.group, list | tuple):
            object.__setattr__(self, "correlation", _finite("correlation", self.correlation))
        else:
            object.__setattr__(self, "group", tuple(self.group))
            object.__setattr__(self, "correlation", _series("correlation", self.correlation))
        names = [name for name, _ in self.weights_of_groups]
        if len(set(names)) != len(names) or not all(names):
            raise ConfigurationError(
                f"group must be a name, or several different ones, got {self.group!r}."
            )
        given = self.correlation if isinstance(self.correlation, tuple) else (self.correlation,)
        if self.group is not None and len(given) != len(names):
            raise ConfigurationError(
                f"correlation must be as many numbers as there are groups, got {len(given)} for "
                f"{len(names)}."
            )
        if sum(x * x for x in given) > 1.0 + ROUNDING:
            raise ConfigurationError(
                "correlation must be from -1 to 1 (of several groups, the sum of their squares at "
                f"most 1), got {', '.join(f'{x:g}' for x in given)}."
            )
        if self.correlation != 1.0 and self.group is None:
            raise ConfigurationError(
                f"correlation = {self.correlation:g} needs a group to be correlated with. Give "
                "group a name that others have too."
            )

    @property
    def weights_of_groups(self) -> tuple[tuple[str, float], ...]:
        """The groups with the weights of their scores."""
        if self.group is None:
            return ()
        if isinstance(self.group, tuple):
            assert isinstance(self.correlation, tuple)
            return tuple(zip(self.group, self.correlation, strict=False))
        assert isinstance(self.correlation, float)
        return ((self.group, self.correlation),)

    @property
    def own_weight(self) -> float:
        """Weight of a score of its own; 0 where the groups say all."""
        left = 1.0 - sum(weight * weight for _, weight in self.weights_of_groups)
        return math.sqrt(left) if left > ROUNDING else 0.0

    @property
    def span(self) -> tuple[float, float]:
        """Lowest and highest draw, before the operation."""
        if self.distribution == "choice":
            likely = [v for v, w in zip(self.values, self.shares, strict=True) if w > 0.0]
            return min(likely), max(likely)
        assert self.low is not None
        assert self.high is not None
        return self.low, self.high

    @property
    def shares(self) -> tuple[float, ...]:
        """Probability of each of `values`."""
        weights = self.weights or (1.0,) * len(self.values)
        return tuple(w / sum(weights) for w in weights)

    def to_dict(self) -> dict[str, Any]:
        """Return everything that is set as plain data; `Variation(**data)` makes an equal one."""
        data = {f.name: getattr(self, f.name) for f in fields(self)}
        if self.group is None:
            del data["correlation"]
        return {
            key: list(value) if isinstance(value, tuple) else value
            for key, value in data.items()
            if value is not None and value != ()
        }


def constant(value: float) -> Variation:
    """Return the variation that sets one exact value."""
    return Variation(distribution="choice", operation="set", values=(value,))


def make_variation(name: str, spec: Any) -> Variation:
    """Return a Variation from a Variation, a (low, high) pair of factors, or a mapping.

    Raises:
        ConfigurationError: The specification is none of these, or a number is not valid.
        UnknownNameError: A distribution, operation or time is not known.
    """
    if isinstance(spec, Variation):
        return spec
    known = [f.name for f in fields(Variation)]
    try:
        if isinstance(spec, Mapping):
            for key in spec:
                if key not in known:
                    raise ConfigurationError(str(unknown_name("key", str(key), known)))
            return Variation(**spec)
        if isinstance(spec, (list, tuple)) and len(spec) == 2:
            return Variation(*spec)
    except (ConfigurationError, UnknownNameError) as error:
        raise type(error)(f"randomization of {name}: {error}") from None
    raise ConfigurationError(
        f"randomization of {name} must be (low, high) factors or a mapping with low and high, "
        f"got {spec!r}."
    )


def _check_keys(variation: Variation) -> None:
    kind = variation.distribution
    needed, optional = TAKES[kind]
    for key in SHAPES:
        given = getattr(variation, key) not in (None, ())
        if key in needed and not given:
            raise ConfigurationError(
                f'distribution = "{kind}" needs {" and ".join(needed)}, got no {key}.'
            )
        if given and key not in needed + optional:
            raise ConfigurationError(
                f'distribution = "{kind}" has no {key}; it takes '
                f"{', '.join(needed + optional)}. Remove it or change distribution."
            )


def _finite(key: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise ConfigurationError(f"{key} must be a finite number, got {value!r}.")
    return float(value)


def _series(key: str, values: Any) -> tuple[float, ...]:
    if not isinstance(values, (list, tuple)):
        raise ConfigurationError(f"{key} must be a list of numbers, got {values!r}.")
    return tuple(_finite(f"each of {key}", value) for value in values)
