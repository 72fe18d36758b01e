"""Checks of names and options before anything slow is imported."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path

from cjt_gym.errors import UnknownNameError, did_you_mean, unknown_name

OWN = re.compile(r"[./\\:@+]")
"""Characters that only occur in paths, parts and your own code, which are checked later."""
FIRST = {
    "tune": "--controller",
    "simulate": "--joint",
    "analyse": "--joint",
    "datasheet": "--joint",
}
"""The option whose values may stand before the first option of a command."""
OTHERWISE = (("convert", "--joint"), ("emulate", "--joint"), ("hardware", "--joint"))
"""Options that mean something else."""
BESIDES = {"--controller": ("none", "all"), "--joint": ()}
OPTION = re.compile(r'"(--[a-z][a-z-]*)"')
"""An option as the source of a command declares it."""


def controller_names() -> list[str]:
    """Return the names of the controllers there are, without importing them."""
    files = _folder("baselines").glob("*.py")
    shipped = [f.stem for f in files if "\nROW = " in f.read_text(encoding="utf-8")]
    return sorted(shipped) + installed("controllers")


def part_names() -> list[str]:
    """Return the names of the parts that controllers are made of, without importing them."""
    text = (_folder("baselines") / "parts.py").read_text(encoding="utf-8")
    return re.findall(r'Part\(\s*"(\w+)"', text)


def joint_names() -> list[str]:
    """Return the names of the joints that ship."""
    return sorted(file.stem for file in _folder("params").glob("*.toml"))


def option_names(command: str) -> list[str]:
    """Return the options that a command may have, from its source, without importing it."""
    files = [_folder("commands") / f"{command.replace('-', '_')}.py"]
    files += _folder("console").glob("*.py")
    texts = (file.read_text(encoding="utf-8") for file in files)
    return sorted({"--help", "--json"}.union(*map(OPTION.findall, texts)))


def check_options(command: str, words: Sequence[str]) -> None:
    """Refuse options that a command does not have.

    Options of other commands that share a source may pass; the parser refuses these later.

    Args:
        command: The command.
        words: What follows it.

    Raises:
        UnknownNameError: It has no option of that name; the message suggests the nearest.
    """
    known = option_names(command)
    for word in words:
        if word == "--":
            return
        name = word.partition("=")[0]
        if name.startswith("--") and not any(option.startswith(name) for option in known):
            suggestion = did_you_mean(name, known)
            raise UnknownNameError(
                f"Unknown option {name} of {command}.{suggestion} See cjt-gym {command} --help."
            )


def _folder(package: str) -> Path:
    """Return the folder of a subpackage, without importing it."""
    spec = find_spec(f"cjt_gym.{package}")
    assert spec is not None
    assert spec.origin is not None
    return Path(spec.origin).parent


def installed(kind: str) -> list[str]:
    """Return the names of the rows that other packages bring along, without importing them."""
    return [point.name for point in metadata.entry_points(group=f"cjt_gym.{kind}")]


def check_words(command: str, words: Sequence[str]) -> None:
    """Refuse words of a command line that name a controller or a joint that there is not."""
    known: dict[str, Callable[[], list[str]]] = {
        "--controller": lambda: sorted({*controller_names(), *part_names()}),
        "--joint": joint_names,
    }
    for option, names in known.items():
        if (command, option) in OTHERWISE:
            continue
        for word in _values(words, option, FIRST.get(command) == option):
            if OWN.search(word) or word in BESIDES[option] or word in names():
                continue
            raise unknown_name(option.lstrip("-"), word, names())


def _values(words: Sequence[str], option: str, inside: bool) -> Iterator[str]:
    """Give the values of an option; `inside` says whether the words begin with one."""
    for word in words:
        if word.startswith("-"):
            inside = word == option
            if word.startswith(f"{option}="):
                yield word.partition("=")[2]
        elif inside:
            yield word
