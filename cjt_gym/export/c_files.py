"""Controllers and observers as C headers, tried against Python where there is a compiler.

They are tried along a motion of the joint that they are for.
"""

from __future__ import annotations

import ctypes
import math
import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from cjt_gym.baselines import Controller
from cjt_gym.baselines.linear_law import MEASURED
from cjt_gym.baselines.observers import LinearObserver
from cjt_gym.errors import CjtGymError, ConfigurationError
from cjt_gym.export.c_headers import controller_header, observer_header
from cjt_gym.export.c_law import law_of
from cjt_gym.export.c_text import VALUES, parameters
from cjt_gym.joint import Joint
from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.plant import SimulatedPlant, limits_of
from cjt_gym.plant.measurement import Measurement

COMPILERS = ("cc", "gcc", "clang")
# Contracted products would round otherwise than NumPy does.
OPTIONS = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-O2", "-ffp-contract=off", "-fPIC")
TRIED = "law"
STEPS, HOLD, BEYOND = 600, 60, 1.5
"""Control steps, how long a torque is held, and how far it goes beyond the limit."""
TOLERANCE: Final = 1e-12  # relative: sums are in another order
CONTROLLER: Final = f"""\
#include "law.h"
static law_state state;
void reset(void) {{ law_reset(&state); }}
double step(double reference, {parameters("double")}) {{
  return law_step(&state, reference, {VALUES});
}}
"""
OBSERVER: Final = f"""\
#include "law.h"
static law_state state;
void reset(void) {{ law_reset(&state); }}
void step(double command, {parameters("double")}, double *found) {{
  law_step(&state, command, {VALUES}, found);
}}
"""


class ExportError(CjtGymError, RuntimeError):
    """What was written does not do what it was written from."""


@dataclass(frozen=True)
class Checked:
    """How an exported file compares with what it was written from."""

    steps: int  # control steps that were compared; 0 where nothing could be
    # of laws the largest difference, relative to the largest value of each output, or to the
    # largest sum of magnitudes that it is made of [-]; of policies that of the action
    error: float
    note: str = ""  # why nothing was compared, else empty
    # time of a step of a policy that nothing interrupts [us], for C with the call from Python
    microseconds: float = math.nan


@dataclass(frozen=True)
class Header:
    """A header in C, and how it compares with Python."""

    text: str
    checked: Checked


def controller_to_c(
    controller: Controller,
    joint: Joint,
    name: str,
    prefix: str | None = None,
    gains: Mapping[str, float] | None = None,
) -> Header:
    """Return a controller as a C header: its whole loop, with limit and anti-windup.

    Names begin with the prefix, or else its name; the gains are told in a comment.

    Raises:
        ConfigurationError: What it does cannot be written in C.
        ExportError: The header does otherwise than the controller.
    """
    law, told = law_of(controller, name), _told(joint)

    def text(begin: str) -> str:
        return controller_header(law, begin, name, told, gains or {})

    return Header(text(prefix or name), check_controller(controller, joint, text(TRIED)))


def observer_to_c(
    observer: LinearObserver, joint: Joint, name: str, prefix: str | None = None
) -> Header:
    """Return an observer as a C header; its names begin with the prefix, or else its name.

    Raises:
        ExportError: The header does otherwise than the observer.
    """
    told = _told(joint)
    text = observer_header(observer, prefix or name, name, told)
    tried = observer_header(observer, TRIED, name, told)
    return Header(text, check_observer(observer, joint, tried))


def _told(joint: Joint) -> str:
    return f"{joint.parameters.name}, {joint.structure}"


def wanted_torque(limit: float) -> Floats:
    """Return torques that are held for a while each, also beyond a limit [N m]."""
    rng = np.random.default_rng(0)
    return np.repeat(rng.uniform(-BEYOND * limit, BEYOND * limit, STEPS // HOLD), HOLD)


def check_controller(controller: Controller, joint: Joint, header: str) -> Checked:
    """Compare a header with the prefix "law" with its controller, in a closed loop."""
    try:
        library = compiled(CONTROLLER, {"law.h": header})
    except ConfigurationError as reason:
        return Checked(0, math.nan, str(reason))
    step = library.step
    step.restype, step.argtypes = ctypes.c_double, [ctypes.c_double] * (1 + len(MEASURED))
    reference = wanted_torque(min(controller.torque_limit, limits_of(joint).tau))
    plant, pairs = SimulatedPlant(joint, 1, controller.dt), []
    for begin in (0, STEPS // 3):  # a second run begins without the past of the first
        now = plant.reset(seed=begin)
        controller.reset()
        library.reset()
        for r in reference[begin:]:
            command = controller.act(now, np.array([r]))
            pairs.append((command[0], step(r, *_values(now))))
            now = plant.step(command)
    controller.reset()
    one, other = np.array(pairs).T
    return _checked(one - other, np.abs(one).max())


def check_observer(observer: LinearObserver, joint: Joint, header: str) -> Checked:
    """Compare a header with the prefix "law" with its observer, on a joint that is disturbed."""
    try:
        library = compiled(OBSERVER, {"law.h": header})
    except ConfigurationError as reason:
        return Checked(0, math.nan, str(reason))
    step, number = library.step, ctypes.c_double
    step.restype = None
    step.argtypes = [*[number] * (1 + len(MEASURED)), ctypes.POINTER(number)]
    room, apart, size = (number * len(observer.names))(), [], np.zeros(len(observer.names))
    library.reset()
    for k, (sent, now) in enumerate(_pushed(joint, observer.dt)):
        found = observer.step(now, sent, np.array([k == 0]))
        step(float(sent[0]), *_values(now), room)
        apart.append(np.concatenate(list(found.values())) - np.array(room))
        size = np.maximum(size, observer.terms()[:, 0])
    return _checked(np.array(apart), size)


def _pushed(joint: Joint, dt: float) -> Iterator[tuple[Floats, Measurement]]:
    """Give the command since the sample before and what a joint measures, step by step."""
    plant = SimulatedPlant(joint, 1, dt)
    now, sent = plant.reset(seed=0), np.zeros(1)
    for torque in wanted_torque(0.1 * limits_of(joint).tau):
        yield sent, now
        sent = np.array([torque])
        now = plant.step(sent)


def _values(now: Measurement) -> list[float]:
    return [float(getattr(now, name)[0]) for name in MEASURED]


def _checked(apart: Floats, size: Floats) -> Checked:
    error = float((np.abs(apart) / np.maximum(size, 1e-300)).max())
    if not error <= TOLERANCE:
        raise ExportError(
            f"What was written differs from Python by {error:.2g} of its largest output, more than "
            f"{TOLERANCE:g}. Do not use it."
        )
    return Checked(len(apart), error)


def compiler() -> str | None:
    """Return the C compiler of this machine, None where there is none."""
    return next((name for name in COMPILERS if shutil.which(name)), None)


def compiled(source: str, headers: Mapping[str, str]) -> ctypes.CDLL:
    """Return the library of a C source and its headers, by file name."""
    name = compiler()
    if name is None:
        raise ConfigurationError(f"There is no C compiler ({', '.join(COMPILERS)}) to try it with.")
    with tempfile.TemporaryDirectory() as place:  # a library that is loaded needs no file
        folder = Path(place)
        for file, text in {**headers, "source.c": source}.items():
            (folder / file).write_text(text, encoding="utf-8")
        library, source_file = str(folder / "library.so"), str(folder / "source.c")
        words = [name, *OPTIONS, "-shared", "-o", library, source_file, "-lm"]
        done = subprocess.run(words, capture_output=True, text=True, check=False)
        if done.returncode:
            raise ConfigurationError(f"{name} does not take the header: {done.stderr}")
        return ctypes.CDLL(library)
