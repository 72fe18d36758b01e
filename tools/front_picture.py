"""The picture of the start page: what its example finds.

python tools/front_picture.py   runs the example of docs/index.md and writes docs/figures/first.svg
"""

from __future__ import annotations

import re
import sys
import tempfile
from pathlib import Path
from typing import Any

from cjt_gym.datasheet.drawing import INK, canvas
from cjt_gym.joint import load_joint, to_toml
from cjt_gym.training.report.figures import COLOURS, WIDTH

DOCS = Path(__file__).resolve().parent.parent / "docs"
PICTURE = DOCS / "figures" / "first.svg"
SHOWN = (2.0, 3.2)


def main() -> int:
    """Run the example and draw its record, its datasheet and the joint that it found."""
    (code,) = re.findall(r"```python\n(.*?)```", (DOCS / "index.md").read_text("utf-8"), re.S)
    given: dict[str, Any] = {}
    exec(compile(code, "index.md", "exec"), given)
    t, torque, structure = given["t"], given["torque"], given["structure"]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "joint.toml")
        path.write_text(to_toml(given["diagnosis"].joint), encoding="utf-8")
        joints = {
            "simulated, datasheet": load_joint("orange_80_6000", structure, effects=[]),
            "simulated, with the friction that was found": load_joint(path, structure),
        }
    rows = (t >= SHOWN[0]) & (t <= SHOWN[1])
    with canvas(WIDTH, 2.7) as (figure, written):
        axes = figure.subplots()
        axes.plot(t[rows], given["record"]["tau"][rows], color=INK, linewidth=2.4, label="recorded")
        for (name, joint), colour in zip(joints.items(), COLOURS[1:], strict=False):
            simulated = joint.simulate(torque)["true_tau"]
            axes.plot(t[rows], simulated[rows], color=colour, linewidth=1.1, label=name)
        axes.set(xlabel="time [s]", ylabel="joint torque [N m]", xlim=SHOWN)
        figure.legend(loc="outside upper left", ncols=3)
        PICTURE.write_text(written(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
