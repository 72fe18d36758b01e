"""Parameter files of the MATLAB toolbox: numbers are read, nothing is run."""

from __future__ import annotations

from pathlib import Path

import pytest

from cjt_gym.cli import main
from cjt_gym.errors import ParameterError
from cjt_gym.joint import load_joint, load_joint_file

ALGORITHM = """% deviations from the defaults
function params = mine
params = struct();
params.('I_m') = 9.407000e-02; % rotor
params.d_cm = 2.6400;
d_g = 2.2000
params.('d_g_n') = 2.1000;
params.x = 2e-4;
params.Ts = 1e-3;
end
"""


@pytest.fixture
def script(tmp_path: Path) -> Path:
    path = tmp_path / "mine.m"
    path.write_text(ALGORITHM, encoding="utf-8")
    return path


def test_numbers_come_with_their_lines(script: Path) -> None:
    file = load_joint_file(script)
    p = file.parameters
    assert (p.name, p.I_m, p.d_cm, p.d_g, p.d_g_n, p.l_a) == ("mine", 0.09407, 2.64, 2.2, 2.1, 2e-4)
    assert p.quantities["I_m"].source == "mine.m, line 4"
    assert "d_cm_n" not in p
    assert file.sampling["dt"].value == 1e-3


def test_the_rest_may_come_from_the_toolboxs_defaults(script: Path) -> None:
    out = script.with_suffix(".toml")
    words = ["convert", str(script), "--out", str(out), "--defaults", "generic"]
    assert main(words) == 0
    p = load_joint(out, "rigid", effects=["coulomb_asym"]).parameters
    assert (p.I_m, p.d_cm_n, p.d_g_n, p.I_g, p.k_t) == (0.09407, 2.64, 2.1, 0.263, 0.0453)
    assert p.quantities["I_g"].source == "toolbox class default"


@pytest.mark.parametrize("option", ["--bus", "--joint", "--mapping"])
def test_what_is_for_logs_is_refused_for_a_joint(
    option: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    script = tmp_path / "mine.m"
    script.write_text("params.n = 80;\n")
    words = ["convert", str(script), "--defaults", "generic", "--out", str(tmp_path / "x.toml")]
    assert main([*words, option, "something"]) == 2
    assert f"{option} is for a log" in capsys.readouterr().err
    assert not (tmp_path / "x.toml").exists()


def test_ripple_becomes_effects_by_its_type(script: Path) -> None:
    ripple = (
        "rip_types = [1 2, 1];\nrip_f = [1 2 3];\nrip_a1 = [0.1 0.2 0.3];\nrip_a2 = [0 -1 0];\n"
    )
    script.write_text(ALGORITHM + ripple, encoding="utf-8")
    effects = load_joint_file(script).effects
    assert effects["cogging"]["f"].value == (1.0, 3.0)  # type: ignore[union-attr]
    assert effects["gear_ripple"]["b"].value == (-1.0,)  # type: ignore[union-attr]


def test_a_file_without_a_number_is_refused(script: Path) -> None:
    script.write_text("% to be done\n", encoding="utf-8")
    with pytest.raises(ParameterError, match="mine.m assigns no number"):
        load_joint_file(script)


def test_what_is_no_number_is_refused_and_not_run(script: Path) -> None:
    lines = "params.k_b = 2*pi;\nsystem('touch gone');\nparams.kb = 3;\nparams.r = -1;\n"
    script.write_text(ALGORITHM + lines, encoding="utf-8")
    with pytest.raises(ParameterError) as caught:
        load_joint_file(script)
    assert len(caught.value.mistakes) == 4
    for part in ("Line 11 of", "'params.k_b = 2*pi;'", "Line 12 of", "'kb'", "'k_b'?", "r of"):
        assert part in str(caught.value)
