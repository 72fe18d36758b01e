"""The decorators of all compiled functions, and their cache on disk.

`compiled` and `threaded` functions are called from Python. `lean` and `inlined` ones are called by
other compiled functions only, with which they are compiled; called from Python they run as Python.
`shared` ones are kept apart, as compiling them takes long.
All but `compiled` ones allocate nothing: their arrays are borrowed, so that no reference is
counted (Numba's option `_nrt`), which makes small functions several times faster.

Numba recompiles a cached function when its own file changes, but not when a function that it calls
changes. The cache of the whole package is therefore discarded when any file with compiled
functions, or with constants that they read, changes.
"""

from __future__ import annotations

import contextlib
import hashlib
import re
import warnings
from collections.abc import Callable
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeVar

from numba import njit
from numba.extending import register_jitable

from cjt_gym.errors import CjtGymWarning
from cjt_gym.joint.kernel import compiling  # noqa: F401  # reports compilations from now on

PACKAGES = (
    "cjt_gym.joint",
    "cjt_gym.signals",
    "cjt_gym.plant",
    "cjt_gym.envs",
    "cjt_gym.gap",
    "cjt_gym.training.deploy",
)
STAMP = "compiled.stamp"
UNKEPT = (
    "Compiled code cannot be kept, as neither the installation nor the cache of this user can be "
    "written to: it is compiled again in every process, which takes a minute. Set the environment "
    "variable NUMBA_CACHE_DIR to a folder of your own."
)
BORROWED: Any = {"_nrt": False}
INNER: Any = {"_nrt": False, "no_cfunc_wrapper": True}
Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """Compile a function that may allocate."""
    return _kept(function)


def lean(function: Function) -> Function:
    """Compile a function that allocates nothing, without counting references to its arrays."""
    inner: Function = register_jitable(**INNER)(function)
    return inner


def apart(function: Function) -> Function:
    """Compile a lean function that is never inlined, as what an inlined one calls otherwise is.

    For rare and long parts of a step, which would only delay its compilation.
    """
    inner: Function = register_jitable(forceinline=False, **INNER)(function)
    return inner


def threaded(function: Function) -> Function:
    """Compile a lean function that threads may run in parallel."""
    return _kept(function, nogil=True, **BORROWED)


def inlined(function: Function) -> Function:
    """Compile a lean function into its callers, as passing its arrays would cost more."""
    inner: Function = register_jitable(forceinline=True, **INNER)(function)
    return inner


def shared(function: Function) -> Function:
    """Compile an inlined function once for all its callers, and keep it on disk.

    For a large one with several callers, which would each wait for it in every new program.
    """
    return _kept(function, forceinline=True, nogil=True, **INNER)


def reordered(function: Function) -> Function:
    """Compile an inlined function that may be vectorised: sums in any order, no exceptions.

    A division by zero gives inf or NaN.
    """
    loose: Any = {"fastmath": {"reassoc", "contract"}, "error_model": "numpy"}
    inner: Function = register_jitable(forceinline=True, **loose, **INNER)(function)
    return inner


def _kept(function: Function, **options: Any) -> Function:
    """Compile a function, and cache the result on disk where that is possible."""
    try:
        kept: Function = njit(function, cache=True, **options)
    except RuntimeError:  # an installation that is read-only, and no home
        _warn()
        kept = njit(function, **options)
    return kept


@cache
def _warn() -> None:
    """Warn once that compiled code cannot be cached."""
    warnings.warn(UNKEPT, CjtGymWarning, stacklevel=2)


def _folders() -> list[Path]:
    found = [find_spec(name) for name in PACKAGES]
    return [Path(spec.origin).parent for spec in found if spec is not None and spec.origin]


def _sources(folders: list[Path]) -> list[Path]:
    """Return the files with compiled functions, and those that they import from."""
    texts = {path: path.read_text("utf-8") for folder in folders for path in folder.rglob("*.py")}
    names = {".".join(path.with_suffix("").parts[-2:]): path for path in texts}
    found = [path for path, text in texts.items() if f"from {__name__} import" in text]
    for path in found:  # grows while it is read
        for module in re.findall(r"^from (cjt_gym[.\w]+) import", texts[path], re.MULTILINE):
            other = names.get(".".join(module.split(".")[-2:]))
            if other is not None and other not in found:
                found.append(other)
    return sorted(found)


def forget_stale_code() -> None:
    """Delete the cached code if a source file differs from when it was written."""
    folders = _folders()
    states = [
        (path.name, path.stat().st_mtime_ns, path.stat().st_size) for path in _sources(folders)
    ]
    stamp = hashlib.sha256(repr(states).encode()).hexdigest()
    home = Path(__file__).parent / "__pycache__" / STAMP
    with contextlib.suppress(OSError):  # a folder that cannot be written to does not change either
        if home.exists() and home.read_text() == stamp:
            return
        for folder in folders:
            for path in folder.rglob("__pycache__/*.nb[ic]"):
                path.unlink(missing_ok=True)
        home.parent.mkdir(exist_ok=True)
        home.write_text(stamp)


forget_stale_code()
