"""Whether a control step is short enough for a joint."""

from __future__ import annotations

import warnings

from cjt_gym.errors import CjtGymWarning
from cjt_gym.joint import Joint
from cjt_gym.joint.linear import resonance


def warn_of_fast_resonance(joint: Joint, dt: float) -> None:
    """Warn if a joint resonates above the Nyquist frequency of its control step [s]."""
    if not joint.structure_row.has_spring:
        return
    swing, nyquist = resonance(joint.parameters), 0.5 / dt
    if swing > nyquist:
        warnings.warn(
            f"{joint.parameters.name} resonates on its torsion bar at {swing:.3g} Hz, above the "
            f"Nyquist frequency of the control loop, {nyquist:.3g} Hz at dt = {dt:g} s: no "
            f"controller sees it. Take dt < {0.5 / swing:.2g} s, or check k_b and the inertias.",
            CjtGymWarning,
            stacklevel=3,
        )
