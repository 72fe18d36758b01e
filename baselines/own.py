"""Your own controllers: `PATH.py:NAME`, code that is imported only if it is named this way.

NAME is a `ControllerEntry`, or a class or function that is called with (joint, dt) and a value of
each of its gains. It may list them as its attribute `tunable`, each a `Gain` with the value that is
usual. What comes back is a `Controller`, or anything with

    act(measurement, reference) -> motor torque [N m], shape (n,)
    reset(mask=None), which forgets the past of the joints in the mask

whose commands are kept within the joint's limit.
"""

from __future__ import annotations

import hashlib
import importlib.util
import inspect
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any, final

import numpy as np

from cjt_gym.baselines.controller import Controller, Floats, Mask, check_sampling
from cjt_gym.baselines.entry import ControllerEntry, Gain
from cjt_gym.errors import (
    CjtGymError,
    CommandError,
    ConfigurationError,
    MissingFileError,
    unknown_name,
)
from cjt_gym.joint import Joint
from cjt_gym.plant import Measurement, limits_of

ENDING = ".py:"


def is_own(word: str) -> bool:
    """Return whether a word names code, as PATH.py:NAME."""
    return ENDING in f"{word}:"


def path_of(word: str) -> Path:
    """Return the file of PATH.py:NAME."""
    return Path(_parts(word)[0])


def _parts(word: str) -> tuple[str, str]:
    """Return path and name of PATH.py:NAME; the name is empty where there is none."""
    path, colon, name = word.rpartition(":")
    return (path, name) if colon and not name.endswith(".py") else (word, "")


@final
@dataclass(eq=False)
class OwnController(Controller):
    """Runs what is no `Controller` itself, within the limit of the joint."""

    law: Any  # anything with `act` and `reset`
    name: str  # its name, for errors
    dt: float  # sample time [s]
    torque_limit: float  # largest motor torque that is commanded [N m]

    def __post_init__(self) -> None:
        check_sampling(self)

    def _command(self, measurement: Measurement, reference: Floats, fresh: Mask) -> Floats:
        with _told(self.name):
            if fresh.any():
                self.law.reset(None if fresh.all() else fresh.copy())
            command = np.asarray(self.law.act(measurement, reference.copy()), dtype=np.float64)
        if command.shape != fresh.shape or not np.isfinite(command).all():
            raise CommandError(
                f"act of {self.name} must return finite motor torques of the shape {fresh.shape}, "
                f"got {command!r}."
            )
        return command


@contextmanager
def _told(name: str) -> Iterator[None]:
    """Say whose code it is that fails, and where."""
    try:
        yield
    except CjtGymError:
        raise
    except Exception as error:
        raise ConfigurationError(
            f"The code of {name} fails: {_reason(error, path_of(name).resolve())}."
        ) from error


def _reason(error: Exception, path: Path) -> str:
    """Return what went wrong, and the last line of the file that led to it."""
    lines = traceback.extract_tb(error.__traceback__)
    own = [row.lineno for row in lines if row.filename == str(path)]
    return f"{type(error).__name__}: {error} (line {(own or [lines[-1].lineno])[-1]})"


def own_entry(word: str) -> ControllerEntry:
    """Return the row of your own controller."""
    path, name = path_of(word), _parts(word)[1]
    if not path.is_file():
        raise MissingFileError(f"The controller {word} does not exist: there is no file {path}.")
    module = _imported(path.resolve(), path.read_bytes())
    found = vars(module).get(name)
    if isinstance(found, ControllerEntry):
        return found
    known = [n for n, v in vars(module).items() if _is_own(v, module)]
    if not name:
        raise ConfigurationError(
            f"{word} must name the controller as well, as {word}:NAME. There: {', '.join(known)}."
        )
    if found is None or not callable(found):
        raise unknown_name(f"controller of {path}", name, known)
    return entry_of(word, name, found)


def entry_of(word: str, name: str, make: Callable[..., Any]) -> ControllerEntry:
    """Return the row of what makes a controller."""
    tunable = tuple(getattr(make, "tunable", ()))
    if not all(isinstance(gain, Gain) and gain.usual is not None for gain in tunable):
        raise ConfigurationError(
            f"tunable of {word} must be a tuple of cjt_gym.baselines.Gain, each with usual=, got "
            f"{tunable!r}."
        )

    def build(joint: Joint, dt: float, gains: Mapping[str, float]) -> Controller:
        taken = f"(joint, dt{''.join(f', {gain.name}' for gain in tunable)})"
        try:
            inspect.signature(make).bind(joint, dt, **gains)
        except TypeError as error:
            raise ConfigurationError(f"{word} must take {taken}: {error}.") from error
        with _told(word):
            law = make(joint, dt, **gains)
        if isinstance(law, Controller):
            return law
        if isinstance(law, type) or not all(hasattr(law, m) for m in ("act", "reset")):
            raise ConfigurationError(
                f"{word} must make a controller, with act(measurement, reference) and "
                f"reset(mask), got {law!r}."
            )
        return OwnController(law, word, dt, limits_of(joint).tau)

    summary = (getattr(make, "__doc__", None) or name).strip().splitlines()[0]
    return ControllerEntry(word, summary, word, tunable, lambda joint, dt: {}, build)


def _is_own(value: Any, module: ModuleType) -> bool:
    here = getattr(value, "__module__", None) == module.__name__
    return isinstance(value, ControllerEntry) or (callable(value) and here)


@lru_cache(maxsize=64)
def _imported(path: Path, content: bytes) -> ModuleType:
    """Return the module of a file, imported once for each content."""
    name = f"cjt_gym_own_{path.stem}_{hashlib.sha256(bytes(path) + content).hexdigest()[:12]}"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look their module up there
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        del sys.modules[name]
        raise ConfigurationError(f"{path} cannot be imported: {_reason(error, path)}.") from error
    return module
