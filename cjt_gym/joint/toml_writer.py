"""The text of a joint file, as `cjt_gym.joint.toml_format` reads it back."""

from __future__ import annotations

from typing import Any

from cjt_gym.disk import Inline, to_toml
from cjt_gym.joint.parameter_table import AXES
from cjt_gym.joint.quantity import Quantity
from cjt_gym.joint.toml_format import Document


def write_document(document: Document) -> str:
    """Return the text of a joint file; `parse_document` reads it back to an equal document."""
    return to_toml(
        {
            "name": document.name,
            "source": document.source,
            "axis": None if document.axis == AXES[0] else document.axis,
            "structure": document.structure,
            "drive": document.drive,
            "parameters": {key: _entry(value) for key, value in document.parameters.items()},
            **{
                part: {
                    name: {key: _entry(value) for key, value in table.items()}
                    for name, table in getattr(document, part).items()
                }
                or None
                for part in ("effects", "sensors")
            },
            "sampling": {k: _entry(v) for k, v in document.sampling.items()} or None,
            "found": document.found or None,
        }
    )


def _entry(value: Any) -> Any:
    """Return a quantity as a table on one line, anything else as it is."""
    if not isinstance(value, Quantity):
        return value
    return Inline(
        value=value.value,
        unit=value.unit,
        source=value.source or None,
        tolerance=value.tolerance,
        guess=True if value.guess and value.tolerance is None else None,
        low=value.low,
        high=value.high,
        asymmetric=value.asymmetric or None,
    )
