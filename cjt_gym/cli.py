"""The command `cjt-gym`: one row and one file in `cjt_gym.commands` per subcommand.

Exit status: 0 on success, 2 on bad input (one line on standard error), 1 otherwise. Results go to
standard output, as text or with `--json` as JSON; progress goes to standard error.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import warnings
from collections.abc import Sequence
from importlib import import_module
from itertools import takewhile
from typing import Any, NoReturn

from cjt_gym.console import Answer
from cjt_gym.console.alive import WORKING, Alive
from cjt_gym.errors import CjtGymError, UnknownNameError, did_you_mean, unknown_name

COMMANDS: dict[str, str] = {
    "joints": "list the joints, structures, drives and effects there are",
    "simulate": "simulate a joint under a reference and a controller, and write the record",
    "train": "train a policy with Stable-Baselines3, or resume a run that was stopped",
    "runs": "list and compare training runs, and write the page of one",
    "policies": "list the trained policies that ship, or show the card of one",
    "tune": "search the gains of a controller on a joint, within limits on its robustness",
    "benchmark": "compare controllers and policies on the same joints and references",
    "blind-test": "diagnose joints whose effects are hidden, and score what was found",
    "analyse": "draw linear responses, poles, zeros and steps of joints",
    "build": "make many joints from a table of parameter sets, structures and effects",
    "datasheet": "write what a joint can do on a few pages, as PDF or HTML; compare several",
    "export": "write a joint for MuJoCo or Isaac Lab, a policy or a controller for a control loop",
    "hardware": "run a controller, policy or experiment on a joint on a CAN bus",
    "emulate": "serve an emulated drive with a simulated joint on a CAN bus",
    "bus": "say which rate a CAN bus can carry for its joints, before anything is armed",
    "check": "say what a record can and cannot tell, before any fit",
    "convert": "turn a log, a trace of a CAN bus or a record into a record; a joint (.m) into TOML",
    "plot": "draw records as a picture or a page",
    "diagnose": "find where a recorded joint and its simulation differ, why, and how far",
    "warm-up": "compile everything once, so that nothing has to later",
}
GOING_ON = ("emulate",)
"""Commands that give no sign of life after their first words, as they wait for others."""
EXTRAS = {
    "can": "can",
    "foxglove": "live",
    "torch": "train",
    "stable_baselines3": "train",
    "tensorboard": "train",
    "tqdm": "benchmark",
    "cma": "tune",
    "optuna": "tune",
    "joblib": "benchmark",
    "sympy": "symbolic",
    "typst": "datasheet",
    "pyarrow": "parquet",
    "sb3_contrib": "train",
}


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"must be a finite number, got {text}.")
    return value


class _Store(argparse.Action):
    """Store what was given; an option of several values that is repeated loses none of them."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,
        option_string: str | None = None,
    ) -> None:
        before = getattr(namespace, self.dest, None)
        if option_string and self.nargs in ("+", "*") and before and before is not self.default:
            values = [*before, *values]
        setattr(namespace, self.dest, values)


class Parser(argparse.ArgumentParser):
    """A parser that answers bad input with one line."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        """Take finite numbers only, and options of several values repeatedly."""
        super().__init__(*arguments, **options)
        self.register("type", float, _finite)
        self.register("action", None, _Store)

    def error(self, message: str) -> NoReturn:
        """Print the line and exit with status 2."""
        self.exit(2, f"{self.prog}: {message.rstrip('.')}. See {self.prog} --help.\n")

    def check_options(self, words: Sequence[str]) -> None:
        """Raise UnknownNameError for an option that it does not have, and suggest the nearest."""
        known = self._option_string_actions
        for word in takewhile("--".__ne__, words):
            name = word.partition("=")[0]
            if name.startswith("--") and not any(option.startswith(name) for option in known):
                raise UnknownNameError(
                    f"Unknown option {name} of {self.prog.partition(' ')[2]}."
                    f"{did_you_mean(name, known)} See {self.prog} --help."
                )


def make_parser() -> Parser:
    """Return the parser of all subcommands; a subcommand's own options are added when it runs."""
    parser = Parser(prog="cjt-gym", description="Compliant joints for learning torque control.")
    parser.add_argument("--version", action="store_true", help="print the version and exit")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", parser_class=Parser)
    for name, text in COMMANDS.items():
        commands.add_parser(name, help=text, add_help=False)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit status."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    command = next((word for word in words if not word.startswith("-")), None)
    if command is not None and command not in COMMANDS:
        return _fail(str(unknown_name("command", command, COMMANDS)), 2)
    parser = make_parser()
    known, rest = parser.parse_known_args(words)
    if known.version:
        from cjt_gym import __version__

        sys.stdout.write(f"cjt-gym {__version__}\n")
        return 0
    if known.command is None:
        if rest:
            parser.error(f"unknown option {rest[0]}.")
        parser.print_help()
        return 0
    return _run(known.command, words[words.index(known.command) + 1 :], arguments is None)


def _run(command: str, words: Sequence[str], in_shell: bool) -> int:
    with warnings.catch_warnings():
        warnings.showwarning = _Warnings().show
        if not in_shell:
            return _run_command(command, words)
        with Alive(until_a_word=command in GOING_ON) as alive:
            return _run_command(command, words, alive)


class _Warnings:
    """Shows each warning once, as one line without the place in the code that it comes from."""

    def __init__(self) -> None:
        self.shown: set[str] = set()

    def show(self, message: Warning | str, *rest: Any, **named: Any) -> None:
        line = " ".join(str(message).split())
        if line not in self.shown:
            self.shown.add(line)
            sys.stderr.write(f"cjt-gym: {line}\n")


def _run_command(command: str, words: Sequence[str], alive: Alive | None = None) -> int:
    try:
        module = import_module(f"cjt_gym.commands.{command.replace('-', '_')}")
        parser = Parser(prog=f"cjt-gym {command}", description=COMMANDS[command])
        module.add_arguments(parser)
        parser.add_argument("--json", action="store_true", help="print the result as JSON")
        parser.check_options(words)
        options = parser.parse_args(words)
        if alive is not None:
            alive.doing = WORKING
            alive.watch_compiler()
        answer: Answer | None = module.run(options)
        if answer is not None:
            data, text = answer
            sys.stdout.write((json.dumps(data) if options.json else text.rstrip("\n")) + "\n")
        sys.stdout.flush()
    except BrokenPipeError:  # the reader of a pipe has had enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (CjtGymError, OSError) as error:
        if not isinstance(error, CjtGymError) and error.filename is not None:
            return _fail(f"{error.filename} cannot be used: {error.strerror}.", 2)
        failed_on_the_way = isinstance(error, (ArithmeticError, RuntimeError))
        return _fail(str(error), 1 if failed_on_the_way else 2)
    except ModuleNotFoundError as error:
        extra = EXTRAS.get((error.name or "").split(".")[0])
        if extra is None:
            raise
        return _fail(f'This needs {error.name}: pip install "cjt-gym[{extra}]".', 2)
    except MemoryError:
        return _fail("There is not enough memory for this. Ask for fewer or shorter runs.", 1)
    except KeyboardInterrupt:
        return _fail("Stopped.", 1)
    return 0


def _fail(message: str, status: int) -> int:
    sys.stderr.write(f"cjt-gym: {' '.join(message.split())}\n")
    return status
