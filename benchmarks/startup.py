"""The time from starting Python to the first step."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile

from benchmarks.report import Table

FIRST_STEP = """
import gymnasium, cjt_gym
env = gymnasium.make("CJT/TorqueTracking-v0", structure="full_dynamics", effects={effects})
env.reset(seed=0)
env.step(env.action_space.sample())
"""
EFFECTS = {"common": ["coulomb"], "general": {"stribeck": {"d_sm": 1.0, "v_s": 0.1}}}


def cpu_seconds(code: str, cache: str) -> float:
    """Return the CPU time of a Python process that runs some code [s].

    Python keeps the bytecode that it makes, as it does by default.
    """
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    environment = {**os.environ, "NUMBA_CACHE_DIR": cache, "PYTHONDONTWRITEBYTECODE": ""}
    subprocess.run([sys.executable, "-c", code], check=True, env=environment)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def table() -> Table:
    """Measure import, first use and later use."""
    rows = []
    with tempfile.TemporaryDirectory() as cache:
        bare = min(cpu_seconds("pass", cache) for _ in range(2))
        load = min(cpu_seconds("import cjt_gym", cache) for _ in range(3))
        rows.append(["import cjt_gym", f"{load - bare:.2f}"])
        for name, effects in EFFECTS.items():
            code = FIRST_STEP.format(effects=effects)
            rows.append(
                [f"first step, {name}, nothing compiled", f"{cpu_seconds(code, cache):.1f}"]
            )
            again = min(cpu_seconds(code, cache) for _ in range(2))
            rows.append([f"first step, {name}, later", f"{again:.2f}"])
    return Table(
        "Start",
        "CPU time of a process, with the bytecode of Python kept; `common` is Coulomb friction, "
        "which the code for blocks of joints knows, `general` is Stribeck friction, which needs "
        "the general kernel.",
        ["until", "CPU time [s]"],
        rows,
    )
