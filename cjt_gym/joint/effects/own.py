"""Custom effects: rows that act on existing parameters of the kernel."""

from __future__ import annotations

from collections.abc import Mapping

from cjt_gym.errors import ConfigurationError, check_name
from cjt_gym.joint.effects.row import PLACES, STAGES, Effect


def checked_row(row: Effect, table: Mapping[str, Effect]) -> Effect:
    """Return a row that may be added to a table."""
    if not isinstance(row, Effect):
        raise ConfigurationError(
            f"A row of the effect table must be a cjt_gym.joint.effects.Effect, got {row!r}."
        )
    owner = f"effect {row.name!r}"
    if not row.name.isidentifier() or row.name in table:
        raise ConfigurationError(
            f"The name of {owner} must be an identifier that no other effect has. Choose another."
        )
    fields = {f for e in table.values() for p in e.parameters for f in p.fields}
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
