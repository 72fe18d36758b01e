"""Command line of the page of effects."""

from __future__ import annotations

import argparse
import sys

from tools.effects_page.figures import PLOTS
from tools.effects_page.page import FIGURES, PAGE, page_text
from tools.effects_page.style import save
from tools.written import write_or_check


def main(words: list[str] | None = None) -> int:
    """Write or check the page; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m tools.effects_page", description=__doc__)
    parser.add_argument("effects", nargs="*", metavar="EFFECT", help="figures to draw; all if none")
    parser.add_argument("--check", action="store_true", help="draw nothing; fail if it differs")
    options = parser.parse_args(words)
    for name in () if options.check else options.effects or PLOTS:
        if name not in PLOTS:
            parser.error(f"there is no figure of {name}; there are {', '.join(PLOTS)}")
        path = save(PLOTS[name].draw(), FIGURES / f"{name}.svg")
        print(f"{path.name:32s} {path.stat().st_size / 1000:6.1f} kB", flush=True)
    return write_or_check("tools.effects_page", PAGE, page_text(), ["--check"] * options.check)


if __name__ == "__main__":
    sys.exit(main())
