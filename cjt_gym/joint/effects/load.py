"""Effects of the load."""

from __future__ import annotations

from cjt_gym.joint.effects.friction import DQ_0
from cjt_gym.joint.effects.row import Effect, EffectParameter, number, own_value
from cjt_gym.joint.effects.sources import CATALOGUE, HUNT_CROSSLEY, TOOLBOX, TREMOR

LOAD_EFFECTS = (
    Effect(
        "load_inertia",
        "load",
        "The load's inertia differs from nominal.",
        CATALOGUE,
        (own_value("I_l", "kg m^2", 1e-4, 1000.0, "Inertia that the load really has", 1.2),),
        needs="free_load",
    ),
    Effect(
        "load_coulomb",
        "load",
        "Dry friction of the load.",
        f"{TOOLBOX}, section Nonlinear Dynamics",
        (
            EffectParameter(
                "d_cl",
                "N m",
                0.0,
                0.0,
                20.0,
                "Coulomb level of the load, on top of other rows",
                ("d_cl", "d_cl_n"),
                typical=0.01,
                typical_of="torque",
            ),
            DQ_0,
        ),
        size=("d_cl",),
        needs="free_load",
    ),
    Effect(
        "gravity",
        "load",
        "The load has weight, as a pendulum arm: -torque sin(q_l - angle).",
        "Pendulum",
        (
            number(
                "torque",
                "N m",
                500.0,
                "Weight times distance of the centre of mass, m g l",
                "weight",
                typical=0.05,
                typical_of="torque",
            ),
            number(
                "angle",
                "rad",
                3.2,
                "Angle of the load at which it hangs",
                "weight_angle",
                low=-3.2,
                default=0.0,
                typical=0.3,
            ),
        ),
        size=("torque",),
        needs="free_load",
    ),
    Effect(
        "contact",
        "load",
        "The load meets an environment: k x^e (1 + damping dx) beyond an angle, never pulling.",
        HUNT_CROSSLEY,
        (
            number(
                "stiffness",
                "N m/rad^e",
                1e6,
                "Stiffness k of the environment",
                "contact_stiffness",
                typical=10.0,
                typical_of="torque",
            ),
            number(
                "exponent",
                "-",
                2.0,
                "Exponent e: 1 is a spring, 1.5 a sphere",
                "contact_exponent",
                low=1.0,
                default=1.5,
                typical=1.5,
            ),
            number(
                "damping",
                "s/rad",
                10.0,
                "Damping per stiffness",
                "contact_damping",
                default=0.5,
                typical=0.5,
            ),
            number(
                "position",
                "rad",
                3.2,
                "Angle of the load at which it begins",
                "contact_position",
                low=-3.2,
                default=0.0,
                typical=0.05,
            ),
        ),
        size=("stiffness",),
        needs="free_load",
    ),
    Effect(
        "load_motion",
        "load",
        "The output is moved: a sine on top of the prescribed load motion.",
        f"{TOOLBOX}, structures with a prescribed load motion",
        (
            number(
                "amplitude", "rad", 1.0, "Amplitude of the angle", "motion_amplitude", typical=0.01
            ),
            number(
                "frequency", "Hz", 20.0, "Frequency", "motion_frequency", default=1.0, typical=1.0
            ),
        ),
        size=("amplitude",),
        needs="fixed_load",
    ),
    Effect(
        "human_torque",
        "load",
        "A person holds the load: slow voluntary torque, and tremor in a narrow band.",
        TREMOR,
        (
            number(
                "std",
                "N m",
                50.0,
                "Standard deviation of the voluntary torque",
                "human_std",
                typical=0.02,
                typical_of="torque",
            ),
            number(
                "bandwidth",
                "Hz",
                5.0,
                "Bandwidth of the voluntary torque",
                "human_bandwidth",
                low=0.1,
                default=1.0,
                typical=1.0,
            ),
            number(
                "tremor",
                "N m",
                5.0,
                "Standard deviation of the tremor",
                "tremor_std",
                default=0.0,
                typical=0.002,
                typical_of="torque",
            ),
            number(
                "tremor_frequency",
                "Hz",
                15.0,
                "Frequency of the tremor",
                "tremor_frequency",
                low=3.0,
                default=9.0,
                typical=9.0,
            ),
        ),
        size=("std", "tremor"),
        needs="free_load",
    ),
)
