"""The README's diagnosis names the friction that was simulated, whatever seed and amplitude.

`tests/docs/test_readme.py` runs the commands as they stand; here they run with others.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from cjt_gym.cli import main

SEVERAL = [(seed, None) for seed in range(10)] + [(0, "15"), (0, "25"), (2, "15"), (3, "25")]


def cause(folder: Path, seed: int, amplitude: str | None) -> dict[str, object]:
    run, found = str(folder / "run.npz"), folder / "found"
    words = "simulate orange_80_6000 --effect coulomb noise quantization --reference multisine"
    more = [] if amplitude is None else ["--amplitude", amplitude]
    main([*words.split(), "--out", run, "--seed", str(seed), *more])
    where = ["--joint", "orange_80_6000", "--structure", "output_fixed_rigid_gearbox"]
    main(["diagnose", run, *where, "--out", str(found)])
    result: dict[str, object] = json.loads((found / "diagnosis.json").read_text())
    return result


def check(found: dict[str, object], status: tuple[str, ...]) -> None:
    effects = found["effects"]
    assert [e["name"] for e in effects] == ["coulomb"], effects  # type: ignore[attr-defined]
    assert found["verdict"] == "explained"
    (effect,) = effects  # type: ignore[misc]
    assert effect["status"] in status  # type: ignore[index]
    assert effect["parameters"]["d_cm"]["value"] == pytest.approx(5.9, rel=0.05)  # type: ignore[index]


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "amplitude"), SEVERAL)
def test_they_do_so_for_other_seeds_and_amplitudes(
    tmp_path: Path, seed: int, amplitude: str | None
) -> None:
    check(cause(tmp_path, seed, amplitude), ("confirmed", "tentative"))
