"""What holds for all tests."""

import sys

import pytest
from hypothesis import settings

settings.register_profile("untimed", deadline=None)  # machines differ; no test asserts a time
settings.load_profile("untimed")

if sys.platform == "win32":  # signals, pseudo-terminals and limits of POSIX
    collect_ignore = [
        f"canbus/test_{name}.py" for name in ("campaign", "endings", "fuzz", "kills", "soak")
    ]


@pytest.fixture(autouse=True, scope="session")
def _no_notice() -> None:
    """Let no test see a line about compilation, which comes when the cache is empty."""
    from cjt_gym.joint.kernel.compiling import while_compiling

    while_compiling(lambda begins: None)
