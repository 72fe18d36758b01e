"""A MuJoCo model with our actuators in its joints, stepped together."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cjt_gym.errors import ConfigurationError, check_name
from cjt_gym.joint import Joint
from cjt_gym.plant import Measurement
from cjt_gym.plant.randomization import Randomization
from cjt_gym.plant.simulated import DT_PHYSICS
from cjt_gym.robots.models import mujoco
from cjt_gym.robots.port import Port


class CoupledRobot:
    """A MuJoCo model, some joints of which are moved by compliant actuators.

    Rotor, gear and spring are those of the `Joint`; what MuJoCo's joint moves is the load. The
    time step of the model is the control step of the actuators; see `cjt_gym.robots.port` for
    how the two are stepped together. The joints that are moved should have no armature and no
    actuator of their own in the model.

    Attributes:
        model: A copy of the given model, with the inertia at the output of the actuators.
        data: Its state.
        ports: One per actuator, by the name of MuJoCo's joint.
    """

    def __init__(
        self,
        model: Any,
        actuators: Mapping[str, Joint],
        dt_physics: float = DT_PHYSICS,
        randomization: Randomization = None,
    ) -> None:
        """Put actuators into a model.

        Args:
            model: A `mujoco.MjModel`, integrated with Euler, implicit or implicitfast.
            actuators: Joints with a fixed output, by the name of MuJoCo's joint.
            dt_physics: Substep of the actuators [s]; the time step is a whole multiple of it.
            randomization: What varies in all actuators from one reset to the next.

        Raises:
            ConfigurationError: Integrator, time steps or joints do not fit together.
            UnknownNameError: The model has no joint of that name.
        """
        api = mujoco()
        kinds = api.mjtIntegrator
        good = (kinds.mjINT_EULER, kinds.mjINT_IMPLICIT, kinds.mjINT_IMPLICITFAST)
        if int(model.opt.integrator) not in [int(kind) for kind in good]:
            raise ConfigurationError(
                "The integrator of a model with actuators must be Euler, implicit or implicitfast, "
                f"got {kinds(model.opt.integrator).name}. Set it in <option integrator=...>."
            )
        self.model = copy.copy(model)
        self.data = api.MjData(self.model)
        dt = float(model.opt.timestep)
        self.ports = {
            name: Port(joint, dt, dt_physics, randomization) for name, joint in actuators.items()
        }
        at = [_hinge(api, model, name) for name in actuators]
        self._dof = np.array([dof for dof, _ in at], dtype=np.int64)
        self._angle = np.array([angle for _, angle in at], dtype=np.int64)
        self._armature = model.dof_armature[self._dof].copy()
        own = [joint.parameters.get("d_l", 0.0) for joint in actuators.values()]
        self.model.dof_damping[self._dof] += own
        self.reset()

    @property
    def dt(self) -> float:
        """Time step of model and actuators [s]."""
        return float(self.model.opt.timestep)

    def reset(
        self, angles: Mapping[str, float] | None = None, seed: int | None = None
    ) -> list[Measurement]:
        """Start at rest, with relaxed springs, and measure.

        Args:
            angles: Angles of MuJoCo's joints by name [rad]; others stand as in the model.
            seed: Seed of the first actuator's noise and draws; the others count on from it.

        Raises:
            UnknownNameError: The model has no joint of that name.
        """
        api = mujoco()
        at = {_hinge(api, self.model, name)[1]: q for name, q in (angles or {}).items()}
        api.mj_resetData(self.model, self.data)
        for index, angle in at.items():
            self.data.qpos[index] = angle
        measured = [
            port.reset(q, 0.0, None if seed is None else seed + k)
            for k, (port, q) in enumerate(
                zip(self.ports.values(), self.data.qpos[self._angle].tolist(), strict=True)
            )
        ]
        inertia = [port.inertia for port in self.ports.values()]
        self.model.dof_armature[self._dof] = self._armature + inertia
        api.mj_setConst(self.model, api.MjData(self.model))  # bodies of one joint keep it there
        api.mj_forward(self.model, self.data)
        return measured

    def step(self, command: ArrayLike | Sequence[float]) -> list[Measurement]:
        """Advance robot and actuators by one time step.

        Args:
            command: Motor torques [N m], shape (actuators,); they are clipped to the limits.

        Returns:
            What each actuator measures, in the order they were given.

        Raises:
            ConfigurationError: The command has the wrong shape.
            SimulationError: A state ceased to be finite.
        """
        wanted = np.asarray(command, dtype=np.float64)
        if wanted.shape != (len(self.ports),):
            raise ConfigurationError(
                f"The command must hold one motor torque [N m] for each of "
                f"{', '.join(self.ports)}, shape ({len(self.ports)},), got {wanted.shape}."
            )
        before = self.data.qvel[self._dof].tolist()
        ports = list(self.ports.values())
        self.data.qfrc_applied[self._dof] = [
            port.push(dq) for port, dq in zip(ports, before, strict=True)
        ]
        mujoco().mj_step(self.model, self.data)
        after = self.data.qvel[self._dof].tolist()
        rows = zip(ports, before, after, wanted.tolist(), strict=True)
        return [port.move(dq, dq_next, tau) for port, dq, dq_next, tau in rows]


def _hinge(api: Any, model: Any, name: str) -> tuple[int, int]:
    """Return where the velocity and the angle of a joint with one degree of freedom stand."""
    joints = [model.joint(k) for k in range(model.njnt)]
    named = {joint.name: joint for joint in joints}
    check_name("joint of the MuJoCo model", name, named)
    kinds = (int(api.mjtJoint.mjJNT_HINGE), int(api.mjtJoint.mjJNT_SLIDE))
    if int(named[name].type[0]) not in kinds:
        raise ConfigurationError(
            f"Joint {name} of the MuJoCo model must be a hinge or a slide to hold an actuator."
        )
    return int(named[name].dofadr[0]), int(named[name].qposadr[0])
