"""Data for a report's charts, computed once an explanation is found."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import PurePath

from cjt_gym.gap.diagnosis import Diagnosis, GapSize, StageGap, Suggestion, Unexplained
from cjt_gym.gap.evidence import Evidence, Source
from cjt_gym.gap.judged.replay import Written, written
from cjt_gym.gap.report.maps import friction_maps, ripple, spring_loop
from cjt_gym.gap.stages.fit import Fit, Problem
from cjt_gym.joint import JointFile, Structure
from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.records import Record


def gather(problem: Problem, fit: Fit, within: Written, before: Floats) -> Evidence:
    """Return the data of the stages for a report's charts.

    Args:
        problem: The record.
        fit: Its explanation.
        within: The nominal joint with its values limited to their tolerances.
        before: Residual of its motor, shape (N,).
    """
    stages = problem.stages
    after = written(problem, fit.model, fit.z)
    left = stages.first(fit.residuals)["motor"]
    return Evidence(
        friction=friction_maps(stages, within, after),
        ripple=ripple(stages, (within.fields, before), (after.fields, left)),
        spring=spring_loop(stages, within.fields, after.fields),
    )


def source_of(
    file: JointFile, shape: Structure, fitted: Sequence[Record], held_out: Sequence[Record]
) -> Source:
    """Return the inputs of a diagnosis."""
    units = ("m", "N") if file.parameters.axis == "prismatic" else ("rad", "N m")
    return Source(file.name, shape.name, _described(fitted), _described(held_out), *units)


def nothing_said(
    file: JointFile,
    shape: Structure,
    fitted: Sequence[Record],
    held_out: Sequence[Record],
    why: str,
) -> Diagnosis:
    """Return the diagnosis of stages that could not be judged, for a reason."""
    names = ("drive", "motor", "transmission", "sensing", "load")
    text = f"The stages could not be judged one by one on this record ({why})."
    advice = "Record at a higher rate, with the channels that `cjt-gym check` misses."
    return Diagnosis(
        verdict="unexplained",
        stages={name: StageGap(0.0, 0.0, significant=False) for name in names},
        regimes=(),
        effects=(),
        gap=GapSize(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, held_out=False, by_channel={}),
        unexplained=Unexplained(1.0, None, text),
        suggestion=Suggestion(advice),
        seconds=0.0,
        evidence=Evidence(source=source_of(file, shape, fitted, held_out)),
        joint=file,
    )


def _described(records: Sequence[Record]) -> tuple[str, ...]:
    """Return a description of records: name, number of samples, duration."""
    return tuple(
        f"{'/'.join(PurePath(r.owner).parts[-2:])}: {len(r)} samples, {r.t[-1] - r.t[0]:.3g} s"
        for r in records
    )
