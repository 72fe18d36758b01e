"""The pictures of the tutorials on benchmark and hardware: what their commands draw.

python tools/tutorial_pictures.py   runs the commands and writes docs/figures
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import sys
import tempfile
from pathlib import Path

from cjt_gym.cli import main as cjt_gym

ROOT = Path(__file__).resolve().parent.parent
FIGURES = ROOT / "docs" / "figures"
REPORT = ("benchmark_map", "benchmark_traces")
"""The first pictures of a benchmark's report."""
PLOTS = {"real.png": "hardware.png", "compared.png": "hardware_policy.png"}


def commands(page: str, *needed: str) -> list[list[str]]:
    """Return the commands of a tutorial whose --out is one of those needed, as words."""
    text = (ROOT / "docs" / "tutorials" / f"{page}.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```sh\n(.*?)```", text, re.DOTALL)
    lines = [shlex.split(line)[1:] for block in blocks for line in block.splitlines()]
    return [words for words in lines if words[-2] == "--out" and words[-1] in needed]


def main() -> int:
    """Run the commands in a folder of their own, and keep their pictures."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "examples").symlink_to(ROOT / "examples")
        os.chdir(folder)
        wanted = commands("benchmark", "compared")
        wanted += commands("hardware", "real.csv", "policy.csv", *PLOTS)
        for words in wanted:
            if cjt_gym(words) != 0:
                return 1
        report = Path("compared/report.html").read_text(encoding="utf-8")
        drawn = re.findall(r"<svg.*?</svg>", report, re.DOTALL)
        for name, svg in zip(REPORT, drawn, strict=False):
            (FIGURES / f"{name}.svg").write_text(svg, encoding="utf-8")
        for plot, name in PLOTS.items():
            shutil.copyfile(plot, FIGURES / name)
    return 0


if __name__ == "__main__":
    sys.exit(main())
