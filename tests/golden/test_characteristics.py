"""Characteristics against the toolbox: single figures of nine sets, curves of eight."""

from __future__ import annotations

import pytest

from cjt_gym.characteristics import CHARACTERISTICS, characteristic
from tests.golden.loader import oracle_sets, secondary
from tools.characteristics_comparison import ROWS, Row, parameters

# The toolbox stands 1e9 kg m^2 for a locked output, which moves the resonance by 1e-9.
LOOSER = {"torque with locked output, peak current", "torque with locked output, rated current"}


@pytest.mark.parametrize("name", oracle_sets())
def test_single_figures(name: str) -> None:
    golden = secondary(name)
    known = [key for key in golden if key in CHARACTERISTICS]
    assert len(known) == 18
    ours = {key: characteristic(parameters(name), key) for key in known}
    assert ours == pytest.approx({key: golden[key] for key in known}, rel=1e-13)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_curves(row: Row) -> None:
    largest = row.largest()
    if row.reason:
        assert largest > (1.1 if row.change == "factor" else 0.01)
    else:
        assert largest < (1e-7 if row.name in LOOSER else 1e-11)
