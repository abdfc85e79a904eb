"""One spring-leg world as a Gymnasium environment."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from romgrl.rom.parameters import Commands, Reward, SpringLegParameters
from romgrl.rom.vector_env import SpringLegVectorEnv, VariableLegVectorEnv, refuse_options

Array = NDArray[Any]

_METADATA: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 30}


class SpringLegEnv(gymnasium.Env[Array, Array]):
    """World 0 of `SpringLegVectorEnv`, with the same episodes for the same seed; see there for spaces and units."""

    metadata = _METADATA
    worlds = SpringLegVectorEnv

    def __init__(
        self,
        *,
        parameters: SpringLegParameters | None = None,
        speed: float | Commands = 4.0,
        control_frequency: float = 30.0,
        episode_steps: int = 400,
        reward: Reward = "exponential",
        alpha: float = 1.0,
        work_cost: float = 0.0,
        render_mode: str | None = None,
    ) -> None:
        self._worlds = self.worlds(
            parameters=parameters,
            num_envs=1,
            speed=speed,
            control_frequency=control_frequency,
            episode_steps=episode_steps,
            reward=reward,
            alpha=alpha,
            work_cost=work_cost,
            render_mode=render_mode,
        )
        self.render_mode = render_mode
        self.metadata = {**_METADATA, "render_fps": round(control_frequency)}
        self.observation_space = self._worlds.single_observation_space
        self.action_space = self._worlds.single_action_space
        self.observation_names = self._worlds.observation_names
        self.mirror_observation = self._worlds.mirror_observation
        self.mirror_action = self._worlds.mirror_action
        self.parameters = self._worlds.parameters
        self._waiting = False  # the world is already at the start of the next episode

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Start an episode; see `SpringLegVectorEnv.reset`."""
        refuse_options(options)
        super().reset(seed=seed)
        if seed is not None or not self._waiting:
            observation, info = self._worlds.reset(seed=seed)
        else:
            observation, info = self._worlds.restore(self._worlds.save())
        self._waiting = False
        return observation[0].copy(), _row(info)

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """One control step; action finite."""
        _, reward, terminated, truncated, info = self._worlds.step(np.asarray(action, np.float32)[None])
        done = bool(terminated[0]), bool(truncated[0])
        if any(done):
            self._waiting = True
        return info["final_obs"][0].copy(), float(reward[0]), *done, _row(info)

    def render(self) -> NDArray[np.uint8] | None:
        """The state as a (360, 640, 3) image, or None without a render mode."""
        images = self._worlds.render()
        return None if images is None else images[0]


class VariableLegEnv(SpringLegEnv):
    """World 0 of `VariableLegVectorEnv`."""

    worlds = VariableLegVectorEnv


def _row(info: dict[str, Any]) -> dict[str, Any]:
    """World 0 of the arrays of a vector environment, copied; what only an autoreset needs is left out."""
    return {key: value[0].copy() for key, value in info.items() if key not in ("final_obs", "reset_features")}
