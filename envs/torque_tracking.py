"""The torque-tracking environment."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from cjt_gym.envs.arguments import argument_table, takes_arguments
from cjt_gym.envs.core import Episodes
from cjt_gym.envs.observation import PAST, PRESENT, ROWS, observation_table, with_tables
from cjt_gym.envs.observe import REPORT
from cjt_gym.envs.strip_chart import RENDER_MODES, StripChart

Observation = NDArray[np.float32]
Action = NDArray[np.float32]
PLACES = (
    *("0 .. preview", *(f"preview + {k + 1}" for k in range(PRESENT))),
    *("then, newest first, `history` times", *[""] * (PAST - 1)),
)


@with_tables(
    arguments=argument_table(),
    observation=observation_table(PLACES, ROWS),
)
@takes_arguments
class TorqueTrackingEnv(gym.Env[Observation, Action]):
    """Make the torque of a compliant joint follow a reference.

    ## Description

    A motor drives a load through a gear and a torsion bar; the twist of the bar is the joint
    torque. Friction, ripple, delay, noise and quantization stand between the motor's command
    and that torque. The agent commands the motor's torque, alone or on top of a controller,
    once per control step.

    ## Action space

    `Box(-1, 1, (1,), float32)`: the motor torque divided by `action_scale`. With a
    `base_controller` the action is added to the controller's torque; the sum is limited to the
    peak torque k_t n i_p.

    ## Observation space

    `Box(-5, 5, (preview + 4 + 4 history,), float32)`, made only of what a real joint
    measures, and four more with `observe_joint`; each divided by its scale and clipped.

    {observation}

    With `observe_joint`, four numbers of the joint's datasheet end the observation, for policies
    that suit many joints: ln(f / 20 Hz) and (20 Hz / f)^2 with the frequency f of
    motor and gear on the spring, and Coulomb friction and noise of the torque sensor over
    `torque_amplitude`. They are those of the joint file, whatever is randomised.

    The commands of the past keep a delayed joint Markovian: `history` is at least the delay.

    ## Reward

    The sum of these terms, each with its weight (`reward_weights`); e is the error of the true
    joint torque and u the commanded motor torque, both divided by `torque_amplitude`.

    | Term | Value | Weight |
    |---|---|---|
    | `tracking` | -abs(e) | 1 |
    | `precision` | -ln(1 + 20 abs(e)) / ln(21) | 0 |
    | `smoothness` | -(u - u before)^2 | 0.05 |
    | `effort` | -u^2 | 0 |
    | `safety` | -1 if the episode terminates | 50 |

    `reward` is a function of a mapping with the keys of a step's information and `terminated`, each
    an array of shape (num,); it returns the rewards, shape (num,). A single environment is a batch
    of one.

    `precision` is for tasks whose errors differ a lot: halving an error is worth about the same in
    each, down to 5 % of the amplitude.

    ## Starting state

    At rest, with the spring relaxed, at a random angle; a reference, a disturbance and
    randomised parameters are drawn. `reset(options={"parameters": {"k_b": 5000.0}})` fixes exact
    parameters, without randomisation, until the next call of `reset`.

    ## Episode end

    Termination, for safety: the motor is faster than its peak speed dq_p, or the joint torque
    exceeds twice the peak motor torque. Truncation: after `episode_steps` control steps.

    ## Information

    Each step gives `tau` (true joint torque), `tau_measured`, `tau_reference`, `tau_command`,
    `base_action`, `residual` [N m] and `reward/<term>`; reset gives `parameters`, those that
    were drawn or fixed, and so does a step before which some were redrawn. A batch adds the
    mask `_parameters` of the members to which this applies.

    ## Arguments

    {arguments}
    | `render_mode` | None | "human" or "rgb_array": a strip chart |

    Without `torque_amplitude` it is a tenth of the peak torque k_t n i_p, or three times the
    dry friction of motor and gear where that is more, by all that the joint file states of it:
    Coulomb levels under its parameters or effects, breakaway and presliding. Where the output is
    free and the joint file describes the bare actuator, the load is ten times I_m + I_g, unless
    `parameters` gives I_l.

    A drive that takes voltages has a current controller between torque and voltage: that of the
    effect `current_control`, or a typical one of 500 Hz.

    ## Randomisation

    `randomization` varies any base parameter ("k_b") and any scalar parameter of an active effect
    ("coulomb.d_cm"): {name: (low, high)} draws factors at each reset; a mapping with the keys of
    `Variation` chooses distribution ("uniform", "log_uniform", "normal", "choice"), operation
    ("scale", "add", "set"), time ("reset", "once", "interval", "drift") and group. "mild" and
    "wide" vary everything that acts, "identified" what the joint file gives a tolerance to;
    {"preset": "mild", name: variation} changes a preset.

    ## Version history

    * v0: first version.

    Raises:
        UnknownNameError: A name is not known; the message suggests the nearest.
        ConfigurationError: A number is out of its range.
        ParameterError: The joint lacks what is asked of it.
    """

    metadata: dict[str, Any] = {"render_modes": list(RENDER_MODES), "render_fps": 20}  # noqa: RUF012

    def __init__(self, render_mode: str | None = None, **arguments: Any) -> None:
        self.episodes = Episodes(1, **arguments)
        self.observation_space = self.episodes.observation_space
        self.action_space = self.episodes.action_space
        self.render_mode = render_mode
        self._chart = StripChart(render_mode, self.episodes.settings.layout.dt)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode; see the class for the options."""
        first = self._np_random is None
        super().reset(seed=seed)
        self.episodes.seed(seed, self.np_random if first else None)
        self.episodes.reset(options)
        self._chart.clear()
        return self.episodes.task.observation[0].copy(), {"parameters": self._parameters()}

    def step(self, action: Action) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Advance by one control step.

        Raises:
            ConfigurationError: The action has the wrong shape or is not finite.
            SimulationError: The state ceased to be finite.
        """
        episodes, task = self.episodes, self.episodes.task
        if getattr(action, "shape", None) == (1,) and action.dtype.kind == "f":
            episodes.step_one(float(action[0]))
        else:
            episodes.step(np.asarray(action).reshape(1, -1))
        info: dict[str, Any] = dict(zip(REPORT, episodes.control.report[0].tolist()))  # noqa: B905
        if self.render_mode is not None:
            self._chart.add(info["tau_reference"], info["tau"], info["tau_command"])
        if episodes.plant.changed[0]:
            info["parameters"] = self._parameters()
        return (
            task.observation[0].copy(),
            task.reward.item(),
            task.terminated.item(),
            task.truncated.item(),
            info,
        )

    def _parameters(self) -> dict[str, float]:
        return {name: float(values[0]) for name, values in self.episodes.plant.drawn().items()}

    def render(self) -> Any:
        """Return the strip chart as an image, shape (height, width, 3), for "rgb_array"."""
        return self._chart.render()

    def close(self) -> None:
        """Close the strip chart."""
        self._chart.close()
