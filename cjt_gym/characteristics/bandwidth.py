"""How much torque a joint delivers at which frequency, and what limits it.

For a sine of the joint torque, motor torque, current, voltage and velocity follow from the linear
joint with its drive; each has a limit, and the least torque that they allow is what is available.
Coulomb friction and ripple are not in it.

References:
    Malzahn, Kashiri, Roozing, Tsagarakis, Caldwell (2017), What is the torque bandwidth of this
    actuator?, IEEE/RSJ IROS.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cjt_gym.characteristics.motor import (
    Floats,
    peak_torque,
    rated_torque,
    torque_per_ampere,
    zero_torque_speed,
)
from cjt_gym.errors import ConfigurationError, check_range
from cjt_gym.joint import JointParameters, get_structure
from cjt_gym.joint.kernel.arrays import Complex
from cjt_gym.joint.linear import OUTPUTS, frequency_response, state_matrices

LOCKED = math.inf
LOWEST_HZ, HIGHEST_HZ = 1e-2, 1e4  # between which one is looked for


@dataclass(frozen=True)
class TorqueLimits:
    """Largest amplitude of the joint torque by what limits it, shape (frequencies,) [N m].

    Attributes:
        f: Frequencies [Hz].
        current: Limit of the peak current i_p.
        continuous: Limit of the rated current: the rms of the sine is i_c.
        voltage: Limit of the supply v_0, with resistance, inductance and back-EMF.
        speed: Limit of the velocity dq_p; infinite where the joint has none.
    """

    f: Floats
    current: Floats
    continuous: Floats
    voltage: Floats
    speed: Floats

    @property
    def peak(self) -> Floats:
        """What is available for a short while [N m]."""
        return np.minimum(np.minimum(self.current, self.voltage), self.speed)

    @property
    def lasting(self) -> Floats:
        """What is available for ever [N m]."""
        return np.minimum(self.peak, self.continuous)


def response(
    p: JointParameters, f: Floats, load: float = LOCKED, *, rigid_gearbox: bool = True
) -> tuple[Complex, Complex]:
    """Return the responses from motor torque to joint torque [-] and motor velocity [rad/(s N m)].

    Args:
        p: Parameters.
        f: Frequencies > 0 [Hz].
        load: Inertia of a free load [kg m^2]; infinite for a locked output.
        rigid_gearbox: Whether the gearbox counts as rigid.

    Raises:
        ConfigurationError: A frequency or the load is not positive.
    """
    out = responses(p, f, load, rigid_gearbox=rigid_gearbox)
    return out[:, 0, 0], out[:, 1, 0]


def responses(p: JointParameters, f: Floats, load: float, *, rigid_gearbox: bool) -> Complex:
    """Return joint torque and motor velocity by motor torque and load input, (frequencies, 2, 2).

    The load input is the velocity of a locked output and the torque on a free load. Arguments and
    errors are those of `response`.
    """
    f = np.asarray(f, dtype=np.float64)
    if not np.all(f > 0.0) or not load > 0.0:
        raise ConfigurationError(
            f"Frequencies must be > 0 Hz and the load's inertia > 0 kg m^2, got {np.min(f):g} Hz "
            f"and {load:g} kg m^2."
        )
    locked = math.isinf(load)
    free, fixed = ("full_dynamics", "rigid_gearbox"), ("output_fixed", "output_fixed_rigid_gearbox")
    name = (fixed if locked else free)[rigid_gearbox]
    a, b, c, d = state_matrices(p if locked else p.replace(I_l=load), get_structure(name))
    rows = [OUTPUTS.index("tau"), OUTPUTS.index("dq_m")]
    return frequency_response(a, b, c[rows], d[rows], 2j * np.pi * f)


def torque_limits(p: JointParameters, f: Floats, load: float = LOCKED) -> TorqueLimits:
    """Return what current, heat, voltage and velocity allow at each frequency.

    The gearbox counts as rigid.

    Args:
        p: Parameters.
        f: Frequencies > 0, shape (frequencies,) [Hz].
        load: Inertia of a free load [kg m^2]; infinite for a locked output.

    Raises:
        ConfigurationError: As for `response`.
    """
    f = np.asarray(f, dtype=np.float64)
    torque, velocity = response(p, f, load)
    gain, k = np.abs(torque), torque_per_ampere(p)
    volts = (p.r + 2j * np.pi * f * p.get("l_a", 0.0)) / k + k * velocity  # per N m of the motor
    return TorqueLimits(
        f,
        gain * peak_torque(p),
        gain * math.sqrt(2.0) * rated_torque(p),
        gain * p.v_0 / np.abs(volts),
        gain * p.get("dq_p", math.inf) / np.abs(velocity),
    )


def back_emf_limit(p: JointParameters, f: Floats) -> Floats:
    """Return the torque of a locked output at which the motor reaches v_0 / (k_t n) [N m].

    dq_0 |k_b / (j w) + d_gl|: a simple bound that leaves out resistance and inductance.
    """
    omega = 2.0 * np.pi * np.asarray(f, dtype=np.float64)
    return zero_torque_speed(p) * np.hypot(p.k_b / omega, p.get("d_gl", 0.0))


def torque_bandwidth(
    p: JointParameters, amplitude: float, load: float = LOCKED, *, lasting: bool = False
) -> float:
    """Return up to which frequency a torque amplitude is available [Hz].

    Args:
        p: Parameters.
        amplitude: Of the joint torque [N m].
        load: Inertia of a free load [kg m^2]; infinite for a locked output. With a free load
            little torque is available at low frequencies, where the load just gives way; the
            bandwidth is the upper end of the band.
        lasting: Whether the rated current limits it, too.

    Returns:
        The frequency, between 0.01 and 10000 Hz; 0 where the amplitude is never available.
    """
    check_range("The amplitude", amplitude, "N m", above=0.0, finite=False)
    f = np.geomspace(LOWEST_HZ, HIGHEST_HZ, 601)
    for _ in range(3):
        limits = torque_limits(p, f, load)
        enough = (limits.lasting if lasting else limits.peak) >= amplitude
        if math.isinf(load):
            first = int(np.argmin(enough)) if not enough.all() else len(f)
            last = first - 1
        else:
            last = int(np.flatnonzero(enough)[-1]) if enough.any() else -1
        if last < 0:
            return 0.0
        if last == len(f) - 1:
            return float(f[-1])
        f = np.linspace(f[last], f[last + 1], 101)
    return float(f[0])
