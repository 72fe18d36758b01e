"""A batch of joints: allocation, randomised parameters, stepping.

`JointBatch` owns the arrays that the kernel works on. A single joint is a batch of one.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cjt_gym.errors import ConfigurationError, SimulationError, check_range
from cjt_gym.joint.kernel.arrays import MEMORY, WORK_ROWS, WORK_WIDTH, Batch, Floats, Setup
from cjt_gym.joint.kernel.compiled import compiled
from cjt_gym.joint.kernel.control_steps import restart, step_batch
from cjt_gym.joint.kernel.current_loop import check_loop, longest_sample
from cjt_gym.joint.kernel.discretize import SCRATCH, discretize
from cjt_gym.joint.kernel.drives import get_drive
from cjt_gym.joint.kernel.random_stream import seed_state
from cjt_gym.joint.kernel.spring_table import spring_rows
from cjt_gym.joint.lanes import Blocks, Kind, advance_blocks, kind_of, make_blocks

if TYPE_CHECKING:
    from cjt_gym.joint.joint import Joint

INERTIAS = ("I_m", "I_g", "I_l")
CHANNEL_DELAYS = ("late_i", "late_q_m", "late_q_g", "late_q_l", "late_tau")
DELAYS = ("command_delay", "measurement_delay", *CHANNEL_DELAYS)

LONGEST_DELAY = 100_000
"""Control steps that are kept for each joint, which take 80 bytes each."""


def substeps_of(dt: float, dt_physics: float, name: str = "dt_control") -> int:
    """Return how many substeps make a control step, which errors call by its name."""
    check_range(name, dt, "s", above=0.0)
    check_range("dt_physics", dt_physics, "s", above=0.0)
    count = round(dt / dt_physics)
    if count < 1 or abs(count * dt_physics - dt) > 1e-9 * dt:
        raise ConfigurationError(
            f"{name} must be a whole multiple of dt_physics, got {dt:g} s and "
            f"{dt_physics:g} s. Take {dt / max(1, math.ceil(dt / dt_physics - 1e-9)):g} s."
        )
    return count


def longest_substep(joint: Joint) -> float:
    """Return the substep below which a drive is stable and its controller keeps its rate [s]."""
    return min(longest_sample(joint), longest_exchange(joint))


def longest_exchange(joint: Joint) -> float:
    """Return the substep below which the exchange between inductance and motor is stable [s].

    The currents of a drive with inductance advance apart from the mechanics, which is stable for
    h k_t n / sqrt(l_a I) < 2. Other drives know no limit.
    """
    if joint.drive not in ("rl", "dq"):
        return math.inf
    p, groups = joint.packed()[0][0], joint.structure_row.groups
    inertia = sum(
        float(p[name]) for name, g in zip(INERTIAS, groups, strict=True) if g == groups[0]
    )
    return 2.0 * math.sqrt(float(p["l_a"]) * inertia) / (float(p["k_t"]) * float(p["n"]))


@compiled
def discretize_all(batch: Batch, setup: Setup) -> None:
    """Discretise every joint of a batch."""
    scratch = np.empty(SCRATCH)
    for i in range(batch.a.shape[0]):
        discretize(batch.p[i], setup.groups, setup.h, batch.a[i], batch.b[i], scratch)


@compiled
def restart_some(batch: Batch, setup: Setup, mask: NDArray[np.bool_], load: Floats) -> None:
    """Restart the joints in a mask from their state."""
    work = np.zeros((WORK_ROWS, WORK_WIDTH))
    for i in range(mask.shape[0]):
        if mask[i]:
            restart(batch, setup, i, load[i], work)


class JointBatch:
    """The state of `num` joints and the compiled steps over them."""

    def __init__(
        self,
        joint: Joint,
        num: int,
        dt: float,
        dt_physics: float,
        *,
        voltage: bool = False,
        longest_delay: float = 0.0,
    ) -> None:
        """Allocate and discretise `num` identical joints, at rest at the origin.

        `dt` is a whole multiple of the substep `dt_physics`, and `longest_delay` that which will be
        set later [s]; with `voltage` commands are voltages [V] instead of currents [A].
        """
        structure = joint.structure_row
        substeps = substeps_of(dt, dt_physics)
        record, ripple = joint.packed()
        longest = longest_exchange(joint)
        if dt / substeps >= longest:
            raise ConfigurationError(
                f"dt_physics must be < {longest:.3g} s for drive {joint.drive} of "
                f"{joint.file.parameters.name} (k_t n, l_a and the motor's inertia), got "
                f"{dt / substeps:g} s."
            )
        if not voltage:
            check_loop(joint, dt / substeps)
        delay = max(longest_delay, float(sum(record[name][0] for name in DELAYS)))
        if delay > LONGEST_DELAY * dt:
            raise ConfigurationError(
                f"The delays of {joint.file.parameters.name} together must be <= "
                f"{LONGEST_DELAY * dt:g} s, {LONGEST_DELAY} control steps, got {delay:g} s."
            )
        depth = math.ceil(delay / dt - 1e-9) + 2
        order, size = structure.order, structure.size
        table = spring_rows(joint.effects, joint.parameters.origin)
        self.setup = Setup(
            structure.groups,
            size,
            order,
            get_drive(joint.drive),
            voltage,
            dt / substeps,
            substeps,
            dt,
        )
        self.arrays = Batch(
            p=np.repeat(record, num),
            ripple=np.repeat(ripple[None], num, axis=0),
            a=np.zeros((num, order, order)),
            b=np.zeros((num, order, 2 + size)),
            state=np.zeros((num, 6)),
            memory=np.zeros((num, MEMORY + table.size)),
            currents=np.zeros((num, 2)),
            tau=np.zeros(num),
            snapshot=np.zeros((num, 8)),
            commands=np.zeros((num, depth, 2)),
            outputs=np.zeros((num, depth, 8)),
            measured=np.zeros((num, 8)),
            samples=np.zeros(num, dtype=np.int64),
            rng=np.zeros(num, dtype=np.uint64),
        )
        self.arrays.memory[:, MEMORY:] = table.ravel()
        self._all = np.ones(num, dtype=np.bool_)
        self.kind: Kind | None = None  # where blocks can step them
        self.blocks: Blocks | None = None
        self.discretize()

    def use_blocks(self, joint: Joint, threads: int = 1) -> None:
        """Step joints in blocks if they are of a kind that blocks support.

        It gives what the general kernel gives, faster.
        """
        self.kind = kind_of(joint, self.setup.is_voltage)
        num = self.arrays.tau.shape[0]
        self.blocks = make_blocks(self.kind, num, threads) if self.kind is not None else None

    def discretize(self) -> None:
        """Recompute the exact discretisation after parameters changed."""
        discretize_all(self.arrays, self.setup)
        self.renew(self._all)

    def renew(self, mask: NDArray[np.bool_]) -> None:
        """Record which joints have new parameters or a new discretisation."""
        if self.blocks is not None:
            self.blocks.stale[mask] = True

    def seed(self, i: int, seed: int) -> None:
        """Seed the random stream of joint i."""
        self.arrays.rng[i] = seed_state(seed)

    def restart(self, mask: NDArray[np.bool_], load: Floats) -> None:
        """Clear memory and delays of the joints in the mask and measure their present state."""
        restart_some(self.arrays, self.setup, mask, load)
        self.renew(mask)

    def step(self, commands: Floats, load: Floats) -> None:
        """Advance all joints by one control step.

        Args:
            commands: Commands on the q and d axes, shape (num, 2) [A or V].
            load: Load torque [N m] or load velocity [rad/s], shape (num,).
        """
        mask, left = self._all, self.arrays.tau.shape[0]
        if self.blocks is not None and self.kind is not None:
            mask, count = self.blocks.left, self.blocks.rows.shape[0]
            parts = self.arrays, self.setup, self.kind, self.blocks
            left = advance_blocks(*parts, commands, load, (0, count, 0))
        if left > 0:
            self.step_some(commands, load, mask)

    def step_some(self, commands: Floats, load: Floats, mask: NDArray[np.bool_]) -> None:
        """Do what `step` does with the general kernel, for the joints in a mask, shape (num,)."""
        failed = step_batch(self.arrays, self.setup, commands, load, mask)
        if failed >= 0:
            raise SimulationError(
                f"The state of joint {failed} ceased to be finite after "
                f"{self.arrays.samples[failed]} control steps (command {commands[failed, 0]:g}, "
                f"load {load[failed]:g}); its last good state is {self.arrays.state[failed]}. "
                "Check the command and the parameters.",
                last_good_states=self.arrays.state.copy(),
            )
