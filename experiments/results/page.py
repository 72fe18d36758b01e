"""Where results go: a file with all figures, a page, and the tables of a Markdown document."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from cjt_gym.datasheet.blocks import Block
from cjt_gym.disk import write_text
from cjt_gym.training import report
from cjt_gym.training.learning.run_folder import versions
from experiments.marks import fill, markdown
from experiments.results import tables
from experiments.results.figures import delay_figure, noise_figure, port_figure, profile_figure
from experiments.results.plan import Plan
from experiments.results.tables import Found

NOTES: Final = {
    "scores": "Score: nrmse, geometric mean over the tasks. Noise: standard deviation of the "
    "command over that of the torque sensor's noise, at rest. Change: rms of the command's change "
    "from one millisecond to the next. P better: probability that a policy has the smaller error "
    "in an episode, with its 95 % interval.",
    "tasks": "nrmse by task.",
    "joints": "Scores on joints that were not used for training: the policies unchanged, the "
    "controllers with gains for each joint.",
    "shifts": "Scores outside the training conditions, for the policies, the best controllers of "
    "the benchmark, and the policies' base.",
    "worst": "nrmse at the centre of the parameter box and at the worst point that CMA-ES found, "
    "on episodes not used by the search; for the policies, the interquartile mean and the "
    "worst point of the worst policy.",
    "port": "Damping felt at the output while the reference is zero, divided by the square root "
    "of stiffness times inertia. Below zero the joint feeds energy into whatever moves it.",
    "wins": "Where a classical controller is better than the policies.",
}


def write_all(plan: Plan, found: Sequence[Found]) -> Path:
    """Write `results.json` and `report.html`; return the page."""
    data = {"plan": plan.to_dict(), "structures": found, "versions": versions()}
    plan.out.mkdir(parents=True, exist_ok=True)
    write_text(plan.out / "results.json", json.dumps(data, indent=1) + "\n")
    return write_page(plan.out, found)


def write_page(folder: Path, found: Sequence[Found]) -> Path:
    """Write `report.html` and return its path."""
    parts: list[Block] = []
    for one in found:
        parts += [report.heading(tables.label(one)), report.paragraph(tables.sentence(one))]
        parts += [report.paragraph(text) for text in tables.verdicts(one)]
        for name, table in tables.PARTS.items():
            cells = tables.port(one, everybody=True) if name == "port" else table(one)
            parts += [report.paragraph(NOTES[name], note=True), report.html_table(cells)]
        parts += [
            report.figure(
                noise_figure(one),
                "Error and noise of every agent. Named are the policies, the best controllers, the "
                "base, and every agent that no other beats in both.",
            ),
            report.figure(
                profile_figure(one),
                "Performance profiles: share of episodes whose nrmse is below a threshold, with "
                "95 % intervals over trainings and episodes.",
            ),
            report.figure(delay_figure(one), "Score against delay on top of that of the command."),
            report.figure(port_figure(one), "Damping felt at the output."),
        ]
    return report.write_page(folder / "report.html", "Learned against classical", parts)


def part_markdown(name: str, found: Sequence[Found]) -> str:
    """Return a table of every structure in Markdown, or the sentences for "summary"."""
    if name == "summary":
        lines = [" ".join([tables.sentence(one), *tables.verdicts(one)]) for one in found]
        return "\n".join(f"- {line}" for line in lines)
    each = []
    for one in found:
        cells = tables.PARTS[name](one)
        text = markdown(cells) if len(cells) > 1 else "Nowhere."
        each.append(f"{tables.label(one)}:\n\n{text}")
    return "\n\n".join(each)


def facts(data: Found) -> str:
    """Return in a sentence what was run."""
    plan, known = data["plan"], data["versions"]
    steps = "" if plan["steps"] is None else f" of {plan['steps']:,} steps".replace(",", " ")
    recipes = (
        plan["recipe"]
        if isinstance(plan["recipe"], str)
        else ", ".join(dict.fromkeys(plan["recipe"].values()))
    )
    named = ", ".join(f"{name} {version}" for name, version in known.items())
    return (
        f"{plan['joint']}: {plan['seeds']} trainings{steps} of each structure by {recipes}, "
        f"{plan['episodes']} episodes of each task. Versions: {named}."
    )


def write_document(path: Path, data: Found, label: str = "results") -> Path:
    """Write the tables between the marks of a Markdown document, and return its path.

    A mark is `<!-- LABEL: NAME -->`, its end `<!-- end of LABEL: NAME -->`, with a name of
    `tables.PARTS`, "summary" or "facts". Error over noise goes to `figures/LABEL_STRUCTURE.svg`
    beside the document.

    Args:
        path: The document.
        data: What `results.json` holds.
        label: Which of several comparisons in the document this one is.

    Raises:
        MissingFileError: There is no such document.
        ConfigurationError: It has no mark, or one without an end.
    """
    names = ("summary", *tables.PARTS)
    parts = {name: part_markdown(name, data["structures"]) for name in names}
    fill(path, label, {"facts": facts(data), **parts})
    (path.parent / "figures").mkdir(exist_ok=True)
    for one in data["structures"]:
        name = f"{label}_{one['structure']}.svg"
        write_text(path.parent / "figures" / name, noise_figure(one))
    return path
