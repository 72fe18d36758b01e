"""An exported policy: the network, its observation, and how it was trained, in one file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final, final

import numpy as np
from numpy.typing import NDArray

from cjt_gym.disk import parse_json, parsing, whole
from cjt_gym.disk.arrays import read_arrays
from cjt_gym.errors import CjtGymError, ConfigurationError, MissingFileError
from cjt_gym.joint.compiled import threaded
from cjt_gym.training.conditions import Conditions
from cjt_gym.training.config import TrainConfig, from_dict
from cjt_gym.training.deploy.layout import LIMIT, Layout, observe
from cjt_gym.training.deploy.network import Layer, Network, run_layers
from cjt_gym.training.policy_arguments import kind_of, policy_arguments, trained_on

KIND: Final = "cjt_gym policy"
SCHEMA: Final = 1
Floats = NDArray[np.float64]


@final
@dataclass(frozen=True)
class Exported:
    """A policy that needs no torch. It is an agent wherever a run folder is one.

    Attributes:
        name: Its name in tables.
        config: How it was trained.
        network: Its numbers.
        layout: What its observation is made of.

    Raises:
        ConfigurationError: The network does not take what the layout makes, or gives more than one
            action.
    """

    name: str
    config: TrainConfig
    network: Network
    layout: Layout

    def __post_init__(self) -> None:
        layout, network = self.layout, self.network
        made, taken = layout.size + len(layout.joint_numbers), len(network.mean)
        if made != taken:
            raise ConfigurationError(
                f"The network of the policy {self.name} takes {taken} numbers, its layout makes "
                f"{made}. Export it anew."
            )
        outputs = len(network.layers[-1].bias)
        if outputs != 1:
            raise ConfigurationError(
                f"The network of the policy {self.name} must give one action, got {outputs}. "
                "Export it anew."
            )

    @cached_property
    def on_its_joint(self) -> Network:
        """The network on the joint of the layout, whose numbers are no input any more."""
        return self.network.with_end(np.clip(self.layout.joint_numbers, -LIMIT, LIMIT).tolist())

    @property
    def kind(self) -> str:
        """Either "residual", on a base controller, or "learned"."""
        return kind_of(self.config)

    @property
    def renders(self) -> bool:
        """False: it follows a torque."""
        return False

    @property
    def trained_on(self) -> tuple[str, str]:
        """Joint and structure that it was trained on."""
        return trained_on(self.config)

    def arguments(self, conditions: Conditions) -> dict[str, Any]:
        """Return the conditions with the observation and the action that it was trained with.

        Raises:
            ConfigurationError: The control step is another one.
        """
        return policy_arguments(self.name, self.config, self.layout, conditions)

    def act(self, observation: NDArray[np.float32]) -> NDArray[Any]:
        """Return the deterministic actions, shape (episodes, 1)."""
        return np.array([self.network.act(row) for row in observation])

    def begin(self) -> None:
        """Nothing is remembered."""


@threaded
def run_step(
    plan: NDArray[np.int64],
    numbers: NDArray[np.float32],
    clip: float,
    work: NDArray[np.float32],
    scales: Floats,
    reference: Floats,
    tau: float,
    q_m: float,
    dq_m: float,
    dq_l: float,
    command: float,
    begun: bool,
    observation: NDArray[np.float32],
) -> float:
    """Observe and return the action; see `observe` and `run_layers`."""
    observe(scales, reference, tau, q_m, dq_m, dq_l, command, begun, observation)
    return float(work[run_layers(plan, numbers, observation, clip, work), 0])


@final
class Stepper:
    """A policy at work: measurements in, motor torque out, its history inside.

    Example:
        stepper = Stepper(load_exported("policy.npz"))
        torque = base + stepper.step([reference], tau, q_m, dq_m, dq_l, command)
    """

    def __init__(self, policy: Exported) -> None:
        """Begin an episode."""
        layout, network = policy.layout, policy.on_its_joint
        self.policy = policy
        self._fixed = (*network.packed[:2], network.clip, network.packed[2])
        self._scales = np.array([layout.torque, layout.velocity, layout.n])
        self._reference = np.zeros(layout.preview + 1)
        self._observation = np.zeros(layout.size, dtype=np.float32)
        self.reset()

    def reset(self) -> None:
        """Forget the past; the next step is the first."""
        self._begun = False

    def step(
        self,
        reference: Sequence[float],
        tau: float,
        q_m: float,
        dq_m: float,
        dq_l: float,
        command: float,
    ) -> float:
        """Return the motor torque, to be added to that of the base controller, if any [N m].

        Args:
            reference: Wanted joint torque now and at the next steps, shape (preview + 1,) [N m].
            tau: Measured joint torque [N m].
            q_m: Measured motor angle, rotor angle / n [rad].
            dq_m: Measured motor velocity [rad/s].
            dq_l: Measured load velocity [rad/s].
            command: Motor torque that was commanded in the step before; 0 in the first [N m].
        """
        self._reference[:] = reference
        numbers = (float(tau), float(q_m), float(dq_m), float(dq_l), float(command))  # one type
        action = run_step(
            *self._fixed, self._scales, self._reference, *numbers, self._begun, self._observation
        )
        self._begun = True
        return float(action) * self.policy.layout.action


def facts_of(policy: Exported) -> dict[str, Any]:
    """Return what is known of a policy beside its numbers, as plain data."""
    return {
        "kind": KIND,
        "schema": SCHEMA,
        "name": policy.name,
        "config": policy.config.to_dict(),
        "layout": asdict(policy.layout),
        "clip": policy.network.clip,
        "activations": [layer.activation for layer in policy.network.layers],
    }


def save_exported(policy: Exported, path: str | Path) -> Path:
    """Write a policy as NPZ and return its path."""
    network = policy.network
    arrays: dict[str, Any] = {"mean": network.mean, "scale": network.scale}
    for k, layer in enumerate(network.layers):
        arrays |= {f"weight_{k}": layer.weight, f"bias_{k}": layer.bias}
    with whole(path) as part, part.open("wb") as file:
        np.savez(file, facts=np.array(json.dumps(facts_of(policy))), **arrays)
    return Path(path)


def load_exported(path: str | Path) -> Exported:
    """Read a policy that `save_exported` wrote; nothing but numbers and texts is taken from it.

    Raises:
        MissingFileError: There is no such file.
        ConfigurationError: It is not a policy of ours.
    """
    file = Path(path)
    if not file.is_file():
        raise MissingFileError(
            f"The policy {path} does not exist. Make one:  "
            f"cjt-gym export RUN --to numpy --out {path}"
        )
    try:
        return _parsed(file)
    except CjtGymError as error:
        raise ConfigurationError(
            f"{path} is not a policy that cjt-gym exported: {error} Make one:  "
            "cjt-gym export RUN --to numpy --out policy.npz"
        ) from error


def _parsed(file: Path) -> Exported:
    given = read_arrays(file, ConfigurationError)
    with parsing("its facts must be those of a policy", ConfigurationError):
        facts = parse_json(str(given["facts"]), "facts", ConfigurationError)
        if facts["kind"] != KIND:
            raise KeyError("kind")
        layers = tuple(
            Layer(given[f"weight_{k}"], given[f"bias_{k}"], activation)
            for k, activation in enumerate(facts["activations"])
        )
        network = Network(layers, given["mean"], given["scale"], float(facts["clip"]))
        config = from_dict(facts["config"], str(file))
        return Exported(file.stem, config, network, Layout(**facts["layout"]))
