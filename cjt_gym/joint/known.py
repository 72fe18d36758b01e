"""What a joint file knows of a joint, as the parameters of a nominal joint."""

from __future__ import annotations

from dataclasses import replace

from cjt_gym.joint.effects import EFFECTS, EffectParameter
from cjt_gym.joint.joint import Joint
from cjt_gym.joint.parameters import PARAMETERS


def known_joint(joint: Joint) -> Joint:
    """Return a joint whose parameters have the values that its effects give them.

    Effects that do nothing else, such as `inertia`, `damping` and `torque_constant`, become
    parameters; levels of friction become parameters, too, and stay effects. What is designed on
    the linear model of the result is designed for what is known of the joint.
    """
    values: dict[str, float] = {}
    for name, numbers in joint.effects.items():
        for row in EFFECTS[name].parameters:
            symbol, number = _parameter_of(row), numbers[row.symbol]
            if symbol is None or not isinstance(number, float):
                continue
            if number != joint.parameters.get(symbol, 0.0):
                values[symbol] = number
    rest = {
        name: numbers
        for name, numbers in joint.effects.items()
        if not all(row.replaces for row in EFFECTS[name].parameters)
    }
    file = replace(joint.file, parameters=joint.parameters.replace(**values))
    return replace(joint, file=file, effects=rest)


def _parameter_of(row: EffectParameter) -> str | None:
    """Return the parameter of the joint that a number of an effect is a value of, or None.

    Those of the negative direction follow their partners.
    """
    symbol = row.relative_to if row.replaces else row.joint_parameter
    known = symbol is not None and symbol in PARAMETERS and not symbol.endswith("_n")
    return symbol if known else None
