"""Faults take the torque away within two control periods and leave a complete record."""

from pathlib import Path

import pytest

from tests.canbus.bench import DRIVES
from tests.canbus.campaign import FAULTS, campaign, inject, table


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("protocol", DRIVES)
def test_fault_takes_the_torque_away(fault: str, protocol: str, tmp_path: Path) -> None:
    outcome = inject(fault, protocol, tmp_path, seed=0)
    assert not outcome.is_miss, outcome


@pytest.mark.slow
def test_campaign_has_no_misses() -> None:
    outcomes = campaign(400, 1000, tuple(DRIVES))
    assert [o for o in outcomes if o.is_miss] == []
    assert sum(row["injected"] for row in table(outcomes)) == 400
