"""What a controller is asked to do in the benchmark: one row per task."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from cjt_gym.errors import check_name
from cjt_gym.joint import Joint, get_structure
from cjt_gym.plugins import installed_rows
from cjt_gym.signals import Signal
from cjt_gym.training.evaluation.conditions import STEP_HOLD, TASKS, Conditions, task_reference

if TYPE_CHECKING:
    from cjt_gym.training.evaluation.rollout import Agent

# What is asked for is part of the benchmark: other numbers make another task, and old results do
# not compare with new ones.
REVERSAL_PERIOD, REVERSAL_SHARE = 1.0, 0.5
"""Of slow ramps [s], and their height over the amplitude: friction is most of the error."""
RENDERED_SHARE, RENDERED_CORNER_HZ = 0.02, 8.0
"""Rendered stiffness over the torsion bar's, and its corner with its damper [Hz]."""
MOTION_LOW, MOTION_HIGH, MOTION_TONES = 0.5, 3.0, 6
"""Of a motion from outside: from [Hz], to [Hz], and how many tones."""
WALL_SHARE, WALL_ANGLE, WALL_DAMPING = 0.5, 0.02, 0.5
"""A wall: stiffness over the torsion bar's, where it stands [rad], damping [N m s/rad]."""
APPROACH_SHARE, APPROACH_S, PUSH_HOLD = 0.2, 0.5, 0.25
"""Torque towards the wall over the amplitude, for [s], and how long each push lasts [s]."""
CURRENT_STEP, CURRENT_HOLD = 1e-4, 0.01  # of the task current_loop [s]
OPEN_LOOP = "open_loop"
PUSHES = (0.6, 0.3, 1.0, 0.4, 0.8, 0.3)
"""Torques against the wall over the amplitude: up and down, small and large."""


@dataclass(frozen=True)
class Rendering:
    """A virtual spring and damper that the reference renders at the output.

    Attributes:
        stiffness: [N m/rad].
        damping: [N m s/rad].
    """

    stiffness: float
    damping: float


@dataclass(frozen=True)
class Setting:
    """One task, for one joint.

    Attributes:
        conditions: What the task adds to the conditions of the comparison is in them.
        reference: Wanted joint torque [N m].
        load: Load torque [N m] or, where the output is fixed, load velocity [rad/s].
        duration: Of an episode [s].
        from_zero: Whether all bodies start at an angle of zero, instead of a random one.
        rendering: What the reference renders; it then depends on the measured motion.
        of_motor: Whether the reference is for the motor's torque instead of the joint's.
    """

    conditions: Conditions
    reference: Signal
    load: Signal | None = None
    duration: float = 1.0
    from_zero: bool = False
    rendering: Rendering | None = None
    of_motor: bool = False


@dataclass(frozen=True)
class Task:
    """One row of the table of tasks.

    Attributes:
        name: Its name in every interface.
        summary: What it is, in one line.
        setting: Makes it for conditions and the joint that they mean.
        needs: "any"; "spring" where there must be a torsion bar; "free_load" where its output must
            also be free to move.
        classical_only: Whether policies cannot take part: their observation holds the reference
            that is planned, which here follows from the motion.
        open_loop_only: Whether only `open_loop` takes part, which hands the reference to the motor.
    """

    name: str
    summary: str
    setting: Callable[[Conditions, Joint], Setting]
    needs: str = "any"
    classical_only: bool = False
    open_loop_only: bool = False

    def suits(self, structure: str, agent: Agent) -> bool:
        """Return whether an agent takes part: one that renders a spring does nothing else."""
        rendering = self.name == "impedance"
        if self.open_loop_only and agent.name != OPEN_LOOP:
            return False
        return self.applies(structure, agent.kind) and (rendering or not agent.renders)

    def applies(self, structure: str, kind: str = "classical") -> bool:
        """Return whether the task exists for a structure and a kind of agent."""
        row = get_structure(structure)
        has = {"any": True, "spring": row.has_spring}
        has["free_load"] = has["spring"] and not row.output_fixed
        return has[self.needs] and (kind == "classical" or not self.classical_only)


def _tracking(name: str) -> Callable[[Conditions, Joint], Setting]:
    def setting(conditions: Conditions, joint: Joint) -> Setting:
        return Setting(conditions, task_reference(name, conditions.amplitude))

    return setting


def _reversal(conditions: Conditions, joint: Joint) -> Setting:
    height, quarter = REVERSAL_SHARE * conditions.amplitude, 0.25 * REVERSAL_PERIOD
    table = np.array([[0.0, 0.0], [1.0, 1.0], [3.0, -1.0], [4.0, 0.0]]) * [quarter, height]
    return Setting(conditions, Signal("file", table=table), duration=2.0)


def _motion(conditions: Conditions, joint: Joint) -> Signal:
    """Return a motion of the output that the rendered spring answers with the usual torque."""
    amplitude = conditions.amplitude
    if joint.structure_row.output_fixed:
        amplitude *= 2.0 * np.pi / (RENDERED_SHARE * _stiffness(joint))
    return Signal(
        "multisine",
        amplitude=float(amplitude),
        low=MOTION_LOW,
        high=MOTION_HIGH,
        count=MOTION_TONES,
    )


def _stiffness(joint: Joint) -> float:
    return float(joint.parameters.k_b)


def _load_motion(conditions: Conditions, joint: Joint) -> Setting:
    reference = task_reference("smooth", conditions.amplitude)
    return Setting(conditions, reference, _motion(conditions, joint), duration=2.0)


def _contact(conditions: Conditions, joint: Joint) -> Setting:
    wall = {
        "stiffness": WALL_SHARE * _stiffness(joint),
        "exponent": 1.0,
        "damping": WALL_DAMPING,
        "position": WALL_ANGLE,
    }
    levels = [APPROACH_SHARE, *PUSHES]
    starts = [0.0, *(APPROACH_S + PUSH_HOLD * k for k in range(len(PUSHES)))]
    ends = [*starts[1:], starts[-1] + PUSH_HOLD]
    table = np.array(
        [
            [t, level]
            for level, start, end in zip(levels, starts, ends, strict=True)
            for t in (start, end - 1e-6)
        ]
    )
    effects = {**(conditions.effects or {}), "contact": wall}
    return Setting(
        replace(conditions, effects=effects),
        Signal("file", amplitude=conditions.amplitude, table=table),
        duration=float(ends[-1]),
        from_zero=True,
    )


def _impedance(conditions: Conditions, joint: Joint) -> Setting:
    stiffness = RENDERED_SHARE * _stiffness(joint)
    rendering = Rendering(stiffness, stiffness / (2.0 * np.pi * RENDERED_CORNER_HZ))
    still = Signal("file", amplitude=0.0, table=np.zeros((1, 2)))
    return Setting(conditions, still, _motion(conditions, joint), duration=2.0, rendering=rendering)


def _current_loop(conditions: Conditions, joint: Joint) -> Setting:
    """Return levels of motor torque that a voltage drive follows by its own current controller."""
    drive = conditions.drive if conditions.drive in ("rl", "dq") else "dq"
    fast = replace(conditions, drive=drive, dt_control=CURRENT_STEP, dt_physics=CURRENT_STEP / 4)
    reference = Signal("step", amplitude=conditions.amplitude, period=CURRENT_HOLD)
    return Setting(fast, reference, duration=0.5, of_motor=True)


SUMMARIES = {
    "step": f"random levels of torque, held for {STEP_HOLD:g} s",
    "chirp": "a sweep of the torque to 20 Hz and back",
    "multisine": "twelve tones of torque from 0.5 to 20 Hz",
    "smooth": "random levels of torque, joined smoothly",
}
BENCHMARK_TASKS: dict[str, Task] = {
    row.name: row
    for row in (
        *(Task(name, SUMMARIES[name], _tracking(name)) for name in TASKS),
        Task("reversal", "slow ramps of the torque up and down through zero", _reversal),
        Task(
            "load_motion",
            "smooth levels while the output is moved from outside",
            _load_motion,
            "spring",
        ),
        Task("contact", "the load meets a wall and pushes against it", _contact, "free_load"),
        Task(
            "impedance",
            "the output is moved and should feel like a soft spring with a damper",
            _impedance,
            "spring",
            classical_only=True,
        ),
        Task(
            "current_loop",
            "levels of the motor's torque, which the current controller of a voltage drive follows",
            _current_loop,
            classical_only=True,
            open_loop_only=True,
        ),
    )
}
for _name, _row in installed_rows("tasks", BENCHMARK_TASKS):
    BENCHMARK_TASKS[_name] = _row


def get_task(name: str) -> Task:
    """Return the row of that name.

    Raises:
        UnknownNameError: There is none; the message suggests the nearest.
    """
    check_name("task", name, BENCHMARK_TASKS)
    return BENCHMARK_TASKS[name]
