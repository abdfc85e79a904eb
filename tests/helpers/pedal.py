"""A reduced-order model of other mechanics than the project's: feet on a crank, which one torque drives."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector.utils import batch_space

from romgrl.config.fields import key
from romgrl.config.worlds import Rom
from romgrl.gait.symmetry import by_name, left_or_right
from romgrl.rom.drawing import draw
from romgrl.rom.registry import ReducedOrderModel

NAMES = ("left_forward", "right_forward", "left_up", "right_up", "crank_rate")


@dataclass
class Pedal(Rom):
    """Two feet, half a turn apart, on a crank below the body; the lower one carries it forward."""

    crank: float = key("radius of the crank", unit="m", low=0.01, high=0.4)
    drive: float = key("angular acceleration at action 1", unit="rad/s^2", above=0, high=1000)


@dataclass(frozen=True)
class PedalParameters:
    """As in the configuration."""

    mass: float = 70.0
    leg_length: float = 0.9
    foot_radius: float = 0.07
    crank: float = 0.3
    drive: float = 20.0


def faults(parameters: PedalParameters, control_frequency: float) -> Iterator[tuple[str, str]]:
    """The feet do not reach the body."""
    if parameters.crank > parameters.leg_length / 2:
        yield "crank", "at most half of rom.leg_length"


class PedalVectorEnv:
    """State (N, 5): angle and rate of the crank, steps since reset, seed, resets so far."""

    def __init__(
        self,
        *,
        parameters: PedalParameters,
        num_envs: int,
        speed: float,
        control_frequency: float,
        episode_steps: int,
        reward: str = "exponential",
        alpha: float = 1.0,
        num_threads: int = 1,
    ) -> None:
        self.parameters, self.num_envs, self.dt, self.speed = parameters, num_envs, 1.0 / control_frequency, speed
        self.episode_steps, self.alpha = episode_steps, alpha
        self.observation_names = NAMES
        self.mirror_observation, self.mirror_action = by_name(NAMES, left_or_right), by_name(("crank",), left_or_right)
        self.single_observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (len(NAMES),), np.float32)
        self.single_action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.state = np.zeros((num_envs, 5))

    def reset(self, *, seed: int | None = None) -> tuple[Any, dict[str, Any]]:
        if seed is not None:
            self.state[:, 3], self.state[:, 4] = seed + np.arange(self.num_envs), 0
        self._restart(np.arange(self.num_envs))
        return self._seen(), {}

    def _restart(self, rows: Any) -> None:
        for row in rows:
            start = np.random.default_rng([int(self.state[row, 3]), int(self.state[row, 4])])
            self.state[row, :3] = start.uniform(-np.pi, np.pi), self.speed / self.parameters.crank, 0
            self.state[row, 4] += 1

    def _feet(self) -> Any:
        angle = self.state[:, 0, None] + np.array([0.0, np.pi])
        return self.parameters.crank * np.sin(angle), -self.parameters.crank * np.cos(angle)

    def _seen(self) -> Any:
        return np.column_stack([*self._feet(), self.state[:, 1]]).astype(np.float32)

    def step(self, actions: Any) -> tuple[Any, ...]:
        self.state[:, 1] += (self.parameters.drive * actions[:, 0] - self.state[:, 1]) * self.dt
        self.state[:, 0] -= self.state[:, 1] * self.dt  # the foot below moves backward
        self.state[:, 2] += 1
        forward, up = self._feet()
        height = self.parameters.leg_length + self.parameters.foot_radius
        lower = np.minimum(up[:, 0], up[:, 1])
        columns = [height + self.parameters.crank + 0 * lower]
        for side in range(2):
            columns += [forward[:, side], up[:, side] - self.parameters.leg_length - self.parameters.crank]
        velocity = -self.state[:, 1] * lower
        truncated = self.state[:, 2] >= self.episode_steps
        info = {
            "features": np.column_stack(columns).astype(np.float32),
            "forward_velocity": velocity.astype(np.float32),
            "contact": up < 0,
            "diverged": np.zeros(self.num_envs, bool),
            "final_obs": self._seen(),
        }
        self._restart(np.flatnonzero(truncated))
        reward = np.exp(-self.alpha * np.abs(velocity - self.speed)).astype(np.float32)
        return self._seen(), reward, np.zeros(self.num_envs, bool), truncated, info

    def save(self) -> Any:
        return self.state.copy()

    def restore(self, states: Any) -> tuple[Any, dict[str, Any]]:
        if states.shape != self.state.shape:
            raise ValueError(f"states must have shape {self.state.shape}")
        self.state = states.copy()
        return self._seen(), {}

    def close(self) -> None:
        pass


PEDAL = ReducedOrderModel(PedalParameters, PedalVectorEnv, faults, draw)
