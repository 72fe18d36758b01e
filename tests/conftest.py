"""What holds for all tests."""

import sys

from hypothesis import settings

settings.register_profile("untimed", deadline=None)  # machines differ; no test asserts a time
settings.load_profile("untimed")

if sys.platform == "win32":  # signals, pseudo-terminals and limits of POSIX
    collect_ignore = [
        f"canbus/test_{name}.py" for name in ("campaign", "endings", "fuzz", "kills", "soak")
    ]
