"""A trained policy as plain matrix products: what a control loop at a kilohertz can afford."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from cjt_gym.envs.core import Episodes
from cjt_gym.errors import ConfigurationError
from cjt_gym.plant import limits_of
from cjt_gym.training.deploy.base import base_law
from cjt_gym.training.deploy.exported import Exported
from cjt_gym.training.deploy.network import Layer, Network
from cjt_gym.training.learning.algorithms import observation_scaling
from cjt_gym.training.learning.config import environment_arguments
from cjt_gym.training.learning.policy import PolicyAgent

Floats = NDArray[np.float32]
NAMES: dict[type[torch.nn.Module], str] = {
    torch.nn.Tanh: "tanh",
    torch.nn.ReLU: "relu",
    torch.nn.ELU: "elu",
}


def fast_policy(agent: PolicyAgent) -> Callable[[Floats], Floats]:
    """Return the deterministic policy of an agent as a function of one observation.

    From shape (size,) to (1,), it gives what `agent.act` gives, without torch's overhead. A network
    that is not a chain of linear layers and known activations goes through torch as before.
    """
    network = network_of(agent)
    if network is None:
        return lambda observation: np.asarray(agent.act(observation[None])[0], np.float32)
    return network.act


def exported(agent: PolicyAgent | Exported) -> Exported:
    """Return a trained policy without what trained it."""
    if isinstance(agent, Exported):
        return agent
    network = network_of(agent)
    if network is None:
        raise ConfigurationError(
            f"The policy {agent.name} cannot be exported: its network is not a chain of linear "
            f"layers with {', '.join(NAMES.values())}, as that of {agent.config.algorithm} with "
            "these options. PPO, SAC and TQC with an MLP can be."
        )
    settings = Episodes(1, **environment_arguments(agent.config.env)).settings
    try:
        base = base_law(agent.config, settings)
    except ConfigurationError:  # a law that cannot be written; reported where one is needed
        base = None
    limit = limits_of(settings.joint).tau
    return Exported(agent.name, agent.config, agent.layout, network, base, limit)


def network_of(agent: PolicyAgent) -> Network | None:
    """Return the network of a policy, None where it is not such a chain."""
    layers = _layers(agent.model)
    if layers is None:
        return None
    size = int(np.prod(agent.model.observation_space.shape or ()))
    if agent.normalizer is None:
        one = np.ones(size, np.float32)
        return Network(layers, 0.0 * one, one, float(np.finfo(np.float32).max))
    mean, scale = observation_scaling(agent.normalizer)
    clip = float(agent.normalizer.clip_obs)
    return Network(layers, mean.astype(np.float32), scale.astype(np.float32), clip)


def _layers(model: Any) -> tuple[Layer, ...] | None:
    """Return the layers of a policy, None where it is not such a chain."""
    policy = model.policy
    if hasattr(policy, "lstm_actor"):
        return None
    if hasattr(policy, "mlp_extractor"):  # PPO, A2C
        if getattr(policy, "use_sde", False) or policy.squash_output:
            return None
        chain = [*policy.mlp_extractor.policy_net, policy.action_net]
    else:  # SAC, TQC
        if policy.actor.use_sde:
            return None
        chain = [*policy.actor.latent_pi, policy.actor.mu, torch.nn.Tanh()]
    layers: list[Layer] = []
    for module in chain:
        if isinstance(module, torch.nn.Linear):
            weight, bias = (x.detach().numpy().copy() for x in (module.weight, module.bias))
            layers.append(Layer(weight, bias, "none"))
        elif type(module) in NAMES and layers and layers[-1].activation == "none":
            layers[-1] = Layer(layers[-1].weight, layers[-1].bias, NAMES[type(module)])
        else:
            return None
    return tuple(layers)
