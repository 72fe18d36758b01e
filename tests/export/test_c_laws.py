"""Controllers and observers in C do what they do in Python, to 1e-12."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cjt_gym import load_joint
from cjt_gym.baselines import CONTROLLERS, default_gains, make_controller
from cjt_gym.baselines.linear_law import LinearController
from cjt_gym.baselines.observers import OBSERVERS, kalman_filter, make_observer
from cjt_gym.baselines.plant_model import SampledJoint
from cjt_gym.cli import main
from cjt_gym.errors import ConfigurationError, UnknownNameError
from cjt_gym.export import c_files
from cjt_gym.export.c_files import (
    ExportError,
    check_controller,
    compiled,
    compiler,
    controller_to_c,
    observer_to_c,
)
from cjt_gym.export.c_law import law_of
from cjt_gym.joint import Joint

DT = 1e-3
FIXED, FREE = "output_fixed_rigid_gearbox", "full_dynamics"
NOT_IN_C = {"mpc", "ripple_learning", "iterative_learning"}
PARTS = ["pid+reference+friction+momentum_dob", "pi+friction+reference+inner_dob", "position_pd+p"]
needs_compiler = pytest.mark.skipif(compiler() is None, reason="there is no C compiler")


def a_joint(structure: str = FIXED) -> Joint:
    effects = {"coulomb": {}, "command_delay": {"delay": 2e-3}, "noise": {}}
    load = {} if structure == FIXED else {"I_l": 3.0}
    return load_joint("orange_80_6000", structure, effects=effects, parameters=load)


@needs_compiler
@pytest.mark.parametrize(
    ("name", "structure"),
    [(name, FIXED) for name in [*sorted(set(CONTROLLERS) - NOT_IN_C), *PARTS]]
    + [(name, FREE) for name in ("pd_feedforward", "impedance", "friction+pd+reference")],
)
def test_controllers_do_in_c_what_they_do_in_python(name: str, structure: str) -> None:
    """In a closed loop, beyond the limit and back, and again after a reset."""
    joint = a_joint(structure)
    law = make_controller(name, joint, DT)
    law.torque_limit = 60.0
    made = controller_to_c(law, joint, name)
    assert made.checked.steps == 1000
    assert made.checked.error <= 1e-12


@needs_compiler
@pytest.mark.parametrize("structure", [FIXED, FREE])
@pytest.mark.parametrize("name", OBSERVERS)
def test_observers_do_in_c_what_they_do_in_python(name: str, structure: str) -> None:
    row = OBSERVERS[name]
    gains = {gain.name: 25.0 if gain.unit == "Hz" else 0.1 for gain in row.tunable}
    outputs = ("dq_m",) if row.chosen else None
    outputs = outputs if structure == FREE or outputs is None else ("q_m",)
    model = SampledJoint(a_joint(structure), DT)
    if (structure, name) == (FREE, "extended_state"):
        with pytest.raises(ConfigurationError, match="not observable"):
            make_observer(name, model, gains, outputs)
        return
    observer = make_observer(name, model, gains, outputs)
    made = observer_to_c(observer, a_joint(structure), name)
    assert made.checked.steps == 600
    assert made.checked.error <= 1e-12


@needs_compiler
def test_a_header_that_does_otherwise_is_found_out() -> None:
    joint = a_joint()
    law = make_controller("pid+reference+friction", joint, DT)
    assert isinstance(law, LinearController)
    text = controller_to_c(law, joint, "law").text
    wrong = replace(law, law=replace(law.law, g=2.0 * law.law.g))
    for other in (wrong, make_controller("pid+reference", joint, DT)):
        with pytest.raises(ExportError, match="differs from Python by"):
            check_controller(other, joint, text)


@needs_compiler
def test_the_motion_of_the_check_reaches_the_limit_and_leaves_it() -> None:
    wanted = c_files.wanted_torque(60.0)
    beyond = np.abs(wanted) > 60.0
    assert beyond.any()
    assert not beyond.all()


LANGUAGES = [["-std=c99", "-pedantic"]] + [["-x", "c++", "-std=c++17"]] * bool(shutil.which("c++"))


@needs_compiler
@pytest.mark.parametrize("language", LANGUAGES)
def test_several_headers_go_together_and_in_other_types(
    language: list[str], tmp_path: Path
) -> None:
    joint = a_joint()
    for name in ("pd_feedforward", "lqg"):
        law = make_controller(name, joint, DT)
        (tmp_path / f"{name}.h").write_text(controller_to_c(law, joint, name).text)
    momentum = make_observer("momentum", SampledJoint(joint, DT), {"bandwidth_hz": 30.0})
    (tmp_path / "seen.h").write_text(observer_to_c(momentum, joint, "momentum", "seen").text)
    (tmp_path / "all.c").write_text(
        "#define SEEN_REAL float\n#define LQG_REAL float\n"
        '#include "pd_feedforward.h"\n#include "lqg.h"\n#include "seen.h"\n'
        "int all(void);\nint all(void) {\n"
        "  pd_feedforward_state a; lqg_state b; seen_state c; float found[seen_ESTIMATES];\n"
        "  pd_feedforward_reset(&a); lqg_reset(&b); seen_reset(&c);\n"
        "  seen_step(&c, 0, 1, 0, 0, 0, 0, 0, 0, found);\n"
        "  return found[SEEN_DISTURBANCE] + pd_feedforward_step(&a, 1, 1, 0, 0, 0, 0, 0, 0)\n"
        "    > lqg_step(&b, 1, 1, 0, 0, 0, 0, 0, 0);\n}\n"
    )
    words = [str(compiler()), *language, "-Wall", "-Wextra", "-Werror", "-c", "all.c"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_nothing_is_allocated_and_nothing_is_shared() -> None:
    joint = a_joint()
    for name in ("lqg", "impedance", "friction_feedforward"):
        text = controller_to_c(make_controller(name, joint, DT), joint, name).text
        assert not re.search(r"\b(malloc|calloc|free|static (?!const|inline))\b", text)
        assert f"{name}_state" in text
        assert "@" not in text


@pytest.mark.parametrize("name", sorted(NOT_IN_C))
def test_what_cannot_be_written_in_c_is_refused(name: str) -> None:
    joint = a_joint()
    gains = {gain.name: gain.low for gain in CONTROLLERS[name].tunable}
    law = make_controller(
        name, joint, DT, default_gains(name, joint, DT) if name != "mpc" else gains
    )
    with pytest.raises(ConfigurationError, match=f"{name} cannot be written in C: it learns"):
        law_of(law, name)


def test_numbers_of_observers_are_asked_for() -> None:
    model = SampledJoint(a_joint(), DT)
    with pytest.raises(ConfigurationError, match=r"kalman needs torque_noise \[N m\]"):
        make_observer("kalman", model, {"drift": 0.1})
    with pytest.raises(UnknownNameError, match="Did you mean 'kalman'"):
        make_observer("kalmann", model, {})
    with pytest.raises(UnknownNameError, match="Unknown gain of observer momentum"):
        make_observer("momentum", model, {"hz": 1.0})
    with pytest.raises(ConfigurationError, match="takes one measured signal, got tau, q_m"):
        make_observer("disturbance", model, {"bandwidth_hz": 9.0}, ("tau", "q_m"))
    with pytest.raises(ConfigurationError, match="must be finite and > 0 s, got 0"):
        SampledJoint(a_joint(), 0.0)


def test_a_disturbance_is_estimated_only_where_it_is_asked_for() -> None:
    model = SampledJoint(a_joint(), DT)
    states = kalman_filter(model, torque_noise=0.1).names
    assert make_observer("kalman", model, {"torque_noise": 0.1}).names == states
    assert "disturbance" not in states
    hz = {"bandwidth_hz": 30.0}
    assert "disturbance" in make_observer("luenberger", model, hz).names
    without = make_observer("luenberger", model, hz | {"disturbance": 0.0}, ("dq_m",))
    assert "disturbance" not in without.names


def test_without_a_compiler_it_is_written_and_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    made = controller_to_c(make_controller("pd", a_joint(), DT), a_joint(), "pd")
    assert made.checked.steps == 0
    assert "There is no C compiler" in made.checked.note
    assert "pd_step" in made.text
    with pytest.raises(ConfigurationError, match="There is no C compiler"):
        compiled("", {})


def test_the_command_writes_controllers_gain_files_and_observers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    gains = tmp_path / "mine.toml"
    gains.write_text('controller = "p+reference"\n[gains.kp]\nvalue = 0.2\nunit = "-"\n')
    for source, more in (
        ("pd+reference+friction", ["--gain", "kp=0.3"]),
        (str(gains), []),
        ("kalman", ["--gain", "torque_noise=0.1", "drift=0.1", "--output", "q_m", "dq_l"]),
    ):
        out = tmp_path / "my law.h"
        words = ["export", source, "--to", "c", "--joint", "orange_80_6000", "--out", str(out)]
        assert main([*words, *more, "--json"]) == 0
        told = json.loads(capsys.readouterr().out)
        assert told["error"] is None or told["error"] <= 1e-12
        assert "my_law_step(my_law_state *state" in out.read_text(encoding="utf-8")
    for source, text in (("mpc", "cannot be written in C"), ("pd", "--output is for observers")):
        words = ["export", source, "--to", "c", "--joint", "orange_80_6000", "--output", "tau"]
        given = words if source == "pd" else words[:-2]
        assert main([*given, "--out", str(tmp_path / "no.h")]) == 2
        assert text in capsys.readouterr().err
    assert main(["export", "pd", "--to", "c", "--out", str(tmp_path / "no.h")]) == 2
    assert "--joint must name the joint" in capsys.readouterr().err
