"""The effect table: everything that distinguishes a real joint from the linear one.

One row per effect. The options of the environments, the names that can be randomised, the
documentation and the contract tests are derived from this table. An effect is one row here and one
term in the kernel; `fields` name the kernel's parameters.
"""

from __future__ import annotations

from cjt_gym.errors import ConfigurationError, check_name
from cjt_gym.joint.effects.drive import DRIVE_EFFECTS
from cjt_gym.joint.effects.load import LOAD_EFFECTS
from cjt_gym.joint.effects.motor import MOTOR_EFFECTS
from cjt_gym.joint.effects.row import (
    CHANNEL_UNITS,
    PLACES,
    STAGES,
    Effect,
    EffectParameter,
    body_of,
)
from cjt_gym.joint.effects.sensing import SENSING_EFFECTS
from cjt_gym.joint.effects.transmission import TRANSMISSION_EFFECTS
from cjt_gym.plugins import installed_rows

EFFECTS: dict[str, Effect] = {
    row.name: row
    for row in (
        *DRIVE_EFFECTS,
        *MOTOR_EFFECTS,
        *TRANSMISSION_EFFECTS,
        *SENSING_EFFECTS,
        *LOAD_EFFECTS,
    )
}

PACKAGED = frozenset(EFFECTS)
"""Names of the effects that come with the package."""


def register_effect(row: Effect) -> Effect:
    """Add a row to the effect table, and return it.

    Commands, environments, randomisation and joint files know it from then on, in this process.
    Register it before joints are made; a package does so by the entry point `cjt_gym.effects`.

    Args:
        row: The row. The `fields` of its parameters are kernel parameters that the table uses, to
            which it adds.

    Raises:
        ConfigurationError: Its name is taken, or it does nothing.
        UnknownNameError: A stage, a place or a parameter of the kernel has another name.
    """
    EFFECTS[row.name] = _checked(row)
    return row


def _checked(row: Effect) -> Effect:
    """Return a row that may be added to the table."""
    if not isinstance(row, Effect):
        raise ConfigurationError(
            f"A row of the effect table must be a cjt_gym.joint.effects.Effect, got {row!r}."
        )
    owner = f"effect {row.name!r}"
    if not row.name.isidentifier() or row.name in EFFECTS:
        raise ConfigurationError(
            f"The name of {owner} must be an identifier that no other effect has. Choose another."
        )
    fields = {f for e in EFFECTS.values() for p in e.parameters for f in p.fields}
    used = [field for p in row.parameters for field in p.fields]
    symbols = [p.symbol for p in row.parameters]
    for what, names, known in (
        (f"stage of {owner}", [row.stage], STAGES),
        (f"needs of {owner}", [row.needs], PLACES),
        (f"size of {owner}", list(row.size), symbols),
        (f"kernel parameter of {owner}", used, sorted(fields)),
    ):
        for name in names:
            check_name(what, name, known)
    if not used or not row.size:
        raise ConfigurationError(
            f"{owner} must have parameters with `fields`, the kernel parameters that they add to, "
            "and name those that make it do something in `size`."
        )
    return row


def own_effects() -> tuple[Effect, ...]:
    """Return the rows that were registered beside the package's."""
    return tuple(row for name, row in EFFECTS.items() if name not in PACKAGED)


for _, _row in installed_rows("effects", EFFECTS):
    register_effect(_row)

__all__ = [
    "CHANNEL_UNITS",
    "EFFECTS",
    "PLACES",
    "STAGES",
    "Effect",
    "EffectParameter",
    "body_of",
    "own_effects",
    "register_effect",
]
