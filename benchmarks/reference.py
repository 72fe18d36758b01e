"""The kernel beside a C program of the same arithmetic."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Table
from benchmarks.timing import best_in_turns
from cjt_gym.joint import load_joint
from cjt_gym.joint.lanes import advance_blocks
from cjt_gym.joint.lanes.vectors import WIDTH
from cjt_gym.plant import SimulatedPlant

SOURCE = Path(__file__).with_name("reference.c")
FLAGS = ("-O3", "-march=native", "-ffast-math", "-shared", "-fPIC", f"-DWIDTH={WIDTH}")
LONGEST = "-mprefer-vector-width=512"  # only some compilers know it
DQ_0 = 0.002
NUM, STEPS = 1024, 40
EFFECTS = {
    "coulomb": {"dq_0": DQ_0},
    "cogging": {"f": (80.0, 480.0), "a": (0.5, 0.2), "b": (0.2, 0.1)},
}
Floats = NDArray[np.float64]
# Rows of a block: x, a, inputs of motor, gear and load, levels, 1 / dq_0, tolerances, tones,
# torque, load.
X, A, MOTOR, GEAR, LOAD, LEVEL, STEEP, ENOUGH, CLOSE, TONE, TORQUE, PUSHED, ROWS = (
    *(0, 6, 42, 48, 54, 60),
    *(62, 63, 64, 65, 71, 72, 73),
)


def compile_reference(folder: str) -> Any:
    """Return the C function, compiled for this machine, or None without gcc."""
    if shutil.which("gcc") is None:
        return None
    library = Path(folder) / "reference.so"
    command = ["gcc", *FLAGS, "-o", str(library), str(SOURCE), "-lm"]
    if subprocess.run([*command, LONGEST], check=False, capture_output=True).returncode != 0:
        subprocess.run(command, check=True)
    function = ctypes.CDLL(str(library)).advance
    function.argtypes = [ctypes.c_void_p, ctypes.c_int, ctypes.c_int, ctypes.c_double]
    function.restype = None
    return function


def make_plant(sharp: bool = False) -> SimulatedPlant:
    """Return a batch of full joints with Coulomb friction and cogging, each a little different."""
    effects = {**EFFECTS, "coulomb": {"dq_0": 0.0 if sharp else DQ_0}}
    joint = load_joint("orange_80_6000", "full_dynamics", effects=effects, parameters={"I_l": 3.0})
    plant = SimulatedPlant(joint, NUM, randomization={"k_b": (0.9, 1.1)})
    plant.batch.use_blocks(joint)
    plant.reset(seed=0)
    return plant


def blocks_of(plant: SimulatedPlant) -> Floats:
    """Return the same joints as the C program wants them, shape (blocks, ROWS, WIDTH)."""
    arrays = plant.batch.arrays
    rows = np.zeros((ROWS, NUM))
    rows[A:MOTOR] = arrays.a.reshape(NUM, 36).T
    rows[MOTOR:GEAR], rows[GEAR:LOAD] = arrays.b[:, :, 0].T, arrays.b[:, :, 3].T
    rows[LOAD:LEVEL] = arrays.b[:, :, 1].T
    rows[LEVEL], rows[LEVEL + 1], rows[STEEP] = arrays.p["d_cm"], arrays.p["d_cg"], 1.0 / DQ_0
    rows[ENOUGH] = 1e-10 + 1e-7 * DQ_0
    rows[CLOSE] = 0.5 * np.sqrt(rows[ENOUGH] * DQ_0)
    rows[TONE:TORQUE] = arrays.ripple[:, :, :3].reshape(NUM, 6).T
    blocks = rows.reshape(ROWS, -1, WIDTH).transpose(1, 0, 2)
    return np.ascontiguousarray(blocks)


def pushes() -> Floats:
    """Return motor torques that make joints start, stop and turn, shape (STEPS, NUM)."""
    rng = np.random.default_rng(0)
    held = rng.uniform(-30.0, 30.0, (1 + STEPS // 8, NUM)) * (rng.random((1, NUM)) < 0.8)
    return np.repeat(held, 8, axis=0)[:STEPS]


def kernel_work(plant: SimulatedPlant, torques: Floats) -> Callable[[], int]:
    """Return work that runs the kernel alone; its unit is one joint's control step."""
    batch = plant.batch
    assert batch.kind is not None
    assert batch.blocks is not None
    parts, none = (batch.arrays, batch.setup, batch.kind, batch.blocks), np.zeros(NUM)
    per_ampere = plant.joint.parameters.k_t * plant.joint.parameters.n
    commands = np.zeros((STEPS, NUM, 2))
    commands[:, :, 0] = torques / per_ampere
    count = batch.blocks.rows.shape[0]

    def work() -> int:
        for command in commands:
            advance_blocks(*parts, command, none, (0, count, 0))
        return STEPS * NUM

    return work


def c_work(function: Any, blocks: Floats, torques: Floats) -> Callable[[], int]:
    """Return the same work for the C program."""

    def work() -> int:
        for torque in torques:
            blocks[:, TORQUE] = torque.reshape(-1, WIDTH)
            function(blocks.ctypes.data, blocks.shape[0], 10, 1e-4)
        return STEPS * NUM

    return work


def table() -> Table:
    """Measure kernel and C program in turns, after checking that they agree."""
    torques, smooth = pushes(), make_plant()
    works = {
        "smooth": kernel_work(smooth, torques),
        "sharp": kernel_work(make_plant(True), torques),
    }
    rows, note = [], "gcc was not found."
    with tempfile.TemporaryDirectory() as folder:
        function = compile_reference(folder)
        if function is not None:
            blocks = blocks_of(smooth)
            works["C"] = c_work(function, blocks, torques)
            works["C"](), works["smooth"]()
            state = smooth.batch.arrays.state
            other = blocks[:, X : X + 6].transpose(0, 2, 1).reshape(NUM, 6)
            error = np.abs(other - state).max(axis=0) / np.abs(state).max(axis=0)
            note = f"Largest difference of their states, relative to the peak: {error.max():.1e}."
        times = best_in_turns(works)
    unit = times.get("C", times["smooth"])
    for name, label in (("C", "C"), ("smooth", "kernel"), ("sharp", "kernel, sharp friction")):
        if name in times:
            rows.append([label, f"{1e9 * times[name]:.0f}", f"{unit / times[name]:.2f}"])
    return Table(
        "Kernel and C",
        f"CPU time of a control step of ten substeps on one core: {NUM} joints, full_dynamics, "
        "smooth Coulomb friction of motor and gear (dq_0 = 0.002 rad/s), two harmonics of cogging. "
        "`reference.c` does the same arithmetic (gcc -O3 -march=native -ffast-math); the kernel "
        f"also keeps the rings of commands and outputs and measures. {note}",
        ["program", "ns per control step", "speed / C"],
        rows,
    )
