"""Modules that have moved: what outside code imports by an old name is the module of today.

A table and not files: an old name costs a row, and a class has one home however it is imported, so
policies that were saved under the old name load.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from types import CodeType, ModuleType

MOVED = {
    "cjt_gym.characteristics.reflect": "cjt_gym.characteristics.reflection",
    "cjt_gym.gpu": "cjt_gym.training.gpu",
    "cjt_gym.training.batch_learner": "cjt_gym.training.gpu.batch_learner",
    "cjt_gym.training.conditions": "cjt_gym.training.evaluation.conditions",
    "cjt_gym.training.config": "cjt_gym.training.learning.config",
    "cjt_gym.training.distributed": "cjt_gym.training.learning.distributed",
    "cjt_gym.training.emps": "cjt_gym.training.demo.emps",
    "cjt_gym.training.evaluate": "cjt_gym.training.evaluation.evaluate",
    "cjt_gym.training.gains": "cjt_gym.training.tuning.gains",
    "cjt_gym.training.grid": "cjt_gym.training.benchmark.grid",
    "cjt_gym.training.metrics": "cjt_gym.training.evaluation.metrics",
    "cjt_gym.training.performance": "cjt_gym.training.evaluation.performance",
    "cjt_gym.training.policy": "cjt_gym.training.learning.policy",
    "cjt_gym.training.quiet": "cjt_gym.training.learning.quiet",
    "cjt_gym.training.rollout": "cjt_gym.training.evaluation.rollout",
    "cjt_gym.training.search": "cjt_gym.training.learning.search",
    "cjt_gym.training.tasks": "cjt_gym.training.evaluation.tasks",
    "cjt_gym.training.train": "cjt_gym.training.learning.train",
    "cjt_gym.training.tune": "cjt_gym.training.tuning.tune",
    "cjt_gym.training.zoo": "cjt_gym.training.learning.zoo",
}
"""New name by old one; what lies within a package has moved with it."""


def name_of_today(name: str) -> str | None:
    """Return the name of a module that has moved, None where it has not."""
    for old, new in MOVED.items():
        if name == old or name.startswith(f"{old}."):
            return new + name.removeprefix(old)
    return None


class Moved(MetaPathFinder, Loader):
    """Finds modules by the names that they had."""

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return what leads from an old name to the module."""
        new = name_of_today(name)
        found = find_spec(new) if new else None
        return ModuleSpec(name, self, origin=found.origin) if found else None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """Return the module itself."""
        module = import_module(str(name_of_today(spec.name)))
        self._own = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        """Leave the module as it is: it has been run under its own name."""
        module.__spec__ = self._own

    def get_code(self, name: str) -> CodeType | None:
        """Return the code for `python -m` with the old name."""
        found = find_spec(str(name_of_today(name)))
        code: CodeType | None = found.loader.get_code(found.name)  # type: ignore[union-attr]
        return code


def install() -> None:
    """Let old names be imported."""
    sys.meta_path.insert(0, Moved())
