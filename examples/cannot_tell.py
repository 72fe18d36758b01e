"""A record that cannot tell damping from dry friction, the experiment that can, and the answer.

The output of a joint is locked and its current goes up and down at one slope. The motor then turns
at one speed, at which viscous damping and Coulomb friction are the same torque. The diagnosis says
so and designs the next experiment; that one is run on the same joint, and diagnosed again. The
joint is one of `cjt_gym.blind`, whose simulator shares nothing with the diagnosis.

Run it with  python examples/cannot_tell.py
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cjt_gym.blind import Bench, make_bench
from cjt_gym.gap import Diagnosis, diagnose
from cjt_gym.joint import JointFile, load_joint_file
from cjt_gym.records import read_record

Floats = NDArray[np.float64]


def hidden_joint() -> Bench:
    """Return a joint whose motor has 3 N m of dry friction, which its datasheet does not know."""
    return make_bench(3, "output_fixed_rigid_gearbox", up_m=3.0, down_m=3.0)


def one_slope(peak: float, dt: float) -> Floats:
    """Return 10 s of a current that goes up and down at one slope [A], after half a second."""
    t = np.arange(0.0, 10.0, dt)
    corners = [0.0, 0.5, 1.5, 3.5, 5.5, 7.5, 9.5, 10.5]
    return np.interp(t, corners, peak * np.array([0.0, 0.0, 1.0, -1.0, 1.0, -1.0, 1.0, 0.0]))


def nominal(bench: Bench, folder: Path) -> JointFile:
    """Return what is known of the joint: its datasheet."""
    path = folder / "nominal.toml"
    path.write_text(bench.datasheet(), encoding="utf-8")
    return load_joint_file(path)


def main() -> tuple[Diagnosis, Diagnosis]:
    """Diagnose, experiment, diagnose again; return both diagnoses."""
    bench = hidden_joint()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        joint = nominal(bench, folder)
        ramps = bench.record(one_slope(0.3 * bench.sheet.i_p, bench.sheet.dt), seed=1)
        before = diagnose(ramps, joint)
        show("With one slope", before)
        file = before.suggestion.written(folder / "next.npz").record
        if file is None:
            return before, before
        experiment = bench.record(read_record(file)["i_cmd"], seed=2)
        after = diagnose(experiment, joint)
        show("With the experiment", after)
    return before, after


def show(title: str, diagnosis: Diagnosis) -> None:
    """Print what a diagnosis says."""
    say = sys.stdout.write
    say(f"{title}: {diagnosis.verdict}\n")
    for effect in diagnosis.effects:
        numbers = ", ".join(
            f"{n} = {p.value:.3g} ({p.low:.3g} to {p.high:.3g}) {p.unit}"
            for n, p in effect.parameters.items()
        )
        say(f"  {effect.name}: {numbers}; {effect.status}, confidence {effect.confidence:.2f}\n")
        say(f"    could as well be: {', '.join(effect.confusable_with) or 'nothing else'}\n")
    say(f"  next: {diagnosis.suggestion.text}\n")


if __name__ == "__main__":
    main()
