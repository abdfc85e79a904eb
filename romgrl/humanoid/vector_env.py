"""Many planar humanoids, stepped together in C++ threads."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from mujoco.batch import Batch
from numpy.typing import NDArray

from romgrl.humanoid import task
from romgrl.humanoid.model import CONTROL_FREQUENCY, build, dimensions
from romgrl.humanoid.observation import NUM_BODIES, OBSERVATION_SIZE, assemble, varying_columns
from romgrl.humanoid.reset import build_bank
from romgrl.humanoid.skeleton import HINGES, mirror_action, mirror_observation

Float32 = NDArray[np.float32]
Step = tuple[Float32, Float32, NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]

EPISODE_STEPS = 300
RESET_SPEED = (0.0, 1.0)
FALL_PELVIS_HEIGHT, FALL_HEAD_HEIGHT, FALL_TRUNK_LEAN = 0.65, 0.65, 0.8
_BANK_SEED = 0
_VELOCITY_STAGE = mujoco.mjtStage.mjSTAGE_VEL.value


class PlanarHumanoidVectorEnv(VectorEnv[Float32, Float32, Any]):
    """`num_envs` humanoids that shall run forward at `speed`; a finished row starts anew within the same step.

    The observation (N, 358) belongs to the state after the step (positions and velocities are computed once more after
    the last substep). The arrays returned by `reset` and `step` are overwritten by the next call.

    Args:
        model: planar model of `romgrl.humanoid.model.build`; None: the project's own humanoid.
        num_envs: humanoids stepped together.
        speed: target speed, m/s.
        alpha: sensitivity of the reward exp(-alpha |v - speed|), s/m; v is the mean forward velocity of the pelvis
            over the control step.
        episode_steps: an episode is truncated after this many control steps.
        reset_speed: range of the forward speed at reset, share of `speed`.
        fall_pelvis_height: an episode ends when the pelvis is below this share of its standing height.
        fall_head_height: the same for the head.
        fall_trunk_lean: an episode ends beyond this lean of the pelvis-neck line, rad.
        control_frequency: control steps per second; a whole number of the model's timesteps.
        num_threads: threads of the physics; the results do not depend on it.
    """

    metadata = {"autoreset_mode": AutoresetMode.SAME_STEP, "render_modes": ["rgb_array"]}  # noqa: RUF012

    def __init__(
        self,
        *,
        model: mujoco.MjModel | None = None,
        num_envs: int = 1,
        speed: float = 4.0,
        alpha: float = 1.0,
        episode_steps: int = EPISODE_STEPS,
        reset_speed: Sequence[float] = RESET_SPEED,
        fall_pelvis_height: float = FALL_PELVIS_HEIGHT,
        fall_head_height: float = FALL_HEAD_HEIGHT,
        fall_trunk_lean: float = FALL_TRUNK_LEAN,
        control_frequency: float = CONTROL_FREQUENCY,
        num_threads: int = 1,
        render_mode: str | None = None,
    ) -> None:
        task.check_arguments(
            speed=speed, alpha=alpha, episode_steps=episode_steps, reset_speed=reset_speed, num_envs=num_envs,
            fall_trunk_lean=fall_trunk_lean, control_frequency=control_frequency, num_threads=num_threads,
        )
        self.model = build(control_frequency=control_frequency) if model is None else model
        self.num_envs, self.speed, self.alpha, self.episode_steps = num_envs, speed, alpha, episode_steps
        self.render_mode = render_mode
        self.substeps = task.substeps(self.model.opt.timestep, control_frequency)
        self.control_step = self.substeps * self.model.opt.timestep
        self.dimensions = dimensions(self.model)
        self._reset_speed = (reset_speed[0] * speed, reset_speed[1] * speed)
        self._fall = {
            "pelvis_height": fall_pelvis_height * self.dimensions.pelvis_height,
            "head_height": fall_head_height * self.dimensions.head_height,
            "lean": fall_trunk_lean,
        }
        self.compact_columns = varying_columns(self.model)
        self.mirror_observation, self.mirror_action = mirror_observation(), mirror_action()
        self.single_observation_space = gym.spaces.Box(-np.inf, np.inf, (OBSERVATION_SIZE,), np.float32)
        self.single_action_space = gym.spaces.Box(-1.0, 1.0, (len(HINGES),), np.float32)
        self.observation_space = gym.vector.utils.batch_space(self.single_observation_space, num_envs)
        self.action_space = gym.vector.utils.batch_space(self.single_action_space, num_envs)
        self.diverged_count = 0
        """Episodes ended by a diverged simulation since construction."""
        self._generator = np.random.default_rng()
        self._bank = build_bank(self.model, np.random.default_rng(_BANK_SEED))
        self._bind(num_threads)

    def _bind(self, num_threads: int) -> None:
        """Live views of the batch's state and kinematics, and the arrays that are returned."""
        self._batch = Batch(self.model, self.num_envs, num_threads)
        self._qpos, self._qvel = self._batch.bind("qpos"), self._batch.bind("qvel")
        self._controls, self._warmstart = self._batch.bind("ctrl"), self._batch.bind("qacc_warmstart")
        bodies = slice(1, 1 + NUM_BODIES)
        self._position = self._batch.bind("xpos")[:, bodies]
        self._rotation = self._batch.bind("xmat")[:, bodies]
        self._velocity = self._batch.bind("cvel")[:, bodies]
        self._centre = self._batch.bind("subtree_com")[:, 1]
        self._warnings = self._batch.warning[..., 1]
        self._elapsed = np.zeros(self.num_envs, dtype=np.int64)
        self._observation = np.zeros((self.num_envs, OBSERVATION_SIZE), dtype=np.float32)
        self._final_observation = np.zeros_like(self._observation)

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Float32, dict[str, Any]]:
        """Start every humanoid anew; a seed makes everything that follows deterministic."""
        if seed is not None:
            self._generator = np.random.default_rng(seed)
        self._restart(np.arange(self.num_envs))
        self._final_observation[:] = self._observation
        nothing = np.zeros(self.num_envs, dtype=np.bool_)
        info = self._info(self._qvel[:, 0], nothing)
        return self._observation, info | self._reset_info()

    def step(self, actions: Float32) -> Step:
        """Advance by one control step with `actions` (N, 21) in [-1, 1] held; larger ones are clipped."""
        actions = np.asarray(actions, dtype=np.float64)
        if actions.shape != self._controls.shape:
            raise ValueError(f"actions must have shape {self._controls.shape}, not {actions.shape}")
        if not np.isfinite(actions).all():
            raise ValueError("actions must be finite")
        np.clip(actions, -1.0, 1.0, out=self._controls)
        before = self._qpos[:, 0].copy()
        self._batch.step(nstep=self.substeps, stage=_VELOCITY_STAGE)
        self._elapsed += 1
        diverged = self._recover_diverged()
        velocity = np.where(diverged, 0.0, (self._qpos[:, 0] - before) / self.control_step)
        reward = np.where(diverged, 0.0, task.speed_reward(velocity, speed=self.speed, alpha=self.alpha))
        terminated = diverged | task.fallen(self._position, **self._fall)
        truncated = (self._elapsed >= self.episode_steps) & ~terminated
        self._observation[:] = self._observe()
        self._final_observation[:] = self._observation
        info = self._info(velocity, diverged)
        finished = np.flatnonzero(terminated | truncated)
        if finished.size:
            self._restart(finished)
        return self._observation, reward.astype(np.float32), terminated, truncated, info | self._reset_info()

    def _recover_diverged(self) -> NDArray[np.bool_]:
        """Flag diverged rows and put them into a finite state, so that what they report is finite."""
        diverged = task.diverged(self._qpos, self._qvel, self._warnings)
        if diverged.any():
            self.diverged_count += int(diverged.sum())
            self._restart(np.flatnonzero(diverged))
        return diverged

    def _restart(self, rows: NDArray[np.int64]) -> None:
        """Draw new states for `rows` and observe them."""
        self._batch.reset(rows, stage=mujoco.mjtStage.mjSTAGE_NONE.value)
        self._qpos[rows], self._qvel[rows] = self._bank.draw(self._generator, len(rows))
        self._qvel[rows, 0] += self._generator.uniform(*self._reset_speed, size=len(rows))
        self._warnings[rows] = 0
        self._elapsed[rows] = 0
        self._batch.forward(rows, stage=_VELOCITY_STAGE)
        self._observation[rows] = self._observe(rows)

    def _observe(self, rows: NDArray[np.int64] | slice = slice(None)) -> NDArray[np.float64]:
        return assemble(self._position[rows], self._rotation[rows], self._velocity[rows], self._centre[rows])

    def _info(self, velocity: NDArray[np.float64], diverged: NDArray[np.bool_]) -> dict[str, Any]:
        """What belongs to the state before an autoreset."""
        return {
            "final_obs": self._final_observation,
            "features": task.gait_features(self._position).astype(np.float32),
            "forward_velocity": velocity.astype(np.float32),
            "trunk_lean": task.trunk_lean(self._position).astype(np.float32),
            "diverged": diverged,
        }

    def _reset_info(self) -> dict[str, Any]:
        """What belongs to the state after an autoreset."""
        return {
            "reset_features": task.gait_features(self._position).astype(np.float32),
            "reset_trunk_lean": task.trunk_lean(self._position).astype(np.float32),
        }

    def states(self) -> NDArray[np.float64]:
        """Physics states (N, 48): qpos and qvel, for `romgrl.humanoid.rendering`."""
        return np.concatenate([self._qpos, self._qvel], axis=1)

    def set_states(self, states: NDArray[np.float64]) -> Float32:
        """Put every humanoid into a state of `states` (N, 48), start its episode there and return the observations."""
        self._batch.reset(stage=mujoco.mjtStage.mjSTAGE_NONE.value)
        self._qpos[:], self._qvel[:] = states[:, : self.model.nq], states[:, self.model.nq :]
        self._warnings[:] = 0
        self._elapsed[:] = 0
        self._batch.forward(stage=_VELOCITY_STAGE)
        self._observation[:] = self._observe()
        return self._observation
