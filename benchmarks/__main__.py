"""Measure everything, print the tables, and write them into README.md."""

from __future__ import annotations

import time

from benchmarks import (
    accuracy,
    costs,
    growth,
    policy,
    redraw,
    reference,
    report,
    speed,
    startup,
    training,
)


def main() -> None:
    """Run all benchmarks, one after the other."""
    begin = time.perf_counter()
    tables = []
    for measure in (
        accuracy.table,
        speed.table,
        reference.table,
        growth.table,
        training.table,
        policy.table,
        startup.table,
        redraw.table,
        costs.table,
    ):
        tables.append(measure())
        print(tables[-1].markdown(), end="\n\n", flush=True)
    report.write(tables)
    print(f"{report.conditions()} It took {time.perf_counter() - begin:.0f} s.")


if __name__ == "__main__":
    main()
