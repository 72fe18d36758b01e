"""What compiled code opens at an address are the very arrays that were handed over.

Why it is done is a matter of time, which no test asserts; `python -m benchmarks` measures it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numba import njit

from cjt_gym.envs.core import Episodes
from cjt_gym.envs.handover import opened, table_of


@njit  # not kept on the disk, where it would outlive a change of the parts
def look_and_write(address: int) -> Any:
    """Return some of what lies at an address, after a change."""
    batch, setup, kind, blocks, task, control = opened(address)
    control.base[1] = 7.5
    batch.p[2].k_b = 4321.0
    sizes = blocks.rows.shape, batch.outputs.shape, task.observation.shape
    return setup.dt, setup.groups, kind, sizes, task.weights.sum(), task.preview


def parts_of(episodes: Episodes) -> tuple[Any, ...]:
    batch = episodes.plant.batch
    inner = batch.arrays, batch.setup, batch.kind, batch.blocks
    return (*inner, episodes.task, episodes.control)


def test_what_is_opened_is_what_was_handed_over() -> None:
    episodes = Episodes(3, preview=2)
    parts = parts_of(episodes)
    arrays, setup, kind, blocks, task, control = parts
    table = table_of(*parts)
    dt, groups, seen_kind, sizes, weights, preview = look_and_write(table.ctypes.data)
    assert (dt, groups, seen_kind) == (setup.dt, setup.groups, tuple(kind))
    assert sizes == (blocks.rows.shape, arrays.outputs.shape, task.observation.shape)
    assert (weights, preview) == (task.weights.sum(), 2)
    assert control.base.tolist() == [0.0, 7.5, 0.0]
    assert arrays.p["k_b"][2] == 4321.0


@pytest.mark.parametrize(
    "other", [np.zeros(3, np.float32), np.zeros((3, 1)), np.zeros((3, 2))[:, 0]], ids=str
)
def test_an_array_of_another_kind_is_refused(other: Any) -> None:
    *parts, control = parts_of(Episodes(3))
    with pytest.raises(TypeError, match="wants d1"):
        table_of(*parts, control._replace(action=other))
