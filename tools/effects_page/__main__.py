"""Command line of the page of effects."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from tools.effects_page.figures import PLOTS
from tools.effects_page.page import FIGURES, PAGE, differences, unmatched, write_page
from tools.effects_page.style import save


def main(words: list[str] | None = None) -> int:
    """Write or check the page; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m tools.effects_page", description=__doc__)
    parser.add_argument("effects", nargs="*", metavar="EFFECT", help="figures to draw; all if none")
    parser.add_argument("--check", action="store_true", help="draw nothing; fail if it differs")
    parser.add_argument("--png", type=Path, help="folder for copies of the figures as PNG")
    options = parser.parse_args(words)
    if options.check:
        wrong = differences()
        for line in wrong:
            print(line, file=sys.stderr)
        return 1 if wrong else 0
    if unmatched():
        parser.error(" ".join(unmatched()))
    for name in options.effects or PLOTS:
        if name not in PLOTS:
            parser.error(f"there is no figure of {name}; there are {', '.join(PLOTS)}")
        path = save(PLOTS[name].draw(), FIGURES / name, options.png)
        print(f"{path.name:32s} {path.stat().st_size / 1000:6.1f} kB", flush=True)
    write_page()
    print(PAGE)
    return 0


if __name__ == "__main__":
    sys.exit(main())
