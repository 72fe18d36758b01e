"""The drawing of the three masses, their springs and their friction, with every symbol in place.

python -m tools.joint_drawing           writes docs/figures/joint.svg
python -m tools.joint_drawing --check   says whether it is what this draws
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from tools.written import write_or_check

DRAWING = Path(__file__).resolve().parents[1] / "docs" / "figures" / "joint.svg"
WIDTH, HEIGHT = 900, 330
MIDDLE, GROUND = 130, 272
BOX_WIDTH, BOX_HEIGHT = 110, 84
BODIES = (
    ("motor", 250, "I_m", "q_m", ("d_m", "d_cm")),
    ("gear", 480, "I_g", "q_g", ("d_g", "d_cg")),
    ("load", 710, "I_l", "q_l", ("d_l", "d_cl")),
)
LINKS = (("gearbox", "k_g", "d_mg"), ("torsion bar", "k_b", "d_gl"))
STYLE = """
  text { font: 15px sans-serif; text-anchor: middle; fill: #222 }
  .name { font-size: 13px; fill: #666 }
  .symbol { font-style: italic }
  .line { stroke: #222; stroke-width: 1.6; fill: none }
  .body { stroke: #222; stroke-width: 1.6; fill: #fbe3d8 }
  .arrow { stroke: #c2410c; stroke-width: 2; fill: none }
  .head { fill: #c2410c }
"""


def drawing() -> str:
    """Return the drawing as SVG."""
    parts = [_ground()]
    for name, x, inertia, angle, friction in BODIES:
        parts += [_body(name, x, inertia), _angle(x, angle), _friction(x, friction)]
    for left, right, (name, stiffness, damping) in zip(BODIES, BODIES[1:], LINKS, strict=False):
        begin, end = left[1] + BOX_WIDTH / 2, right[1] - BOX_WIDTH / 2
        parts += [_spring(begin, end, stiffness), _damper(begin, end, damping)]
        parts.append(_text((begin + end) / 2, MIDDLE - 62, name, "name"))
    bar = (BODIES[1][1] + BODIES[2][1]) / 2
    parts.append(_text(bar, MIDDLE + 78, "\u03c4, the joint torque", "name"))
    parts += [_drive(), _load_torque()]
    body = "\n".join(parts)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" role="img">\n'
        f"<title>Motor, gear and load between gearbox and torsion bar</title>\n"
        f"<style>{STYLE}</style>\n"
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#fff"/>\n{body}\n</svg>\n'
    )


def _symbols(text: str) -> str:
    """Return words with the indices of symbols set low."""
    parts, low = [], False
    for word in text.split():
        base, _, index = word.partition("_")
        rise = ' dy="-4"' if low else ""
        parts.append(f"<tspan{rise}>{base}</tspan>")
        if index:
            parts[-1] += f'<tspan dy="4" font-size="11">{index}</tspan>'
        low = bool(index)
    return " ".join(parts)


def _text(x: float, y: float, text: str, kind: str = "symbol") -> str:
    shown = _symbols(text) if kind == "symbol" else text
    return f'<text x="{x:g}" y="{y:g}" class="{kind}">{shown}</text>'


def _path(points: Sequence[tuple[float, float]], kind: str = "line") -> str:
    steps = " L ".join(f"{x:g} {y:g}" for x, y in points)
    return f'<path class="{kind}" d="M {steps}"/>'


def _arrow(x: float, y: float, length: float) -> str:
    tip = f"{x + length:g},{y:g} {x + length - 9:g},{y - 5:g} {x + length - 9:g},{y + 5:g}"
    shaft = _path([(x, y), (x + length - 8, y)], "arrow")
    return f'{shaft}\n<polygon class="head" points="{tip}"/>'


def _body(name: str, x: float, inertia: str) -> str:
    left, top = x - BOX_WIDTH / 2, MIDDLE - BOX_HEIGHT / 2
    box = f'<rect class="body" x="{left:g}" y="{top:g}" width="{BOX_WIDTH}" height="{BOX_HEIGHT}"/>'
    return "\n".join([box, _text(x, MIDDLE - 4, name, "name"), _text(x, MIDDLE + 20, inertia)])


def _angle(x: float, angle: str) -> str:
    top = MIDDLE - BOX_HEIGHT / 2 - 24
    return "\n".join([_arrow(x - 24, top, 48), _text(x, top - 10, angle)])


def _friction(x: float, symbols: Sequence[str]) -> str:
    """Draw a damper between a body and the ground."""
    top = MIDDLE + BOX_HEIGHT / 2
    cup = [(x - 12, 222), (x - 12, 246), (x + 12, 246), (x + 12, 222)]
    lines = [
        _path([(x, top), (x, 234)]),
        _path([(x - 9, 234), (x + 9, 234)]),
        _path(cup),
        _path([(x, 246), (x, GROUND)]),
        _text(x - 34, 236, symbols[0]),
        _text(x + 36, 236, symbols[1]),
    ]
    return "\n".join(lines)


def _spring(begin: float, end: float, symbol: str) -> str:
    y, coil = MIDDLE - 24, 8
    inner = (end - begin - 40) / (2 * coil)
    points = [(begin, y), (begin + 20, y)]
    points += [(begin + 20 + inner * (k + 0.5), y + (-9, 9)[k % 2]) for k in range(2 * coil)]
    points += [(end - 20, y), (end, y)]
    return "\n".join([_path(points), _text((begin + end) / 2, y - 16, symbol)])


def _damper(begin: float, end: float, symbol: str) -> str:
    y, middle = MIDDLE + 24, (begin + end) / 2
    left, right = middle - 14, middle + 12
    cup = [(right, y - 11), (left, y - 11), (left, y + 11), (right, y + 11)]
    lines = [
        _path([(begin, y), (left, y)]),
        _path(cup),
        _path([(middle, y - 8), (middle, y + 8)]),
        _path([(middle, y), (end, y)]),
        _text(middle, y + 32, symbol),
    ]
    return "\n".join(lines)


def _drive() -> str:
    left = BODIES[0][1] - BOX_WIDTH / 2
    middle = left - 48
    lines = [
        _arrow(left - 92, MIDDLE, 88),
        _text(middle, MIDDLE - 16, "drive", "name"),
        _text(middle, MIDDLE + 26, "\u03c4_m = k_t n i"),
        _text(middle, MIDDLE + 50, "r l_a p v_0 i_p"),
    ]
    return "\n".join(lines)


def _load_torque() -> str:
    right = BODIES[2][1] + BOX_WIDTH / 2
    return "\n".join([_arrow(right + 6, MIDDLE, 66), _text(right + 44, MIDDLE - 14, "\u03c4_l")])


def _ground() -> str:
    begin, end = BODIES[0][1] - 90, BODIES[2][1] + 90
    hatch = [_path([(x, GROUND), (x - 10, GROUND + 12)]) for x in range(begin + 10, end + 1, 18)]
    return "\n".join([_path([(begin, GROUND), (end, GROUND)]), *hatch])


def main(words: Sequence[str] | None = None) -> int:
    """Write the drawing, or check it."""
    return write_or_check("tools.joint_drawing", DRAWING, drawing(), words)


if __name__ == "__main__":
    sys.exit(main())
