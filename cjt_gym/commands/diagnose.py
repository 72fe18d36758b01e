"""`cjt-gym diagnose`: where a recorded joint and its simulation differ, why, and how far."""

from __future__ import annotations

import argparse
import json
import sys
import textwrap
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from cjt_gym.console import Answer
from cjt_gym.console.options import asked_effects
from cjt_gym.disk import refuse_inputs, write_text
from cjt_gym.errors import ConfigurationError, UnknownNameError, check_range
from cjt_gym.gap import Diagnosis, diagnose
from cjt_gym.gap.diagnosis import NamedEffect
from cjt_gym.gap.recorded.orient import all_oriented
from cjt_gym.gap.recorded.series import SHORTEST
from cjt_gym.gap.recorded.usable import check_one_joint
from cjt_gym.gap.report import WIDTH, summary, write_report
from cjt_gym.joint import (
    STRUCTURES,
    JointFile,
    get_structure,
    load_joint,
    load_joint_file,
    to_toml,
)
from cjt_gym.joint.build import file_of
from cjt_gym.records import Record, Repair, joint_of, read_log, record_names
from cjt_gym.records.files import NOMINAL
from cjt_gym.training.evaluation.after_diagnosis import InTheLoop, agents_for, in_the_loop

SECONDS, WINDOW = 60.0, 10.0
"""Length of a log beyond which only its most informative windows are used, and theirs [s]."""
MOST_REPAIRS = 6
"""Number of repairs that the terminal shows; the report lists all."""
USUAL = frozenset({"missing", "sampling", "stale", "glitch", "wrap", "cut", "order", "repeated"})
"""Kinds of repairs that are told last: they are mended, and hardly change what a log tells."""
FILES = ("diagnosis.json", "report.html", "joint.toml")
NEXT = ("next.npz", "next.toml")
"""The next excitation, which is written only where there is one."""
CLEAR = "\r\x1b[2K"
NO_LOOP = InTheLoop(None, (), ())
PAST_THE_DRIVE = "To simulate or train from commands, uncomment what a measured current has passed:"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what was recorded, of what, and where to write the findings."""
    add = parser.add_argument
    shipped = ", ".join(record_names())
    add("records", nargs="+", metavar="RECORD", help=f"files, or a record that ships: {shipped}")
    text = (
        f"nominal joint: a name or a file; default: what the record names, or {NOMINAL} beside it"
    )
    add("--joint", metavar="JOINT|FILE.toml", help=text)
    text = f"{', '.join(STRUCTURES)}; default: what the record or the joint file says"
    add("--structure", metavar="S", help=text)
    text = "exactly these effects of the nominal joint, as in simulate; default: those of its file"
    add("--effect", nargs="+", metavar="E", help=text)
    text = "records with other excitation, on which the findings are tested"
    add("--validate", nargs="+", default=[], metavar="RECORD", help=text)
    add("--mapping", metavar="FILE", help="TOML file that says which column is what, in which unit")
    text = "controllers to run in the nominal and in the identified joint against the recorded "
    text += "tau_ref; where the record does not say what made it, it was the first of them"
    add("--controller", nargs="+", default=[], metavar="C", help=text)
    text = "run folders of policies to run in both joints"
    add("--policy", nargs="+", default=[], metavar="RUN", help=text)
    text = f"of longer logs use the most informative windows of so long in all [s], {SECONDS:g}"
    add("--seconds", type=float, default=SECONDS, help=text)
    text = f"folder for {', '.join(FILES)}; default: diagnosis/NAME of the first record"
    add("--out", type=Path, metavar="DIR", help=text)


def run(options: argparse.Namespace) -> Answer:
    """Diagnose, write the three files, and print what was found."""
    started = time.perf_counter()
    check_range("--seconds", options.seconds, "s", low=WINDOW)
    tell = Teller(started)
    tell("reading records")
    joint = _nominal(options)
    file = _loaded(joint, options)
    fitted, notes = _read(options.records, options, file)
    held, more = _read(options.validate, options, file)
    if options.joint is None:
        check_one_joint([*fitted, *held])
    structure = options.structure or fitted[0].structure or file.structure
    if structure is None:
        raise ConfigurationError(
            f"{fitted[0].owner} names no structure. Give one: --structure {' | '.join(STRUCTURES)}."
        )
    if options.effect is not None:
        file = file_of(load_joint(joint, structure, effects=asked_effects(options)))
    shape = get_structure(structure)
    fitted, turned = all_oriented(fitted, file, shape)
    held, also = all_oriented(held, file, shape)
    folder = options.out or Path("diagnosis") / Path(options.records[0]).stem
    agents = agents_for(options.controller, options.policy, [*held, *fitted])
    nominal = joint if str(joint).endswith(".toml") else None
    refuse_inputs(
        [folder / name for name in (*FILES, *NEXT)], [nominal, *options.records, *options.validate]
    )
    _make(folder)
    found = diagnose(fitted, file, structure, held, progress=tell)
    tell("replaying in a closed loop")
    loop = in_the_loop(found, file, structure, fitted, held, agents)
    tell("writing the report")
    repairs = [*notes, *more, *turned, *also]
    found = write_files(found, folder, _short_name(Path(options.records[0])), repairs, loop)
    tell.end()
    tables = [table.text(WIDTH) for table in loop.tables()]
    parts = [
        *filter(None, [_of_the_record(found, repairs)]),
        summary(found).rstrip(),
        *tables,
        *loop.notes,
        _where(folder, found),
    ]
    return json.loads((folder / "diagnosis.json").read_text(encoding="utf-8")), "\n\n".join(parts)


def _of_the_record(found: Diagnosis, repairs: Sequence[Repair]) -> str:
    """Return what was repaired in the records, and their faults, as lines."""
    faults = () if found.examination is None else found.examination.faults
    grave, usual = (
        [repair.text for repair in repairs if (repair.kind in USUAL) == is_usual]
        for is_usual in (False, True)
    )
    told = list(dict.fromkeys((*grave, *(text for text in faults if text not in usual), *usual)))
    more = len(told) - MOST_REPAIRS
    also = [f"and {more} more in the report."] if more > 0 else []
    lines = (
        textwrap.fill(f"record: {text}", WIDTH, subsequent_indent="  ")
        for text in [*told[:MOST_REPAIRS], *also]
    )
    return "\n".join(lines)


def _short_name(path: Path) -> str:
    """Return the name of a record with its folder's, without a suffix."""
    return "/".join((*path.parent.parts[-1:], path.stem)).lstrip("/")


def write_files(
    diagnosis: Diagnosis,
    folder: Path,
    name: str,
    repairs: Sequence[Repair] = (),
    loop: InTheLoop = NO_LOOP,
) -> Diagnosis:
    """Write diagnosis.json, report.html, joint.toml, and the next excitation if there is one.

    That of an earlier diagnosis is removed, as it is for another joint or record. The diagnosis
    that is returned names its excitation file.
    """
    for old in NEXT:
        (folder / old).unlink(missing_ok=True)
    next_record = diagnosis.suggestion.written(folder / NEXT[0])
    diagnosis = replace(diagnosis, suggestion=next_record)
    write_text(folder / "diagnosis.json", _json(diagnosis, loop, repairs))
    write_text(folder / "joint.toml", joint_text(diagnosis, name))
    notes = [*(repair.text for repair in repairs), *loop.notes]
    title, tables = f"Diagnosis of {name}", loop.tables()
    write_report(diagnosis, folder / "report.html", title=title, notes=notes, tables=tables)
    return diagnosis


def _make(folder: Path) -> None:
    """Make the folder before the work begins, so that its writer need not wait for an error."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigurationError(
            f"The folder {folder} cannot be created: {error.strerror}. Give another one with --out."
        ) from error


def joint_text(diagnosis: Diagnosis, name: str) -> str:
    """Return the text of joint.toml: the identified joint, with what its reader should know."""
    joint = diagnosis.joint
    doubtful = [e.name for e in diagnosis.effects if e.status == "tentative"]
    here = {e.name for e in diagnosis.effects if e.name in joint.effects}
    driven = _of_the_command(diagnosis)
    apart = [e.name for e in diagnosis.effects if e.name not in here and e not in driven]
    lines = [
        f"The joint as a diagnosis of {name} found it: the nominal one with the named effects, "
        f"{len(here) or 'none'} here.",
        f"Verdict: {diagnosis.verdict}.",
        'low and high are 95 % intervals; randomization = "identified" draws '
        + ("as found.covariance says." if "covariance" in joint.found else "within them."),
        "Values are refined within their datasheet tolerance where the record determines them",
        "better, and those under [effects] take the place of the same ones under [parameters].",
    ]
    if doubtful:
        lines.append(f"Tentative: {', '.join(doubtful)}.")
    if apart:
        lines.append(f"Named, but not in here: {', '.join(apart)}.")
    if others := sorted(joint.effects.keys() - here):
        lines.append(f"Also in here, listed or fitted, but not named: {', '.join(others)}.")
    if diagnosis.unexplained.stage is not None:
        lines.append(f"Remarks: {diagnosis.unexplained.text}")
    text = "".join(f"# {line}\n" for line in lines) + to_toml(joint)
    if not driven:
        return text
    tables = "\n".join(_commented(effect) for effect in driven)
    return f"{text}\n# {PAST_THE_DRIVE}\n{tables}"


def _of_the_command(diagnosis: Diagnosis) -> list[NamedEffect]:
    """Return the effects of a drive that are not in the joint: its input is measured behind it."""
    given = diagnosis.joint.effects
    return [e for e in diagnosis.effects if e.stage == "drive" and e.name not in given]


def _commented(effect: NamedEffect) -> str:
    """Return the table of an effect as comments to be uncommented."""
    rows = [
        f'# {symbol} = {{ value = {one.value:.6g}, unit = "{one.unit}", '
        f"low = {one.low:.6g}, high = {one.high:.6g} }}\n"
        for symbol, one in effect.parameters.items()
    ]
    return f"# [effects.{effect.name}]\n" + "".join(rows)


class Teller:
    """Tells on standard error how far the work is.

    On a terminal one line is written over and over; elsewhere each new step gets its own line.
    """

    def __init__(self, started: float) -> None:
        """Tell the time from `started` [s of the performance counter]."""
        self.started = started
        self.on_terminal = sys.stderr.isatty()
        self.last = ""

    def __call__(self, step: str) -> None:
        """Tell that a step begins."""
        head = f"{time.perf_counter() - self.started:5.1f} s  "
        if self.on_terminal:
            sys.stderr.write(f"{CLEAR}{head}{step} ...")
        elif step != self.last:
            sys.stderr.write(f"{head}{step}\n")
        self.last = step
        sys.stderr.flush()

    def end(self) -> None:
        """Clear the line of a terminal."""
        if self.on_terminal:
            sys.stderr.write(CLEAR)
            sys.stderr.flush()


def _read(
    words: Sequence[str], options: argparse.Namespace, joint: JointFile
) -> tuple[list[Record], list[Repair]]:
    """Return records and what was repaired in them."""
    records: list[Record] = []
    repairs: list[Repair] = []
    for word in words:
        found, notes = read_log(word, options.mapping, options.seconds, joint.gear_ratio)
        pieces = sorted(found, key=len, reverse=True)
        records += [piece for piece in pieces if len(piece) >= SHORTEST] or pieces
        repairs += notes
    return records, repairs


def _nominal(options: argparse.Namespace) -> str | Path:
    """Return the nominal joint that was given, that the record names, or that lies beside it."""
    joint = options.joint or joint_of(options.records[0], options.mapping)
    if joint is None:
        raise ConfigurationError(
            f"{options.records[0]} names no joint, and there is no {NOMINAL} beside it. "
            "Give the nominal joint: --joint NAME or --joint FILE.toml."
        )
    return joint


def _loaded(joint: str | Path, options: argparse.Namespace) -> JointFile:
    try:
        return load_joint_file(joint)
    except UnknownNameError as error:
        if options.joint is not None:
            raise
        raise ConfigurationError(
            f"{options.records[0]} names the joint {joint}, which does not ship, and its file is "
            "neither where it was nor beside the record. Give it: --joint FILE.toml."
        ) from error


def _json(diagnosis: Diagnosis, loop: InTheLoop, repairs: Sequence[Repair]) -> str:
    more = {"repairs": [repair.text for repair in repairs]}
    return json.dumps(diagnosis.to_dict() | loop.to_dict() | more, indent=1, allow_nan=False) + "\n"


def _where(folder: Path, diagnosis: Diagnosis) -> str:
    files = [str(folder / name) for name in FILES]
    if driven := [e.name for e in _of_the_command(diagnosis)]:
        text = (
            f"joint.toml holds {' and '.join(driven)} as a comment at its end, as the measured "
            "current has passed it: uncomment that to simulate or train from commands."
        )
        files.append(textwrap.fill(text, WIDTH))
    if diagnosis.suggestion.record is not None:
        files.append(diagnosis.suggestion.record)
    return "\n".join(files)
