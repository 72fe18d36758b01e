"""What a sheet says about one joint or several."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from functools import partial

from cjt_gym import __version__
from cjt_gym.characteristics import CHARACTERISTICS, acting, changing, characteristic
from cjt_gym.characteristics.motor import usable_power
from cjt_gym.characteristics.table import GROUPS
from cjt_gym.datasheet import figures, plots
from cjt_gym.datasheet.blocks import (
    Block,
    Facts,
    Figure,
    Heading,
    PageBreak,
    Paragraph,
    Sheet,
    Table,
)
from cjt_gym.datasheet.notation import named, number, plain, unit, with_tolerance
from cjt_gym.datasheet.resistance import friction_and_ripple, has_ripple
from cjt_gym.errors import ParameterError
from cjt_gym.joint import EFFECTS, JointFile, JointParameters, Quantity
from cjt_gym.joint.files.parameters import PARAMETERS

Drawing = tuple[str, Callable[[Sequence[JointParameters]], str], str, str]
"""Name, what draws it, and its caption for one joint and for several; empty: left out."""
EFFICIENCY = (
    "Efficiency of driving, friction and copper loss included. Red: largest; black: rated point. "
    "White: friction takes all, or the supply is too low."
)
HEAT = (
    "Above: how long the winding can hold a constant torque. Below: where its temperature ends; "
    "dashed: its limit. Dotted: rated torque"
)
IMPEDANCE = (
    "Impedance of the output that moves by ± {motion}: what an ideal controller can make of it "
    "with the motor's torque and voltage."
)
DRAWINGS: Sequence[Drawing] = (
    (
        "torque and speed",
        partial(figures.alone, plots.torque_speed),
        "Torque and speed. Dark: continuous (black point: rated). Light: for a short time. "
        "Friction comes off the motor's torque (red point: no load).",
        "Torque-speed lines up to the peak torque; points: rated.",
    ),
    ("efficiency", figures.efficiency_map, EFFICIENCY, ""),
    (
        "efficiency at some speeds",
        lambda joints: figures.alone(plots.efficiency_curves, joints[0]),
        "Efficiency over torque at some speeds; dashed: at full voltage. Dotted: rated torque.",
        "",
    ),
    ("heat", figures.heat, f"{HEAT}.", f"{HEAT}s."),
    (
        "torque over frequency",
        partial(figures.alone, plots.torque_bandwidth),
        "Torque on a locked output over frequency, by what limits it. Light: for a short time. "
        "Dark: continuous.",
        "Torque on a locked output over frequency: for a short time; dashed: continuous.",
    ),
    (
        "holding time",
        partial(figures.with_scale, plots.holding, "time held [s]"),
        "How long a torque on a locked output can be held, by its amplitude and frequency, from "
        "ambient. Below the white line: for ever. Blank: not possible.",
        "",
    ),
    (
        "torque with free loads",
        partial(figures.with_scale, plots.torque_with_load, "load inertia / $(I_m + I_g)$"),
        "The same for a short time, with free loads. Below, a light load gives way; at the "
        "resonance little motor torque is needed.",
        "",
    ),
    ("impedance", partial(figures.alone, plots.impedance), IMPEDANCE, IMPEDANCE),
    ("efficiency", figures.efficiency_map, "", EFFICIENCY),
)
RATED = (" Dark: continuous (black point: rated).", " Dark: continuous.",
         " Dotted: rated torque.", "; black: rated point")  # fmt: skip
"""What captions say of rated torque, which joints without thermal parameters do not have."""
FACTS = ("t_r", "t_p", "dq_NL", "p_pm", "eta_max", "f_p")
ASIDE = re.compile(r";| \(|, (?=acts|whose|motor|limit|reflected)")
SYMBOLS = {"Tmp_WMax": "T_max", "Tmp_ANom": "T_A", "diam": "D", "len": "L", "dq_p": "ω_p"}


def make_sheet(files: Sequence[JointFile]) -> Sheet:
    """Return the sheet of one joint, or of several side by side."""
    joints = [acting(file) for file in files]
    if len(joints) == 1:
        title, subtitle = named(joints[0].name), plain(joints[0].source)
    else:
        title = " · ".join(named(p.name) for p in joints)
        subtitle = f"Comparison of {len(joints)} joints"
    blocks = [
        *_facts(joints),
        *_plots(joints),
        *_notes(joints),
        *([PageBreak()] if CHARACTERISTICS["t_r"].value(joints[0]) is not None else []),
        *_effects(files),
        *_characteristics(joints),
        *_parameters([file.parameters for file in files]),
    ]
    footer = (
        f"Computed by cjt-gym {__version__} from the parameters listed; link side, SI units, "
        "positive direction."
    )
    return Sheet(title, subtitle, blocks, footer)


def _facts(joints: Sequence[JointParameters]) -> Iterator[Block]:
    if len(joints) > 1:
        return
    (p,) = joints
    known = {name: value for name in FACTS if (value := CHARACTERISTICS[name].value(p)) is not None}
    titles = {name: CHARACTERISTICS[name].title for name in known}
    if "p_pm" in known:
        known["p_pm"] = usable_power(p)
    if p.get("dq_p", math.inf) < known.get("dq_NL", 0.0):
        known["dq_NL"], titles["dq_NL"] = p.dq_p, "peak speed"
    shown = [
        (titles[name], number(value, 3), unit(CHARACTERISTICS[name].unit(p.axis)))
        for name, value in known.items()
    ]
    if shown:
        yield Facts(shown)


def _plots(joints: Sequence[JointParameters]) -> Iterator[Block]:
    one = len(joints) == 1
    missing: dict[str, list[str]] = {}
    for name, draw, of_one, of_several in DRAWINGS:
        caption = of_one if one else of_several
        if not caption:
            continue
        try:
            svg = draw(joints)
        except ParameterError as error:
            missing.setdefault(str(error), []).append(name)
            continue
        for rated in RATED if CHARACTERISTICS["t_r"].value(joints[0]) is None else ():
            caption = caption.replace(rated, "")
        if caption == IMPEDANCE:
            unit = "rad" if joints[0].axis == "rotary" else "m"
            caption = caption.format(motion=f"{min(map(plots.usual_motion, joints)):g} {unit}")
        yield Figure(svg, caption, whole=not one and name == "efficiency")
    if missing:
        texts = [f"{', '.join(names).capitalize()}: {plain(why)}" for why, names in missing.items()]
        yield Paragraph(f"Not drawn. {' '.join(texts)}", small=True)


def _notes(joints: Sequence[JointParameters]) -> Iterator[Block]:
    """Yield what a user must know that no number says."""
    for p in joints:
        rated, peak, coulomb = (CHARACTERISTICS[name].value(p) for name in ("t_r", "t_p", "Mc"))
        if rated is None or peak is None or coulomb is None:
            continue
        lost = characteristic(p, "t_NL")
        name = named(p.name)
        if rated < lost:
            yield Paragraph(
                f"{name}: friction at the no-load speed ({number(lost, 3)} {p.unit('d_cm')}) is "
                f"above the rated torque ({number(rated, 3)} {p.unit('d_cm')}), so that the joint "
                "cannot run at full speed continuously.",
                small=True,
            )


def _characteristics(joints: Sequence[JointParameters]) -> Iterator[Block]:
    """Yield the table of characteristics with an explanation of each."""
    axis = joints[0].axis
    rows: list[tuple[str, ...]] = []
    for group in GROUPS:
        found = []
        for row in CHARACTERISTICS.values():
            values = [row.value(p) for p in joints]
            if row.group != group or all(value is None for value in values):
                continue
            cells = [
                with_tolerance(value, row.tolerance(p))
                for p, value in zip(joints, values, strict=True)
            ]
            title = row.title[0].upper() + row.title[1:]
            what = f"{title}. {row.text}" if len(joints) == 1 else title
            formula = (f"${row.formula}$",) if len(joints) == 1 else ()
            found.append((f"${row.symbol}$", *cells, unit(row.unit(axis)), what, *formula))
        if found:
            rows += [(group[0].upper() + group[1:],), *found]
    if any(row.value(p) is not None for row in CHARACTERISTICS.values() for p in joints):
        yield Heading("Characteristics")
    endless = {
        f"${row.symbol}$ = ∞: {row.infinite}."
        for row in CHARACTERISTICS.values()
        if any((value := row.value(p)) is not None and math.isinf(value) for p in joints)
    }
    notes = [Paragraph(" ".join(sorted(endless)), small=True)] if endless else []
    if len(joints) == 1:
        yield Table(("", "Value", "Unit", "What it is", "Formula"), rows, "lrlll", wide=(3,))
        yield from notes
        return
    names = [named(p.name) for p in joints]
    head = ("", *names, "Unit", "What it is")
    yield Table(head, rows, "l" + "r" * len(joints) + "ll", wide=(len(head) - 1,))
    yield from notes


def _parameters(joints: Sequence[JointParameters]) -> Iterator[Block]:
    """Yield the parameters of the joint files, with the sources below."""
    sources: dict[str, int] = {}
    rows = []
    for symbol, spec in PARAMETERS.items():
        quantities = [p.quantities.get(symbol) for p in joints]
        if all(q is None for q in quantities) or _repeats(symbol, joints):
            continue
        marks = []
        for q in quantities:
            source = "" if q is None else plain(q.source or "this file")
            marks.append(str(sources.setdefault(source, len(sources) + 1)) if source else "")
        cells = [_value(q) for q in quantities]
        where = ", ".join(dict.fromkeys(mark for mark in marks if mark))
        what = ASIDE.split(spec.description)[0]
        name = f"${SYMBOLS.get(symbol, symbol)}$"
        rows.append((name, *cells, unit(joints[0].unit(symbol)), what, where))
    yield Heading("Parameters")
    head = ("", *(["Value"] if len(joints) == 1 else [named(p.name) for p in joints]),
            "Unit", "What it is", "Source")  # fmt: skip
    align = "l" + "r" * len(joints) + "lll"
    columns = 2 if len(joints) == 1 else 1
    yield Table(head, rows, align, wide=(len(head) - 2,), columns=columns)
    listed = "; ".join(f"{k}: {text}" for text, k in sources.items())
    yield Paragraph(
        f"Sources: {listed}. ± is one sigma; in brackets the 95 % interval.", small=True
    )


def _repeats(symbol: str, joints: Sequence[JointParameters]) -> bool:
    """Return whether a value of negative direction is that of positive direction."""
    partner = symbol.removesuffix("_n")
    return partner != symbol and all(p.get(symbol, 0.0) == p.get(partner, 0.0) for p in joints)


def _value(quantity: Quantity | None) -> str:
    if quantity is None:
        return number(None)
    if isinstance(quantity.value, tuple):
        parts = [number(x) for x in quantity.value]
        if isinstance(quantity.low, tuple) and isinstance(quantity.high, tuple):
            ends = zip(quantity.low, quantity.high, strict=True)
            spans = [f" ({number(low)} … {number(high)})" for low, high in ends]
            parts = [part + span for part, span in zip(parts, spans, strict=True)]
        return ", ".join(parts)
    text = number(quantity.value, 6)
    if isinstance(quantity.low, float) and isinstance(quantity.high, float):
        return f"{number(quantity.value)} ({number(quantity.low)} … {number(quantity.high)})"
    if quantity.tolerance:
        text = with_tolerance(quantity.value, abs(quantity.tolerance * quantity.value))
    return f"{text} (guess)" if quantity.guess else text


def _effects(files: Sequence[JointFile]) -> Iterator[Block]:
    """Yield the effects that joint files list: their numbers, and friction and ripple drawn."""
    rows: list[tuple[str, ...]] = []
    for file in files:
        name = named(file.name)
        for effect, entries in file.effects.items():
            row = EFFECTS[effect]
            title = f"{effect.replace('_', ' ')}: {row.summary}"
            rows.append(((f"{name}, " if len(files) > 1 else "") + title,))
            for symbol, setting in entries.items():
                if not isinstance(setting, Quantity):
                    continue
                known = row.parameter(symbol)
                text = known.description if known else ""
                rows.append((f"${symbol}$", _value(setting), unit(setting.unit), text))
    if not rows:
        return
    yield Heading("Effects beyond the linear joint")
    included = list(dict.fromkeys(name for file in files for name in changing(file)))
    if included:
        names = ", ".join(name.replace("_", " ") for name in included)
        text = f"Figures and characteristics include what is another value of a parameter: {names}."
        text += " What else stands here is not in them."
    else:
        text = "Figures and characteristics follow from the parameters, without these effects."
    yield Paragraph(text, small=True)
    drawn = friction_and_ripple(files)
    if drawn:
        beside = has_ripple(files)
        alone = " and as the parameters alone have it (dashed)" if len(files) == 1 else ""
        caption = "Left: friction" if beside else "Friction"
        caption += f" over speed, with the effects{alone}."
        caption += " Right: torque of ripple over the motor's angle, at rest." if beside else ""
        yield Figure(drawn, caption, whole=True)
    yield Table(("", "Value", "Unit", "What it is"), rows, "lrll", wide=(3,))
