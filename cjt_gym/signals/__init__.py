"""References and disturbances."""

from cjt_gym.signals.signal import (
    KINDS,
    RANDOM_KINDS,
    Signal,
    make_signals,
    sampled_signal,
    signal_from_file,
    signal_of_record,
)

__all__ = [
    "KINDS",
    "RANDOM_KINDS",
    "Signal",
    "make_signals",
    "sampled_signal",
    "signal_from_file",
    "signal_of_record",
]
