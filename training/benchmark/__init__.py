"""The benchmark: a grid of joints, structures, tasks, controllers and policies, and its report."""

from cjt_gym.training.benchmark.side_by_side import (
    align,
    cells_of,
    make_agents,
    table,
    write_rows,
)

__all__ = ["align", "cells_of", "make_agents", "table", "write_rows"]
