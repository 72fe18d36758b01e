"""The demonstration, shortened: it runs, and its page stands alone."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from cjt_gym.training.demo.__main__ import main


@pytest.mark.slow
def test_the_demonstration_writes_a_page_that_stands_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["--out", str(tmp_path / "demo"), "--steps", "4096", "--episodes", "2"]
    assert main(arguments) == 0
    printed, said = capsys.readouterr()
    assert "\r" not in said, "a progress bar belongs on a terminal"
    assert (printed + said).count("5.84800") == 1
    assert re.search(r"report\.html written after \d+ s\n$", printed)
    for word in ("5.84800", "open_loop", "pd_feedforward", "residual_policy", "report.html"):
        assert word in printed
    page = (tmp_path / "demo" / "report.html").read_text(encoding="utf-8")
    assert page.count("<svg") == page.count("</svg>") == 4
    assert not re.search(r"(src|href)=[\"']?(https?:|file:|/)", page)
    assert page.count("<table") == 3
    metrics = json.loads((tmp_path / "demo" / "metrics.json").read_text(encoding="utf-8"))
    assert len(metrics["benchmark"]) == 12
    assert set(metrics["emps"]["errors"]) == {"force", "velocity", "position"}
    assert set(metrics["validation"]) == {"open_loop", "pd_feedforward"}


def test_bad_input_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--out", str(tmp_path), "--config", "nowhere"]) == 2
    assert "does not exist" in capsys.readouterr().err
