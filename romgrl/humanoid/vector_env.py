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
from romgrl.humanoid.model import CONTROL_FREQUENCY, build, dimensions, silence_warnings
from romgrl.humanoid.observation import NUM_BODIES, OBSERVATION_SIZE, assemble, varying_columns
from romgrl.humanoid.rendering import SideCamera
from romgrl.humanoid.reset import build_bank
from romgrl.humanoid.skeleton import HINGES, mirror_action, mirror_observation

Float32 = NDArray[np.float32]
Rows = NDArray[np.int64]
Step = tuple[Float32, Float32, NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]

_METADATA = {"autoreset_mode": AutoresetMode.SAME_STEP, "render_modes": ["rgb_array"]}
_NO_STAGE, _VELOCITY_STAGE = mujoco.mjtStage.mjSTAGE_NONE.value, mujoco.mjtStage.mjSTAGE_VEL.value


class PlanarHumanoidVectorEnv(VectorEnv[Float32, Float32, Any]):
    """`num_envs` humanoids that shall run forward at `speed`; a finished row starts anew within the same step.

    Observations (N, 358) belong to the state after the step: `mujoco.batch` runs all substeps in C++ threads and then
    computes positions and velocities once more. `info` has, before the autoreset, `final_obs`, `features` (N, 5),
    `forward_velocity` (N,), `trunk_lean` (N,) and `diverged` (N,), and after it `reset_features` and
    `reset_trunk_lean`. A diverged humanoid ends its episode with reward 0 and reports the state it restarts from.

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
        render_mode: None or "rgb_array".
    """

    metadata = _METADATA

    def __init__(
        self,
        *,
        model: mujoco.MjModel | None = None,
        num_envs: int = 1,
        speed: float = 4.0,
        alpha: float = 1.0,
        episode_steps: int = task.EPISODE_STEPS,
        reset_speed: Sequence[float] = task.RESET_SPEED,
        fall_pelvis_height: float = task.FALL_PELVIS_HEIGHT,
        fall_head_height: float = task.FALL_HEAD_HEIGHT,
        fall_trunk_lean: float = task.FALL_TRUNK_LEAN,
        control_frequency: float = CONTROL_FREQUENCY,
        num_threads: int = 1,
        render_mode: str | None = None,
    ) -> None:
        task.check_counts(num_envs=num_envs, num_threads=num_threads)
        self.model = build(control_frequency=control_frequency) if model is None else model
        self.task = task.SpeedTask.of(
            self.model,
            speed=speed,
            alpha=alpha,
            episode_steps=episode_steps,
            reset_speed=reset_speed,
            fall_pelvis_height=fall_pelvis_height,
            fall_head_height=fall_head_height,
            fall_trunk_lean=fall_trunk_lean,
            control_frequency=control_frequency,
        )
        self.dimensions = dimensions(self.model)
        self.substeps, self.control_step = self.task.substeps, self.task.control_step
        self.num_envs, self.render_mode = num_envs, render_mode
        self.compact_columns = varying_columns(self.model)
        self.mirror_observation, self.mirror_action = mirror_observation(), mirror_action()
        self.single_observation_space = gym.spaces.Box(-np.inf, np.inf, (OBSERVATION_SIZE,), np.float32)
        self.single_action_space = gym.spaces.Box(-1.0, 1.0, (len(HINGES),), np.float32)
        self.observation_space = gym.vector.utils.batch_space(self.single_observation_space, num_envs)
        self.action_space = gym.vector.utils.batch_space(self.single_action_space, num_envs)
        self.diverged_count = 0
        """Episodes ended by a diverged simulation since construction."""
        self._generator = np.random.default_rng()
        self._bank = build_bank(self.model)
        self._elapsed = np.zeros(num_envs, dtype=np.int64)
        self._camera: SideCamera | None = None
        silence_warnings()
        self._bind(num_threads)

    def _bind(self, num_threads: int) -> None:
        """Live views of the states and kinematics of all simulations."""
        self._batch = Batch(self.model, self.num_envs, num_threads)
        self._qpos, self._qvel = self._batch.bind("qpos"), self._batch.bind("qvel")
        self._controls = self._batch.bind("ctrl")
        bodies = slice(1, 1 + NUM_BODIES)
        self._position = self._batch.bind("xpos")[:, bodies]
        self._rotation = self._batch.bind("xmat")[:, bodies]
        self._velocity = self._batch.bind("cvel")[:, bodies]
        self._centre = self._batch.bind("subtree_com")[:, 1]
        self._warnings = self._batch.warning[..., 1]

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Float32, dict[str, Any]]:
        """Start every humanoid anew; a seed makes everything that follows deterministic."""
        if seed is not None:
            self._generator = np.random.default_rng(seed)
        self._restart(np.arange(self.num_envs))
        observation = self._observe()
        nothing = np.zeros(self.num_envs, dtype=np.bool_)
        return observation, self._with_resets(self._info(observation.copy(), self._qvel[:, 0], nothing), nothing)

    def step(self, actions: Float32) -> Step:
        """Advance by one control step with `actions` (N, 21) in [-1, 1] held; larger ones are clipped."""
        task.check_actions(actions, self._controls.shape)
        np.clip(actions, -1.0, 1.0, out=self._controls)
        before = self._qpos[:, 0].copy()
        self._batch.step(nstep=self.substeps, stage=_VELOCITY_STAGE)
        self._elapsed += 1
        diverged = self._recover_diverged()
        velocity = np.where(diverged, 0.0, (self._qpos[:, 0] - before) / self.control_step)
        reward = np.where(diverged, 0.0, self.task.reward(velocity)).astype(np.float32)
        terminated = diverged | self.task.fallen(self._position)
        truncated = (self._elapsed >= self.task.episode_steps) & ~terminated
        observation = self._observe()
        info = self._info(observation.copy(), velocity, diverged)
        finished = terminated | truncated
        if finished.any():
            rows = np.flatnonzero(finished)
            self._restart(rows)
            observation[rows] = self._observe(rows)
        return observation, reward, terminated, truncated, self._with_resets(info, finished)

    def _recover_diverged(self) -> NDArray[np.bool_]:
        """Flag diverged rows and put them into a finite state, so that what they report is finite."""
        diverged = task.diverged(self._qpos, self._qvel, self._warnings)
        if diverged.any():
            self.diverged_count += int(diverged.sum())
            self._restart(np.flatnonzero(diverged))
        return diverged

    def _restart(self, rows: Rows) -> None:
        """Draw new states for `rows` and compute their positions and velocities."""
        self._batch.reset(rows, stage=_NO_STAGE)
        self._qpos[rows], self._qvel[rows] = self._bank.draw(self._generator, len(rows))
        self._qvel[rows, 0] += self.task.draw_speed(self._generator, len(rows))
        self._begin(rows)

    def _begin(self, rows: Rows) -> None:
        self._warnings[rows] = 0
        self._elapsed[rows] = 0
        self._batch.forward(rows, stage=_VELOCITY_STAGE)

    def _observe(self, rows: Rows | slice = slice(None)) -> Float32:
        full = assemble(self._position[rows], self._rotation[rows], self._velocity[rows], self._centre[rows])
        return full.astype(np.float32)

    def _info(self, final: Float32, velocity: NDArray[np.float64], diverged: NDArray[np.bool_]) -> dict[str, Any]:
        """What belongs to the state before an autoreset."""
        return {
            "final_obs": final,
            "features": task.gait_features(self._position).astype(np.float32),
            "forward_velocity": velocity.astype(np.float32),
            "trunk_lean": task.trunk_lean(self._position).astype(np.float32),
            "diverged": diverged,
        }

    def _with_resets(self, info: dict[str, Any], finished: NDArray[np.bool_]) -> dict[str, Any]:
        """Add what belongs to the state after an autoreset."""
        features, lean = info["features"].copy(), info["trunk_lean"].copy()
        if finished.any():
            features[finished] = task.gait_features(self._position[finished])
            lean[finished] = task.trunk_lean(self._position[finished])
        return info | {"reset_features": features, "reset_trunk_lean": lean}

    def states(self) -> NDArray[np.float64]:
        """Physics states (N, 48): qpos and qvel, for films and for `set_states`."""
        return np.concatenate([self._qpos, self._qvel], axis=1)

    def set_states(self, states: NDArray[np.float64]) -> Float32:
        """Start episodes in the given states (N, 48) and return their observations."""
        if states.shape != (self.num_envs, self.model.nq + self.model.nv):
            raise ValueError(f"states must have shape {(self.num_envs, self.model.nq + self.model.nv)}")
        self._batch.reset(stage=_NO_STAGE)
        self._qpos[:], self._qvel[:] = states[:, : self.model.nq], states[:, self.model.nq :]
        self._begin(np.arange(self.num_envs))
        return self._observe()

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """One picture (480, 640, 3) per humanoid, from the side."""
        if self.render_mode is None:
            return None
        if self._camera is None:
            self._camera = SideCamera(self.model)
        return tuple(self._camera.frames(self.states()))

    def close_extras(self, **kwargs: Any) -> None:
        """Free the camera."""
        if self._camera is not None:
            self._camera.close()
            self._camera = None
