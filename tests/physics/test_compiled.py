"""An installation that nobody may write to works without kept code."""

from __future__ import annotations

from typing import Any

import pytest
from numba import njit

from cjt_gym.errors import CjtGymWarning
from cjt_gym.joint.kernel import compiled


def test_code_that_cannot_be_kept_is_compiled_all_the_same(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def without_a_place(function: Any, cache: bool = False, **options: Any) -> Any:
        if cache:
            raise RuntimeError("cannot cache function: no locator available")
        return njit(function, **options)

    monkeypatch.setattr(compiled, "njit", without_a_place)
    compiled._warn.cache_clear()
    with pytest.warns(CjtGymWarning, match="NUMBA_CACHE_DIR") as told:
        functions = [decorate(lambda x: x + 1.0) for decorate in (compiled.compiled,) * 2]
    assert len(told) == 1
    assert [function(1.0) for function in functions] == [2.0, 2.0]
