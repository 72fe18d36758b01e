"""`cjt-gym policies`: the policies that ship, and the card of one."""

from __future__ import annotations

import argparse
import textwrap
from dataclasses import asdict

from cjt_gym.console import Answer
from cjt_gym.training.deploy.shipped import Card, policy_card, policy_names

WIDTH = 96


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add whose card to show."""
    text = "policy to describe in full; default: one line for each"
    parser.add_argument("name", nargs="?", metavar="NAME", help=text)


def run(options: argparse.Namespace) -> Answer:
    """List the policies, or show one."""
    names = policy_names() if options.name is None else [options.name]
    cards = [policy_card(name) for name in names]
    text = _told(cards[0]) if cards else ""
    if options.name is None:
        width = max(map(len, names), default=0)
        lines = [f"{card.name:<{width}}  {card.summary}" for card in cards]
        lines.append(
            "Use one by name:  cjt-gym benchmark --policy NAME  or  cjt-gym hardware --policy NAME"
        )
        text = "\n".join(lines)
    return [asdict(card) for card in cards], text


def _told(card: Card) -> str:
    lines = [f"{card.name}: {card.summary}"]
    for name in ("trained_on", "tested_on", "fails"):
        lines += ["", f"{name.replace('_', ' ')}:"]
        lines += textwrap.wrap(
            getattr(card, name), WIDTH, initial_indent="  ", subsequent_indent="  "
        )
    return "\n".join(lines) + "\n"
