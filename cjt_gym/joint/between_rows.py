"""What acts between two samples of an input."""

from __future__ import annotations

import numpy as np

from cjt_gym.joint.kernel.arrays import Floats


def until_next(x: Floats, share: float) -> Floats:
    """Return what acts from each sample to the next: the value after a share of the time between.

    Args:
        x: The input, shape (N,).
        share: Zero for one that is held, a half for the mean of two samples, above one for one that
            is logged late.

    Returns:
        Shape (N,); after the last sample the input stays as it is.
    """
    rows = np.arange(len(x))
    return np.asarray(np.interp(rows + share, rows, x)) if share else x
