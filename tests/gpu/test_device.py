"""Episodes on a CUDA device: in Numba's simulator, on a device where there is one, and as code."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numba import cuda

from cjt_gym.baselines.gains import choose
from cjt_gym.baselines.linear_law import LinearController
from cjt_gym.baselines.pd_feedforward import PdFeedForward
from cjt_gym.errors import ConfigurationError, UnknownNameError
from cjt_gym.joint import load_joint
from cjt_gym.joint.kernel.arrays import CHANNELS
from cjt_gym.plant import Measurement
from cjt_gym.training.gpu import HostEpisodes, make_episodes
from cjt_gym.training.gpu.device import DeviceEpisodes, TorchLaw

HERE = Path(__file__).parent


def script(name: str) -> Any:
    spec = importlib.util.spec_from_file_location(name, HERE / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


simulated = script("simulated")


@pytest.mark.parametrize("case", ["usual", pytest.param("everything", marks=pytest.mark.slow)])
def test_the_simulated_device_does_what_the_cpu_does(case: str, tmp_path: Path) -> None:
    out = tmp_path / "device.npz"
    command = [sys.executable, str(HERE / "simulated.py"), case, str(out)]
    flags = {"NUMBA_ENABLE_CUDASIM": "1", "NUMBA_DISABLE_JIT": "1"}
    subprocess.run(command, check=True, env={**os.environ, **flags}, timeout=500)
    with np.load(out) as found:
        assert_does_what_the_cpu_does(found, case)


@pytest.mark.skipif(not cuda.is_available(), reason="there is no device")
@pytest.mark.filterwarnings("ignore:.*Grid size")  # three joints do not fill a device
@pytest.mark.parametrize("case", ["usual", "everything"])
def test_a_device_does_what_the_cpu_does(case: str) -> None:
    device = DeviceEpisodes(simulated.NUM, episode_steps=simulated.EPISODE, **simulated.CASES[case])
    found = simulated.run(device, lambda: device.state.cpu())
    assert_does_what_the_cpu_does(found, case)


def assert_does_what_the_cpu_does(found: Mapping[str, Any], case: str) -> None:
    host = HostEpisodes(simulated.NUM, episode_steps=simulated.EPISODE, **simulated.CASES[case])
    arrays = host.episodes.plant.batch.arrays
    expected = simulated.run(host, lambda: arrays.state)
    assert set(found) == set(expected)
    assert found["truncated"].any()  # so that episodes began anew on the device
    for name, values in expected.items():
        # Observations are single precision: one digit of them is 1e-7 of at most 5.
        close = 2e-6 if values.dtype == np.float32 else 1e-9
        scale = max(1.0, np.abs(values).max())
        np.testing.assert_allclose(found[name], values, rtol=0.0, atol=close * scale)


COMPILE = """
import sys
import numpy as np
from numba import cuda, types, typeof
from numba.cuda import dispatcher
from cjt_gym.envs.core import Episodes
from cjt_gym.envs.arguments import complete
from cjt_gym.training.gpu import kernels

class Device:
    compute_capability = (9, 0)

dispatcher.get_current_device = lambda: Device
host = Episodes(2, **complete({"randomization": "mild"}))
batch, (program, draws) = host.plant.batch, host.plant.varying
begin = batch.arrays, batch.setup, host.task, program, draws, host.task.observation, True
count = np.zeros(1, np.int64)
step = batch.arrays, batch.setup, host.task, host.control, program, draws, count
for kernel, parts in ((kernels.begin_episodes, begin), (kernels.step_episodes, step)):
    signature = types.void(*map(typeof, parts))
    code, _ = cuda.compile(kernel, signature, device=False, output="ptx", cc=(9, 0), abi="numba")
    text = code if isinstance(code, str) else code.decode()
    assert ".target sm_90" in text and ".visible .entry" in text
    print(kernel.__name__, len(text))
"""


@pytest.mark.slow
def test_the_kernels_compile_for_a_device() -> None:
    """Takes minutes, and needs numba-cuda and NVIDIA's compiler, but no device."""
    pytest.importorskip("numba_cuda")
    command = [sys.executable, "-W", "ignore", "-c", COMPILE]
    done = subprocess.run(command, check=True, capture_output=True, text=True, timeout=3000)
    assert [line.split()[0] for line in done.stdout.splitlines()] == [
        "begin_episodes",
        "step_episodes",
    ]


@pytest.mark.parametrize("name", ["pd_feedforward", "pid_feedforward", "lqi"])
def test_a_linear_law_in_torch_is_the_controller(name: str) -> None:
    joint = load_joint("orange_80_6000", "output_fixed_rigid_gearbox")
    controller = choose(name).make(joint, 1e-3)
    assert isinstance(controller, LinearController | PdFeedForward)
    assert controller.linear is not None
    num, rng = 5, np.random.default_rng(2)
    follows = name == "pd_feedforward"
    parts = controller.linear, controller.torque_limit, num, torch.device("cpu")
    law = TorchLaw(*parts, follows=follows)
    fresh = np.ones(num, dtype=np.bool_)
    for k in range(20):
        measured = rng.normal(0.0, 0.2, (num, 8))
        measured[:, -1] *= 300.0
        reference = rng.normal(0.0, 60.0, num)
        columns = dict(zip(CHANNELS, measured.T, strict=True))
        expected = controller.act(Measurement(t=np.zeros(num), **columns), reference)
        tensors = torch.from_numpy(measured), torch.from_numpy(reference), torch.from_numpy(fresh)
        np.testing.assert_allclose(law.act(*tensors).numpy(), expected, rtol=1e-9, atol=1e-9)
        fresh = rng.random(num) < 0.2 if k == 10 else np.zeros(num, dtype=np.bool_)
        controller.reset(fresh)


def test_the_tensors_of_the_cpu_are_its_arrays() -> None:
    episodes = make_episodes(2, "cpu")
    observation = episodes.reset(1)
    assert observation.data_ptr() == episodes.episodes.task.observation.ctypes.data
    before = observation.clone()
    episodes.step(torch.ones(2, 1))
    assert not torch.equal(before, observation)


def test_other_devices_are_refused() -> None:
    with pytest.raises(UnknownNameError, match="device"):
        make_episodes(1, "gpu")


@pytest.mark.skipif(cuda.is_available(), reason="there is a device")
def test_without_a_device_it_says_what_to_do() -> None:
    with pytest.raises(ConfigurationError, match="needs a CUDA device"):
        make_episodes(1, "cuda")


@pytest.mark.parametrize("name", ["adaptive_friction", "mpc", "impedance"])
def test_a_base_controller_that_is_more_than_a_linear_law_is_refused(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cuda, "is_available", lambda: True)
    with pytest.raises(ConfigurationError, match="must be a linear law"):
        make_episodes(1, "cuda", base_controller=choose(name).make)
