"""A trained policy as plain matrix products: what a control loop at a kilohertz can afford."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from cjt_gym.training.policy import PolicyAgent

Floats = NDArray[np.float32]
ACTIVATIONS: dict[type[torch.nn.Module], Callable[[Floats], Floats]] = {
    torch.nn.Tanh: np.tanh,
    torch.nn.ReLU: lambda x: np.maximum(x, np.float32(0.0)),
}
Layer = tuple[Floats, Floats, Callable[[Floats], Floats] | None]


def fast_policy(agent: PolicyAgent) -> Callable[[Floats], Floats]:
    """Return the deterministic policy of an agent as a function of one observation.

    It gives what `agent.act` gives, without torch's overhead. A network that is not a chain of
    linear layers and known activations goes through torch as before.

    Args:
        agent: The policy.

    Returns:
        Function from an observation, shape (size,), to the action, shape (1,).
    """
    layers = _layers(agent.model)
    if layers is None:
        return lambda observation: np.asarray(agent.act(observation[None])[0], np.float32)
    mean, scale, clip = _scaling(agent)

    def act(observation: Floats) -> Floats:
        x = np.clip((observation - mean) * scale, -clip, clip)
        for weight, bias, activation in layers:
            x = weight @ x + bias
            if activation is not None:
                x = activation(x)
        return np.asarray(np.clip(x, -1.0, 1.0), dtype=np.float32)

    return act


def _scaling(agent: PolicyAgent) -> tuple[Floats, Floats, np.float32]:
    """Return what observations are shifted, scaled and clipped by."""
    if agent.normalizer is None:
        return np.float32(0.0), np.float32(1.0), np.float32(np.inf)  # type: ignore[return-value]
    statistics: Any = agent.normalizer.obs_rms
    scale = 1.0 / np.sqrt(statistics.var + agent.normalizer.epsilon)
    clip = np.float32(agent.normalizer.clip_obs)
    return statistics.mean.astype(np.float32), scale.astype(np.float32), clip


def _layers(model: Any) -> list[Layer] | None:
    """Return the layers of a policy, None where it is not such a chain."""
    policy = model.policy
    if hasattr(policy, "mlp_extractor"):  # PPO, A2C
        if getattr(policy, "use_sde", False) or policy.squash_output:
            return None
        chain = [*policy.mlp_extractor.policy_net, policy.action_net]
    else:  # SAC
        if policy.actor.use_sde:
            return None
        chain = [*policy.actor.latent_pi, policy.actor.mu, torch.nn.Tanh()]
    layers: list[Layer] = []
    for module in chain:
        if isinstance(module, torch.nn.Linear):
            weight = module.weight.detach().numpy().copy()
            layers.append((weight, module.bias.detach().numpy().copy(), None))
        elif type(module) in ACTIVATIONS and layers and layers[-1][2] is None:
            layers[-1] = (*layers[-1][:2], ACTIVATIONS[type(module)])
        else:
            return None
    return layers
