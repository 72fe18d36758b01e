"""An exported policy: network, observation, base controller and training, in one file."""

from __future__ import annotations

import json
import math
import os
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final, final

import numpy as np
from numpy.typing import NDArray

from cjt_gym.baselines.linear_law import INPUTS
from cjt_gym.disk import parse_json, parsing, whole
from cjt_gym.disk.arrays import read_arrays
from cjt_gym.envs.observation import CLIP, ROWS, Layout
from cjt_gym.errors import CjtGymError, ConfigurationError, MissingFileError
from cjt_gym.training.deploy.base import BaseLaw, read_base
from cjt_gym.training.deploy.network import Layer, Network
from cjt_gym.training.learning.config import TrainConfig, from_dict
from cjt_gym.training.learning.policy_arguments import Trained

KIND: Final = "cjt_gym policy"
SCHEMA: Final = 2


@final
@dataclass(frozen=True)
class Exported(Trained):
    """A policy that needs no torch. It is an agent wherever a run folder is one."""

    name: str  # its name in tables
    config: TrainConfig  # how it was trained
    layout: Layout  # what its observation is made of
    network: Network  # its numbers
    # the controller that it adds to; None where there is none, or none that can be written as
    # numbers
    base: BaseLaw | None = None
    limit: float = math.inf  # largest motor torque that is commanded [N m]

    def __post_init__(self) -> None:
        layout, network = self.layout, self.network
        made, taken = layout.size + len(layout.joint_numbers), len(network.mean)
        if made != taken:
            raise ConfigurationError(
                f"The network of the policy {self.name} takes {taken} numbers, its layout makes "
                f"{made}. Export it again."
            )
        outputs = len(network.layers[-1].bias)
        if outputs != 1:
            raise ConfigurationError(
                f"The network of the policy {self.name} must give one action, got {outputs}. "
                "Export it again."
            )

    @cached_property
    def on_its_joint(self) -> Network:
        """The network on the joint of the layout, whose numbers are no input any more."""
        return self.network.with_end(np.clip(self.layout.joint_numbers, -CLIP, CLIP).tolist())

    @cached_property
    def uses(self) -> frozenset[str]:
        """The names of the inputs that it needs; the others may be zero."""
        places = zip(self.layout.names(), self.on_its_joint.scale, strict=True)
        used = {one for name, weight in places if weight != 0.0 for one in ROWS[name].of}
        return frozenset(used | (self.base.uses if self.base else set()))

    def check_whole(self, form: str, linear: bool = True) -> None:
        """Refuse to be a controller by itself where the base controller is missing."""
        base = self.base
        if self.kind == "learned" or (base is not None and (base.is_linear or not linear)):
            return
        remedy = "run it with  cjt-gym hardware --policy  from its run folder or its NumPy file"
        if base is not None:
            remedy = f"export it with --to c, or {remedy}"
        raise ConfigurationError(
            f"The policy {self.name} adds to the controller {self.config.env['base_controller']}, "
            f"which is not a linear law that {form} can hold: {remedy}."
        )

    def act(self, observation: NDArray[np.float32]) -> NDArray[Any]:
        """Return the deterministic actions, shape (episodes, 1)."""
        return np.array([self.network.act(row) for row in observation])

    def begin(self) -> None:
        """Nothing is remembered."""


def facts_of(policy: Exported) -> dict[str, Any]:
    """Return what is known of a policy beside its numbers, as plain data."""
    limit = policy.limit if math.isfinite(policy.limit) else None
    inputs = [
        {
            "name": name,
            "unit": unit,
            "what": what,
            "size": policy.layout.preview + 1 if name == "reference" else 1,
            "used": name in policy.uses,
        }
        for name, (unit, what) in INPUTS.items()
    ]
    output = "motor torque to command, at the output side of the gear"
    return {
        "kind": KIND,
        "schema": SCHEMA,
        "name": policy.name,
        "config": policy.config.to_dict(),
        "layout": asdict(policy.layout),
        "clip": policy.network.clip,
        "activations": [layer.activation for layer in policy.network.layers],
        "base": None if policy.base is None else policy.base.facts(),
        "limit": limit,
        "inputs": inputs,
        "output": {"name": "torque", "unit": "N m", "what": output, "limit": limit},
    }


def save_exported(policy: Exported, path: str | Path) -> Path:
    """Write a policy as NPZ and return its path."""
    network = policy.network
    arrays: dict[str, Any] = {"mean": network.mean, "scale": network.scale}
    for k, layer in enumerate(network.layers):
        arrays |= {f"weight_{k}": layer.weight, f"bias_{k}": layer.bias}
    if policy.base is not None and policy.base.is_linear:
        arrays |= policy.base.arrays()
    with whole(path) as part, part.open("wb") as file:
        np.savez(file, facts=np.array(json.dumps(facts_of(policy))), **arrays)
    return Path(path)


def load_exported(path: str | Path) -> Exported:
    """Read a policy that `save_exported` wrote; nothing but numbers and texts is taken from it."""
    file = Path(path)
    if not os.path.isfile(file):
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
        layout, given_limit = Layout(**facts["layout"]), facts.get("limit")
        limit = math.inf if given_limit is None else float(given_limit)
        base = read_base(facts.get("base"), given)
        return Exported(file.stem, config, layout, network, base, limit)
