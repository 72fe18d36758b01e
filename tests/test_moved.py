"""Modules can be imported by the names that they had."""

from __future__ import annotations

import pickle
import sys
from importlib import import_module
from importlib.util import find_spec

import pytest

from cjt_gym.moved import MOVED


@pytest.mark.parametrize("old", MOVED)
def test_an_old_name_leads_to_a_module_that_there_is(old: str) -> None:
    assert find_spec(MOVED[old]) is not None
    found = find_spec(old)
    assert found is not None
    assert found.loader is not None
    if not MOVED[old].endswith("gpu"):
        assert found.loader.get_code(old) is not None  # type: ignore[attr-defined]


def test_a_module_is_the_same_by_both_names() -> None:
    from cjt_gym.training.gpu import host

    by_old_name = import_module("cjt_gym.gpu.host")
    assert by_old_name is host
    assert host.__spec__ is not None
    assert host.__spec__.name == host.__name__ == "cjt_gym.training.gpu.host"
    assert import_module("cjt_gym.gpu").HostEpisodes is host.HostEpisodes


def test_what_was_pickled_under_an_old_name_loads() -> None:
    from cjt_gym.training.gpu.host import HostEpisodes

    text = pickle.dumps(HostEpisodes, 0).replace(b"cjt_gym.training.gpu.host", b"cjt_gym.gpu.host")
    sys.modules.pop("cjt_gym.gpu.host", None)
    assert pickle.loads(text) is HostEpisodes


def test_what_never_was_is_not_found() -> None:
    assert find_spec("cjt_gym.gpus") is None
    with pytest.raises(ModuleNotFoundError):
        import_module("cjt_gym.gpu.nothing")
