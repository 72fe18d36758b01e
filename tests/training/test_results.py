"""The figures of learned against classical, from cells whose figures are known."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cjt_gym.training.results import _iqm, sentence, summary_of, table_of, tasks_of

TASKS = ("step", "reversal")


def cell(agent: str, kind: str, nrmse: float, noise: float | None, seed: int) -> dict[str, Any]:
    rng = np.random.default_rng(seed)
    powers = {task: list(rng.uniform(0.5, 1.5, 16)) for task in TASKS}
    squares = {task: [nrmse**2 * x for x in powers[task]] for task in TASKS}
    rows = [{"task": task, "noise_amplification": noise} for task in TASKS]
    found = {"agent": agent, "kind": kind, "squares": squares, "powers": powers, "rows": rows}
    return {"status": "done", **found}


def test_interquartile_mean_drops_the_outer_quarters() -> None:
    assert _iqm(np.array([100.0, 1.0, 2.0, -50.0])) == pytest.approx(1.5)
    assert _iqm(np.array([1.0, 2.0, 3.0, 4.0, 50.0])) == pytest.approx(
        (0.75 * 2.0 + 3.0 + 0.75 * 4.0) / 2.5
    )
    assert _iqm(np.array([7.0])) == pytest.approx(7.0)


def test_ratio_is_to_the_best_controller_and_its_interval_holds_it() -> None:
    policies = [cell(f"p{k}", "residual", 0.10 + 0.01 * k, 5.0, 0) for k in range(5)]
    laws = [cell("pid", "classical", 0.2, 8.0, 0), cell("pd", "classical", 0.4, 2.0, 0)]
    found = summary_of("rigid_gearbox", [*policies, *laws])
    assert found["best"] == "pid"
    assert found["score"]["pd"] == pytest.approx(0.4)
    assert found["ratio"]["value"] == pytest.approx(0.6, rel=1e-6)
    assert found["ratio"]["low"] <= 0.6 <= found["ratio"]["high"]
    assert 0.5 <= found["ratio"]["low"] < found["ratio"]["high"] <= 0.7
    text = sentence(found)
    assert "0.60" in text
    assert "chance" not in text
    assert [row[0] for row in table_of(found)[1:]] == ["policy", "pid", "pd"]
    assert tasks_of(found)[2][0] == "reversal (never trained)"


def test_trainings_that_differ_widely_are_said_to_show_nothing() -> None:
    policies = [cell(f"p{k}", "residual", 0.05 * 4.0**k, None, 0) for k in range(4)]
    found = summary_of("rigid", [*policies, cell("pid", "classical", 0.2, None, 0)])
    assert found["noise"]["policy"] is None
    assert "which could be chance" in sentence(found)
