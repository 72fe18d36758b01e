"""Joints built from the golden parameter sets."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from cjt_gym.joint import Joint, load_joint
from tests.golden.loader import write_joint

JointOf = Callable[..., Joint]


@pytest.fixture
def joint_of(tmp_path: Path) -> JointOf:
    """Return a function that builds a joint from a golden set, through a joint file."""

    def build(
        name: str,
        structure: str,
        drive: str = "current",
        effects: Mapping[str, Mapping[str, Any]] | None = None,
        replace: Mapping[str, float] | None = None,
    ) -> Joint:
        path = write_joint(tmp_path / f"{name}.toml", name, replace)
        return load_joint(path, structure=structure, drive=drive, effects=effects or {})

    return build
