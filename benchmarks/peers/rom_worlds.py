"""The project's reduced-order model as the peers want their environments."""

from __future__ import annotations

from typing import Any

import numpy as np
from stable_baselines3.common.vec_env import VecEnv

from romgrl.rom.parameters import SpringLegParameters
from romgrl.rom.vector_env import SpringLegVectorEnv


def make(settings: dict[str, Any], num_envs: int) -> SpringLegVectorEnv:
    """The worlds that the teacher trains in."""
    values = {name: tuple(v) if isinstance(v, list) else v for name, v in settings["parameters"].items()}
    return SpringLegVectorEnv(
        parameters=SpringLegParameters(**values),
        num_envs=num_envs,
        speed=settings["speed"],
        alpha=settings["alpha"],
        episode_steps=settings["episode_steps"],
        num_threads=settings["threads"],
    )


class SB3Worlds(VecEnv):
    """Stable-Baselines3's VecEnv over the vector environment; arrays are copied because those here are reused."""

    def __init__(self, env: SpringLegVectorEnv) -> None:
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)
        self.env = env

    def reset(self) -> Any:
        """All worlds anew."""
        return self.env.reset(seed=0)[0].copy()

    def step_async(self, actions: Any) -> None:
        """Keep the actions for `step_wait`."""
        self.actions = actions

    def step_wait(self) -> Any:
        """One control step."""
        observation, reward, terminated, truncated, info = self.env.step(self.actions.astype(np.float32))
        done = terminated | truncated
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for row in np.flatnonzero(done):
            last = info["final_obs"][row].copy()
            infos[row] = {"terminal_observation": last, "TimeLimit.truncated": bool(truncated[row])}
        return observation.copy(), reward.copy(), done, infos

    def close(self) -> None:
        """Nothing to free."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """One value per world."""
        return [getattr(self.env, attr_name, None)] * self.num_envs

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Worlds have no attributes of their own."""

    def env_method(self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any) -> list[Any]:
        """Worlds have no methods of their own."""
        return [None] * self.num_envs

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """No wrappers."""
        return [False] * self.num_envs
