"""However a run ends, the torque is gone once the watchdog's time is over."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.canbus.bench import DRIVES
from tests.canbus.kills import ENDINGS, end


@pytest.mark.slow  # in real time, and a process each
@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("protocol", DRIVES)
def test_torque_does_not_outlive_the_program(protocol: str, ending: str, tmp_path: Path) -> None:
    found = end(protocol, ending, tmp_path)
    assert found.before != 0.0
    assert found.after == 0.0
    assert found.kind == ENDINGS[ending][1]
    assert found.rows > 50
    assert found.status != 0
