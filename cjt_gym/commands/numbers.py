"""Numbers of options that several commands take."""

from __future__ import annotations

from cjt_gym.errors import ConfigurationError


def check_seed(seed: int | None) -> None:
    """Raise ConfigurationError if a seed is negative."""
    if seed is not None and seed < 0:
        raise ConfigurationError(f"--seed must be >= 0, got {seed}.")


def check_time(name: str, value: float | None) -> None:
    """Raise ConfigurationError if a time is not > 0 s.

    Args:
        name: Of the option, without its dashes.
        value: The time [s]; None where it was not given.
    """
    if value is not None and not value > 0.0:
        raise ConfigurationError(f"--{name} must be > 0 s, got {value:g}.")
