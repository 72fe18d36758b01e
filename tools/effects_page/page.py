"""The text of the page, from the effect table and the table of figures."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from cjt_gym.console.joint_tables import (
    default_in_words,
    domain_in_words,
    off_in_words,
    typical_in_words,
)
from cjt_gym.joint import DRIVES, EFFECTS, STAGES, STRUCTURES, Effect
from cjt_gym.joint.effects import PLACES
from tools.effects_page.figures import PLOTS
from tools.effects_page.snippets import python_snippet, toml_snippet

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "effects.md"
FIGURES = ROOT / "docs" / "figures" / "effects"

STAGE_TITLES = {
    "drive": "Drive: between the command and the current",
    "motor": "Motor: its torque, and friction of all bodies",
    "transmission": "Transmission: gear and torsion bar",
    "sensing": "Sensing: between the true values and what is measured",
    "load": "Load: what the joint is attached to",
}

INTRODUCTION = """\
# Effects

<!-- Written by `python -m tools.effects_page`; change the effect table instead. -->

Everything that separates a real joint from the linear one is a row of one table,
`cjt_gym/joint/effects/`. From it come this page, the options of the environments, the names that
can be randomised (`coulomb.d_cm`) and the list that `cjt-gym joints --json` prints.

- An effect is off unless the joint file lists it under `[effects.<name>]` or it is asked for by
  name, `effects=["coulomb"]`, or with values, `effects={"coulomb": {"d_cm": 2.0}}`. `effects="all"`
  turns on all that can act, with typical values where the joint file says nothing.
- A value that is not given comes from the same effect in the joint file, then from the joint
  parameter or sensor named under "from the joint file", then from the default; "needed" means that
  there is none.
- Symbols in bold make an effect do something, unless they have the value under "off at"; a symbol
  there means the joint's own value. The other parameters only shape the effect.
- "Plausible" is the range of real joints, "typical" a value for studies; the peak current is i_p,
  the peak torque k_t n i_p.
  A value may lie outside of the plausible range, within what stands under "meaning".
- Friction acts on the bodies that its parameters name: motor (`m`), gear (`g`) and load (`l`). With
  `body = "gear"` an effect keeps to one of them. Effects of channels take a value for each channel.
- Units are those of a rotary joint on the link side; a prismatic one has m, N and kg instead.

The figures are simulated with the same kernel as the environments, on `orange_80_6000` with the
parameters that the bench needs. Points are simulated, thin lines are the law. The first snippet of
each effect belongs in a joint file, the second needs `from cjt_gym.joint import load_joint`; both
have the typical values of that joint.
"""


def page_text() -> str:
    """Return the whole page."""
    parts = [INTRODUCTION, "## Overview\n", *(_overview(stage) for stage in STAGES)]
    for stage in STAGES:
        parts.append(f"## {STAGE_TITLES[stage]}\n")
        parts += [_section(effect) for effect in EFFECTS.values() if effect.stage == stage]
    return "\n".join(parts)


def _overview(stage: str) -> str:
    rows = [
        (f"[`{e.name}`](#{e.name})", _text(e.summary), ", ".join(f"`{s}`" for s in e.size))
        for e in EFFECTS.values()
        if e.stage == stage
    ]
    title = f"**{STAGE_TITLES[stage]}**\n\n"
    return title + _table(("effect", "what it does", "what makes it act"), rows) + "\n"


def _section(effect: Effect) -> str:
    plot = PLOTS[effect.name]
    figure = (FIGURES / f"{effect.name}.svg").relative_to(PAGE.parent).as_posix()
    equation = "\n\n".join(f"$$\n{line}\n$$" for line in plot.equation.splitlines())
    facts = [f"- Acts in {_place(effect)}."]
    if effect.bodies:
        facts.append(f"- Bodies: {', '.join(effect.bodies)}.")
    if effect.channels:
        facts.append(f"- Channels: {', '.join(f'`{c}`' for c in effect.channels)}.")
    if effect.excludes:
        links = ", ".join(f"[`{name}`](#{name})" for name in effect.excludes)
        facts.append(f"- Excludes {links}, which describes the same thing.")
    facts.append(f"- Source: {effect.source}.")
    return "\n".join(
        [
            f"### {effect.name}\n",
            f"{_text(effect.summary)}\n",
            f"{equation}\n",
            f"![{effect.name}]({figure})\n",
            f"*{_text(plot.caption)}*\n",
            *facts,
            "",
            _parameters(effect),
            "",
            f"```toml\n{toml_snippet(effect)}```\n",
            f"```python\n{python_snippet(effect)}```\n",
        ]
    )


def _parameters(effect: Effect) -> str:
    columns = ("symbol", "unit", "off at", "plausible", "typical", "default", "from the joint file")
    rows = []
    for p in effect.parameters:
        symbol = f"**`{p.symbol}`**" if p.symbol in effect.size else f"`{p.symbol}`"
        shared = " One number per joint, shared by all effects that have it." if p.shared else ""
        series = " A list of numbers." if p.series else ""
        rows.append(
            (
                symbol,
                p.unit,
                off_in_words(p) if p.symbol in effect.size else "",
                f"{p.low:g} .. {p.high:g}",
                typical_in_words(p),
                default_in_words(effect, p),
                f"`{p.joint_parameter}`" if p.joint_parameter else "",
                _text(f"{p.description}; {domain_in_words(effect, p)}.{shared}{series}"),
            )
        )
    return _table((*columns, "meaning"), rows)


def _place(effect: Effect) -> str:
    if not effect.needs:
        return "every structure, with every drive"
    place = PLACES[effect.needs]
    able = [name for name, row in STRUCTURES.items() if any(effect.acts_in(row, d) for d in DRIVES)]
    if len(able) == len(STRUCTURES):
        return f"{place}, in every structure"
    return f"{place.split(' (')[0]}: {', '.join(f'`{name}`' for name in able)}"


def _text(line: str) -> str:
    return line.replace("*", "\\*")


def _table(titles: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    titles = tuple(titles)
    lines = [f"| {' | '.join(titles)} |", "|" + "---|" * len(titles)]
    for row in rows:
        cells = " | ".join(cell.replace("|", "\\|") for cell in row)
        lines.append(f"| {cells} |")
    return "\n".join(lines)
