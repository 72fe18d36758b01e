"""A headless browser that looks at a page: what it drew, what overflows, what went wrong."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from collections.abc import Sequence
from html import escape, unescape
from pathlib import Path
from typing import Any

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
CATCH = "<script>seen=[];addEventListener('error',(e)=>seen.push(e.message))</script>"
PROBE = """<script>
addEventListener("load", () => {
  const all = (query) => [...document.querySelectorAll(query)];
  const boxes = (query) => all(query).map((e) => e.getBoundingClientRect()).map((b) => [b.width, b.height]);
  const texts = all("body *").filter((e) => !e.closest("script")
    && [...e.childNodes].some((n) => n.nodeType === 3 && n.textContent.trim()));
  const outside = (element) => {
    const range = document.createRange();
    range.selectNodeContents(element);
    return [...range.getClientRects()].some((b) => b.right > innerWidth + 1 || b.left < -1);
  };
  const meet = (a, b) => a.left < b.right - 1 && b.left < a.right - 1 && a.top < b.bottom - 1 && b.top < a.bottom - 1;
  const clashes = (svg) => [...svg.querySelectorAll("text")].flatMap((a, k, texts) => texts.slice(k + 1)
    .filter((b) => meet(a.getBoundingClientRect(), b.getBoundingClientRect()))
    .map((b) => `${a.textContent} / ${b.textContent}`));
  parent.postMessage({
    width: innerWidth,
    scroll: document.documentElement.scrollWidth,
    errors: seen,
    overflow: texts.filter(outside).map((e) => e.textContent.trim().slice(0, 60)),
    plots: boxes("figure svg"),
    curves: all(".chart path[clip-path]:not([style*='--faint'])").map((p) => p.getBBox()).map((b) => [b.width, b.height]),
    letters: all("svg text").map((e) => parseFloat(getComputedStyle(e).fontSize) * Math.hypot(e.getScreenCTM().a, e.getScreenCTM().b)),
    clashes: all("svg").flatMap(clashes),
    columns: boxes(".strip .columns"),
  }, "*");
});
</script>"""  # noqa: E501
FRAMES = """<!doctype html><pre id=probe></pre><script>
const views = {};
addEventListener("message", (event) => {
  views[event.data.width] = event.data;
  document.getElementById("probe").textContent = JSON.stringify(views);
});
</script>"""


def browser() -> str:
    """Return the path of a browser; the test is skipped where there is none."""
    found = next((path for name in NAMES if (path := shutil.which(name))), None)
    if found is None:
        pytest.skip("no chromium on this machine: the report cannot be looked at")
    return found


def look(page: Path, widths: Sequence[int], folder: Path) -> dict[str, Any]:
    """Return what a page looks like at some widths [px]: errors, boxes, overflowing texts.

    The page is shown in one frame per width, for a window of its own may not be that narrow.
    """
    text = page.read_text(encoding="utf-8")
    text = text.replace("<head>", f"<head>{CATCH}").replace("</body>", f"{PROBE}</body>")
    frames = "".join(
        f'<iframe style="border:0;width:{width}px;height:4000px" srcdoc="{escape(text)}"></iframe>'
        for width in widths
    )
    framed = folder / "framed.html"
    framed.write_text(FRAMES + frames, encoding="utf-8")
    flags = ("--headless=new", "--no-sandbox", "--disable-gpu")
    command = [browser(), *flags, "--dump-dom", "--enable-logging=stderr", framed.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    match = re.search(r'<pre id="probe">(.*?)</pre>', done.stdout, re.DOTALL)
    assert match is not None, done.stderr[-2000:]
    return {
        "views": json.loads(unescape(match.group(1))),
        "console": [line for line in done.stderr.splitlines() if "CONSOLE" in line],
    }
