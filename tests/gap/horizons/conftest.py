"""The joint file of the arm."""

from __future__ import annotations

from pathlib import Path

import pytest

from cjt_gym.joint import JointFile, load_joint_file
from tests.gap.horizons.arm import ARM


@pytest.fixture
def arm(tmp_path: Path) -> JointFile:
    path = tmp_path / "arm.toml"
    path.write_text(ARM)
    return load_joint_file(path)
