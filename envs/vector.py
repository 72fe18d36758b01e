"""A batch of torque-tracking environments for Gymnasium."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from cjt_gym.envs.arguments import takes_arguments
from cjt_gym.envs.core import Episodes
from cjt_gym.envs.strip_chart import StripChart
from cjt_gym.envs.torque_tracking import Action, Observation
from cjt_gym.errors import ConfigurationError, check_name

AUTORESET = {"same_step": AutoresetMode.SAME_STEP, "next_step": AutoresetMode.NEXT_STEP}
RENDER_MODE = "rgb_array"


@takes_arguments
class TorqueTrackingVectorEnv(VectorEnv[Observation, Action, NDArray[Any]]):
    """A batch of `TorqueTrackingEnv` in one compiled kernel, with the same arguments.

    Member i with seed s behaves exactly as a single environment with seed s + i. When an episode
    ends, `autoreset` says what follows:

    * "same_step", the default: the next one begins within the same step. The returned observation
      is its first, and `info["final_obs"]` holds the last one of the old episode.
    * "next_step": the returned observation is the last one of the old episode. The next step
      ignores the action of that member, begins its new episode and has no reward for it. Wrappers
      that follow the observations, such as `NormalizeObservation`, need this mode.

    With `render_mode="rgb_array"`, `render` returns a strip chart of every member.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        "render_modes": [RENDER_MODE],
        "render_fps": 20,
        "autoreset_mode": AutoresetMode.SAME_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
        render_mode: str | None = None,
        autoreset: str = "same_step",
        **arguments: Any,
    ) -> None:
        """Prepare the batch.

        Args:
            num_envs: How many.
            render_mode: "rgb_array", or None to draw nothing.
            autoreset: "same_step" or "next_step", see above.
            **arguments: Those of `TorqueTrackingEnv`, checked as there.

        Raises:
            ConfigurationError: `render_mode` is another one.
            UnknownNameError: `autoreset` is another one.
        """
        if render_mode not in (None, RENDER_MODE):
            raise ConfigurationError(
                f"render_mode of a batch must be {RENDER_MODE!r} or None, got {render_mode!r}. Use "
                "gymnasium.make for a single environment in a window."
            )
        check_name("autoreset", autoreset, AUTORESET)
        self.num_envs, self.render_mode = num_envs, render_mode
        self.metadata = {**self.metadata, "autoreset_mode": AUTORESET[autoreset]}
        self._waits = autoreset == "next_step"
        self._ended = np.zeros(num_envs, dtype=np.bool_)
        self.episodes = Episodes(num_envs, **arguments)
        dt, drawn = self.episodes.settings.layout.dt, num_envs if render_mode else 0
        self._charts = [StripChart(RENDER_MODE, dt) for _ in range(drawn)]
        self.single_observation_space = self.episodes.observation_space
        self.single_action_space = self.episodes.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin all episodes; member i gets seed + i."""
        first = self._np_random is None
        super().reset(seed=seed)
        self.episodes.seed(seed, self.np_random if first else None)
        self.episodes.reset(options)
        self._ended[:] = False
        for chart in self._charts:
            chart.clear()
        return self.episodes.task.observation.copy(), {"parameters": self.episodes.plant.drawn()}

    def step(
        self, actions: Action
    ) -> tuple[Observation, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Advance all members by one control step."""
        task, begun = self.episodes.task, self._ended.copy()
        self.episodes.step_or_begin(np.asarray(actions), begun)
        info: dict[str, Any] = self.episodes.info()
        terminated, truncated = task.terminated.copy(), task.truncated.copy()
        reward, done = task.reward.copy(), terminated | truncated
        self._draw(info, begun)
        if self._waits:
            self._ended = done
        elif done.any():
            info |= self._final(info, done)
            self.episodes.begin(done)
            begun = done
        told = self.episodes.plant.changed | begun
        if told.any() and self.episodes.settings.randomization:
            info |= {"parameters": self.episodes.plant.drawn(), "_parameters": told}
        return task.observation.copy(), reward, terminated, truncated, info

    def _final(self, info: dict[str, Any], done: NDArray[np.bool_]) -> dict[str, Any]:
        """Return the last observations and infos of the episodes that ended."""
        last = np.full(self.num_envs, None, dtype=object)
        for i in np.flatnonzero(done):
            last[i] = self.episodes.task.observation[i].copy()
        final_info = {key: np.where(done, values, 0.0) for key, values in info.items()}
        return {
            "final_obs": last,
            "_final_obs": done.copy(),
            "final_info": final_info,
            "_final_info": done.copy(),
        }

    def _draw(self, info: dict[str, Any], begun: NDArray[np.bool_]) -> None:
        for i, chart in enumerate(self._charts):
            if begun[i]:
                chart.clear()
            chart.add(info["tau_reference"][i], info["tau"][i], info["tau_command"][i])

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Return the strip charts, each of shape (height, width, 3); None unless they are drawn."""
        return tuple(chart.image() for chart in self._charts) or None
