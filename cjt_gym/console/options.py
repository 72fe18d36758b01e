"""The options that commands share, and their checks.

A command takes JOINT or --joint, --structure, --drive, --effect and, where episodes are drawn,
--randomize. The joint file gives the defaults; what it leaves out has the usual value.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from typing import Any

from cjt_gym.errors import ConfigurationError, check_range, unknown_name
from cjt_gym.joint import DRIVES, EFFECTS, STRUCTURES, Joint, load_joint, load_joint_file
from cjt_gym.joint.effect_words import effects_in_words, parse_effects
from cjt_gym.plant.randomization import PRESETS

USUAL = "output_fixed_rigid_gearbox"
"""Structure where neither the command nor the joint file says one."""
USUAL_DRIVE = "current"


def add_joint(parser: argparse.ArgumentParser, *, several: bool = False) -> None:
    """Add the joint, as JOINT or --joint; several of them as `joints`."""
    text = "name of a joint, or path of a joint file"
    here: dict[str, Any] = {"metavar": "JOINT", "default": argparse.SUPPRESS}
    if several:
        parser.add_argument("joints", nargs="*", help=f"{text}; one or several", **here)
        parser.add_argument("--joint", nargs="+", dest="joints", metavar="JOINT", help="the same")
    else:
        parser.add_argument("joint", nargs="?", help=text, **here)
        parser.add_argument("--joint", dest="joint", metavar="JOINT", help="the same")


def check_joint(given: Any) -> None:
    """Refuse a command without a joint."""
    if not given:
        raise ConfigurationError("JOINT is needed: the name of a joint, or path of a joint file.")


def add_conditions(
    parser: argparse.ArgumentParser,
    *,
    several: bool = False,
    draws: bool = True,
    effects: str = "those of the joint file",
    structure: str = f"that of the joint file, or {USUAL}",
) -> None:
    """Add --structure, --drive, --effect and, where episodes are drawn, --randomize.

    `effects` and `structure` say in words what they are by default; `several` structures may be
    allowed.
    """
    add = parser.add_argument
    text = f"{', '.join(STRUCTURES)}; default: {structure}"
    add("--structure", metavar="S", help=text, nargs="+" if several else None)
    text = f"{', '.join(DRIVES)}; default: that of the joint file, or {USUAL_DRIVE}"
    add("--drive", metavar="D", help=text)
    text = "exactly these effects, by name, name=typical or name.parameter=value; none for none; "
    add("--effect", nargs="+", metavar="E", help=f"{text}default: {effects} ({', '.join(EFFECTS)})")
    if draws:
        text = f"what varies between episodes: {', '.join(PRESETS)}"
        add("--randomize", "--randomization", metavar="PRESET", help=text)


def effect_words(options: argparse.Namespace) -> list[str] | None:
    """Return what --effect says: None if nothing, an empty list for `none`."""
    words: list[str] | None = options.effect
    return [] if words == ["none"] else words


def asked_effects(options: argparse.Namespace) -> dict[str, Any] | None:
    """Return the effects that --effect asks for, with their values; None if it is not given."""
    return parse_effects(effect_words(options))


def check_randomize(options: argparse.Namespace) -> str | None:
    """Return the preset of --randomize, or None."""
    preset: str | None = options.randomize
    if preset is not None and preset not in PRESETS:
        raise unknown_name("preset of randomization", preset, PRESETS)
    return preset


def structure_of(joint: str, given: str | None) -> str:
    """Return the structure that was asked for, that of the joint file, or the usual one."""
    return given or load_joint_file(joint).structure or USUAL


def structures_of(joint: str, given: Sequence[str] | None) -> list[str]:
    """Return the structures that were asked for, that of the joint file, or the usual one."""
    return list(given) if given else [structure_of(joint, None)]


def drive_of(joint: str, given: str | None) -> str:
    """Return the drive that was asked for, that of the joint file, or the usual one."""
    return given or load_joint_file(joint).drive or USUAL_DRIVE


def chosen_joint(options: argparse.Namespace, name: str, structure: str | None = None) -> Joint:
    """Return a joint as the options have it."""
    asked = structure_of(name, structure or options.structure)
    return load_joint(name, asked, options.drive, asked_effects(options))


def tell_effects(joint: Joint) -> None:
    """Print on standard error which effects are in force, and which others the joint knows."""
    sys.stderr.write(f"{effects_in_words(joint)}\n")


def check_seed(seed: int | None, name: str = "seed") -> None:
    """Raise ConfigurationError if a seed is negative."""
    if seed is not None:
        check_range(f"--{name}", seed, low=0)


def check_time(name: str, value: float | None) -> None:
    """Raise ConfigurationError if a time that was given is not > 0 s."""
    if value is not None:
        check_range(f"--{name}", value, "s", above=0.0)
