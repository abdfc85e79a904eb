"""Many spring-leg worlds as one Gymnasium vector environment."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from romgrl.gait.features import POWERS
from romgrl.rom import _core
from romgrl.rom.drawing import draw
from romgrl.rom.observation import (
    ACTION_NAMES,
    MOTOR_ACTION_NAMES,
    MOTOR_OBSERVATION_NAMES,
    OBSERVATION_NAMES,
    PAPER_OBSERVATION_NAMES,
    mirror,
)
from romgrl.rom.parameters import Commands, Reward, SpringLegParameters, VariableLegParameters, core_parameters

Array = NDArray[Any]

_METADATA: dict[str, Any] = {
    "render_modes": ["rgb_array"],
    "render_fps": 30,
    "autoreset_mode": AutoresetMode.SAME_STEP,
}


REST_EXTENSIONS = [MOTOR_OBSERVATION_NAMES.index(f"{side}_rest_extension") for side in ("left", "right")]
LEG_MOTOR_POWERS = ("leg_motor_power", "positive_leg_motor_power")  # of the legs' motors alone, W


def names_of(parameters: SpringLegParameters) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The columns of observations and of actions."""
    if isinstance(parameters, VariableLegParameters):
        return MOTOR_OBSERVATION_NAMES, MOTOR_ACTION_NAMES
    return PAPER_OBSERVATION_NAMES if parameters.observation == "paper" else OBSERVATION_NAMES, ACTION_NAMES


def refuse_options(options: dict[str, Any] | None) -> None:
    """ValueError for options of a reset, which has none."""
    if options:
        raise ValueError(f"options {options!r} are not supported: there are none")


class SpringLegVectorEnv(VectorEnv[Array, Array, Array]):
    """A trunk on two spring legs, driven by two hip torques, to hold a forward speed (paper section 3.2).

    Observation: (N, 20) float32, or the 13 columns of the paper; see `romgrl.rom.observation.OBSERVATION_NAMES`.
    Action: (N, 2) float32, left and right hip torque as a share of `hip_torque`, clipped to [-1, 1]; NaN: ValueError.
    Reward: exp(-alpha |v - speed|) or v, where v is the mean forward velocity of the trunk over the control step.
    Terminated: trunk below `fall_height` leg lengths, a free trunk beyond `trunk_pitch_limit`, or a diverged state.
    Truncated: after `episode_steps` control steps.

    Finished worlds are reset in the same step; `info` holds, for all worlds and from before that reset, "final_obs",
    "features" (N, 5) m, "forward_velocity" (N,) m/s, "contact" (N, 2) bool, "ground_force" (N, 2) N (normal, mean over
    the step), "hip_torque" (N, 2) N m (at its end), "power", "positive_power", "retraction_power" and
    "positive_retraction_power" (N,) W (means over the step, absolute and positive work of all actuators, and of the
    legs' retraction alone; docs/method.md), "diverged" (N,) bool; and "reset_features" (N, 5) from after it.
    Arrays are reused: they are valid until the next step or reset.
    """

    metadata = _METADATA
    default_parameters: type[SpringLegParameters] = SpringLegParameters

    def __init__(
        self,
        *,
        parameters: SpringLegParameters | None = None,
        num_envs: int = 1,
        speed: float | Commands = 4.0,
        control_frequency: float = 30.0,
        episode_steps: int = 400,
        reward: Reward = "exponential",
        alpha: float = 1.0,
        work_cost: float = 0.0,
        num_threads: int = 1,
        render_mode: str | None = None,
    ) -> None:
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f"render_mode {render_mode!r} is neither None nor 'rgb_array'")
        self.parameters = self.default_parameters() if parameters is None else parameters
        if not isinstance(self.parameters, self.default_parameters):
            raise ValueError(f"parameters are {type(self.parameters).__name__}, not {self.default_parameters.__name__}")
        core = core_parameters(
            self.parameters,
            speed=speed,
            control_frequency=control_frequency,
            episode_steps=episode_steps,
            reward=reward,
            alpha=alpha,
            work_cost=work_cost,
        )
        self._batch = _core.Batch(core, num_envs, num_threads)
        self.num_envs = num_envs
        self.render_mode = render_mode
        self.speed = speed
        self.dt = 1.0 / control_frequency
        self.metadata = {**_METADATA, "render_fps": round(control_frequency)}
        size, actions = self._batch.observation_size, self._batch.action_size
        self.single_observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (size,), np.float32)
        self.single_action_space = gymnasium.spaces.Box(-1.0, 1.0, (actions,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_names, action_names = names_of(self.parameters)
        self.mirror_observation, self.mirror_action = mirror(self.observation_names), mirror(action_names)
        self._allocate(num_envs, size)

    def _allocate(self, n: int, size: int) -> None:
        self._observation = np.zeros((n, size), np.float32)
        self._reward = np.zeros(n, np.float32)
        self._terminated = np.zeros(n, np.bool_)
        self._truncated = np.zeros(n, np.bool_)
        self._final_observation = np.zeros((n, size), np.float32)
        self._features = np.zeros((n, 5), np.float32)
        self._reset_features = np.zeros((n, 5), np.float32)
        self._contact = np.zeros((n, 2), np.bool_)
        self._forward_velocity = np.zeros(n, np.float32)
        self._ground_force = np.zeros((n, 2), np.float32)
        self._hip_torque = np.zeros((n, 2), np.float32)
        self._powers = {name: np.zeros(n, np.float32) for name in (*POWERS, *LEG_MOTOR_POWERS)}
        self._diverged = np.zeros(n, np.bool_)
        self._travelled = np.zeros(n)  # m in this episode, for drawing
        self._info = {
            "final_obs": self._final_observation,
            "features": self._features,
            "reset_features": self._reset_features,
            "forward_velocity": self._forward_velocity,
            "contact": self._contact,
            "ground_force": self._ground_force,
            "hip_torque": self._hip_torque,
            **self._powers,
            "diverged": self._diverged,
        }
        arrays = {
            **self._info,
            "observation": self._observation,
            "reward": self._reward,
            "terminated": self._terminated,
            "truncated": self._truncated,
            "final_observation": self._final_observation,
        }
        self._buffers = _core.Buffers(self._batch, arrays)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Start a new episode in all worlds. A seed fixes all that follows; without one the random streams go on.

        There are no options: ValueError for any, `reset_mask` among them, since finished worlds reset in the step.
        """
        refuse_options(options)
        if seed is not None and not isinstance(seed, (int, np.integer)):
            raise ValueError("one seed serves all worlds: seed must be an integer")
        if seed is not None or self._np_random is None:
            super().reset(seed=None if seed is None else int(seed))
            self._batch.seed(int(self.np_random.integers(2**63)))
        self._batch.reset()
        self._observe()
        return self._observation, self._info.copy()

    def _observe(self) -> None:
        """Refresh the arrays from the worlds as they are, as after a reset."""
        self._batch.observe(self._observation, self._features, self._contact)
        self._final_observation[:] = self._observation
        self._reset_features[:] = self._features
        told = (self._forward_velocity, self._ground_force, self._hip_torque, *self._powers.values(), self._diverged)
        for array in (*told, self._travelled):
            array[:] = 0

    def step(self, actions: Array) -> tuple[Array, Array, Array, Array, dict[str, Any]]:
        """One control step of all worlds; actions (N, 2) float32, finite."""
        if self.render_mode is not None:
            self._travelled[self._terminated | self._truncated] = 0.0
        self._batch.step(np.ascontiguousarray(actions), self._buffers)
        if self.render_mode is not None:
            self._travelled += self._forward_velocity * self.dt
        return self._observation, self._reward, self._terminated, self._truncated, self._info.copy()

    def save(self) -> NDArray[np.float64]:
        """State of all worlds, (N, S) float64: positions, velocities, motors, episode and random stream."""
        return self._batch.save()

    def restore(self, states: NDArray[np.float64]) -> tuple[Array, dict[str, Any]]:
        """Go back to a state from `save`, bit for bit. Raises ValueError, and changes nothing, if it is none."""
        self._batch.restore(states)
        self._observe()
        return self._observation, self._info.copy()

    def begin_in(self, states: NDArray[np.float64], share: float) -> None:
        """From now on let a share of all episodes begin in one of these states (M, S) of `save`, drawn for each.

        A state keeps its command and last action; clock, number and random stream are those of the episode. No bank is
        part of `save`. Raises ValueError, and changes nothing, for what are no states and no share.
        """
        self._batch.begin_in(np.ascontiguousarray(states), share)

    def place(self, world: int, pose: _core.Pose) -> tuple[Array, dict[str, Any]]:
        """Put one world into a pose at the start of an episode."""
        self._batch.place(world, pose)
        self._observe()
        return self._observation, self._info.copy()

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """One (360, 640, 3) image per world of the state before the autoreset, or None without a render mode."""
        if self.render_mode is None:
            return None
        return tuple(
            draw(self._features[i], self._contact[i], float(self._travelled[i]), self.parameters, self.extensions(i))
            for i in range(self.num_envs)
        )

    def extensions(self, world: int) -> NDArray[np.float64] | None:
        """How far the rest lengths of a world's legs are beyond leg_length (2,), m; None where no motor moves them."""
        return None


class VariableLegVectorEnv(SpringLegVectorEnv):
    """The same with a motor in series with each leg's spring: observation (N, 29), action (N, 4).

    The last two actions are the drives of the left and the right motor, from -1, which shortens the rest length, to 1.
    """

    default_parameters = VariableLegParameters

    def extensions(self, world: int) -> NDArray[np.float64] | None:
        """From the state before the autoreset, as it is drawn."""
        return self._final_observation[world, REST_EXTENSIONS].astype(np.float64) * self.parameters.leg_length
