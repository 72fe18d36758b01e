"""The impedance at the output: passive, and what the motor can render.

The load moves with velocity dq_l and the joint answers with -Z dq_l + G tau_m. A motor torque can
thus turn Z into any impedance within a disc, whose radius is what torque and voltage allow over the
velocity of the motion. How much of it a controller reaches with delay and noise, stably and
passively, is given by `cjt_gym.analysis.stiffest_rendered`.

References:
    Colgate, Brown (1994), Factors affecting the Z-width of a haptic display, IEEE ICRA;
    Vallery, Ekkelenkamp, van der Kooij, Buss (2007), IEEE/RSJ IROS: a torque loop around a spring
    is passive up to the spring's stiffness.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cjt_gym.characteristics.bandwidth import LOCKED, responses
from cjt_gym.characteristics.motor import Floats, peak_torque, torque_per_ampere
from cjt_gym.errors import ConfigurationError
from cjt_gym.joint import JointParameters
from cjt_gym.joint.kernel.arrays import Complex


@dataclass(frozen=True)
class ImpedanceRange:
    """Impedances that a joint can show, each array of shape (frequencies,) [N m s/rad].

    Attributes:
        f: Frequencies [Hz].
        own: Impedance with a motor without current, complex.
        held: Impedance with a motor that is held, complex: the torsion bar alone.
        radius: How far the motor can move the impedance away from `own`.
    """

    f: Floats
    own: Complex
    held: Complex
    radius: Floats

    @property
    def low(self) -> Floats:
        """Smallest magnitude, lower end of the Z-width."""
        return np.maximum(np.abs(self.own) - self.radius, 0.0)

    @property
    def high(self) -> Floats:
        """Largest magnitude, upper end of the Z-width."""
        return np.abs(self.own) + self.radius


def impedance_range(
    p: JointParameters, f: Floats, motion: float, *, rigid_gearbox: bool = True
) -> ImpedanceRange:
    """Return what impedances the joint can show while its output moves in a sine.

    Args:
        p: Parameters.
        f: Frequencies > 0, shape (frequencies,) [Hz].
        motion: Amplitude of the output's angle [rad]; the smaller, the wider the range.
        rigid_gearbox: Whether the gearbox counts as rigid.

    Raises:
        ConfigurationError: A frequency or the amplitude is not positive.
    """
    f = np.asarray(f, dtype=np.float64)
    if not np.all(f > 0.0) or not motion > 0.0:
        raise ConfigurationError(
            f"Frequencies must be > 0 Hz and the motion > 0 rad, got {np.min(f):g} Hz and "
            f"{motion:g} rad."
        )
    s = 2j * np.pi * f
    out = responses(p, f, LOCKED, rigid_gearbox=rigid_gearbox)
    gain, own, follows = np.abs(out[:, 0, 0]), -out[:, 0, 1], np.abs(out[:, 1, 1])
    k, velocity = torque_per_ampere(p), np.abs(s) * motion
    volts = np.abs((p.r + s * p.get("l_a", 0.0)) / k + k * out[:, 1, 0])
    spare = np.maximum(p.v_0 - k * follows * velocity, 0.0)  # the motion induces a voltage, too
    torque = np.minimum(peak_torque(p), spare / volts)
    held = np.asarray(p.k_b / s + p.get("d_gl", 0.0), dtype=np.complex128)
    if not rigid_gearbox:
        gear = p.k_g / s + p.get("d_mg", 0.0) + s * p.get("I_g", 0.0) + p.get("d_g", 0.0)
        held = 1.0 / (1.0 / held + 1.0 / gear)
    return ImpedanceRange(f, own, held, gain * torque / velocity)
