"""Writes the drawing and the table of docs/architecture.md: `python -m tools.architecture_page`.

The order of the rooms is that of the layers which `make lint` holds.
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

from tools.link_tree import ROOT, mapped_folders

PAGE = ROOT / "docs" / "architecture.md"
DRAWING = ROOT / "docs" / "figures" / "rooms.svg"
TABLE = re.compile(r"(<!-- rooms -->\n).*?(\n<!-- end -->)", re.DOTALL)
TEXTS = {
    "cli": "the command `cjt-gym`",
    "commands": "one file per command",
    "hardware": "runs on joints on a bus: one or several, and their figures",
    "console": "what commands share: options, signs of life, tables",
    "training": "learning, tuning, evaluation, benchmark, deployment, GPU, demo",
    "envs": "Gymnasium environments: single, batched, hardware, robots",
    "gap": "the diagnosis",
    "export": "joints for MuJoCo and Isaac Lab, controllers in C",
    "datasheet": "data sheets as PDF and HTML",
    "baselines": "controllers and observers, one file each",
    "analysis": "linear loops, margins, passivity, identification",
    "characteristics": "what a joint's parameters allow",
    "symbolic": "the joint in symbols",
    "robots": "joints as actuators of MuJoCo models",
    "canbus": "joints on a CAN bus: protocols, plant, safety, emulator",
    "plant": "simulated joints behind the contract of a plant; randomisation",
    "signals": "references and disturbances",
    "joint": "parameters, structures, effect table, kernel, linear models",
    "blind": "a second simulator, which tests the diagnosis",
    "records": "time series, their files and their repair",
    "params": "joints that ship, as data",
    "plugins": "rows that other packages bring along",
    "disk": "files, read without trust and written whole",
    "errors": "one tree of errors",
}
STEP = {"envs": "1 3 5", "baselines": "2", "joint": "4"}
LOG = {"commands": "1 6", "records": "2", "gap": "3 4 5", "joint": "4"}
"""Where the two walks pass, by the numbers of their steps on the page."""
WIDTH, HEIGHT, GAP, EDGE = 760, 44, 8, 10
STYLE = "text{font:14px sans-serif;fill:#222}.s{font-size:12px;fill:#666}"


def rooms() -> list[tuple[str, ...]]:
    """Return the rooms of each layer, the highest first."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    layers = project["tool"]["importlinter"]["contracts"][0]["layers"]
    return [tuple(re.findall(r"\w+", layer)) for layer in layers]


def folder_of(room: str) -> Path:
    """Return where a room lies."""
    path = ROOT / mapped_folders().get(room, f"cjt_gym/{room}")
    return path if path.is_dir() else path.with_suffix(".py")


def size_of(room: str) -> tuple[int, int]:
    """Return how many Python files a room has, and how many lines."""
    folder = folder_of(room)
    files = [folder] if folder.is_file() else list(folder.rglob("*.py"))
    return len(files), sum(len(path.read_text("utf-8").splitlines()) for path in files)


def drawing() -> str:
    """Return the rooms as layers, with the numbers of the walks, as SVG."""
    parts, y = [], EDGE
    for layer in rooms():
        width = (WIDTH - 2 * EDGE + GAP) / len(layer) - GAP
        for k, room in enumerate(layer):
            parts += _box(room, EDGE + k * (width + GAP), y, width)
        y += HEIGHT + GAP
    size = f'viewBox="0 0 {WIDTH} {y}" width="{WIDTH}" height="{y}"'
    body = "\n".join(parts)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" {size}>\n<style>{STYLE}</style>\n{body}\n</svg>\n'
    )


def _box(room: str, x: float, y: float, width: float) -> list[str]:
    lines = round(size_of(room)[1], -2)
    parts = [
        f'<rect x="{x:.1f}" y="{y}" width="{width:.1f}" height="{HEIGHT}" rx="4" '
        'fill="#f6f6f4" stroke="#999"/>',
        f'<text x="{x + 8:.1f}" y="{y + 18}">{room}</text>',
        f'<text class="s" x="{x + 8:.1f}" y="{y + 35}">{lines or "under 50"}</text>',
    ]
    at = x + width - 12
    for walk, colour in ((LOG, "#1f6fb4"), (STEP, "#d9541e")):
        for number in reversed(walk.get(room, "").split()):
            parts += [
                f'<circle cx="{at:.1f}" cy="{y + 14}" r="9" fill="{colour}"/>',
                f'<text x="{at:.1f}" y="{y + 19}" text-anchor="middle" '
                f'style="fill:#fff">{number}</text>',
            ]
            at -= 21
    return parts


def table() -> str:
    """Return the table of the rooms."""
    lines = ["| room | what it holds | files | lines |", "|---|---|---:|---:|"]
    for room in (room for layer in rooms() for room in layer):
        files, count = size_of(room)
        path = folder_of(room).relative_to(ROOT).as_posix()
        lines.append(f"| `{path}` | {TEXTS[room]} | {files} | {count} |")
    return "\n".join(lines)


if __name__ == "__main__":
    DRAWING.write_text(drawing(), "utf-8")
    PAGE.write_text(TABLE.sub(rf"\g<1>{table()}\g<2>", PAGE.read_text("utf-8")), "utf-8")
