"""One planar humanoid as a plain Gymnasium environment."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
from numpy.typing import NDArray

from romgrl.humanoid import task
from romgrl.humanoid.model import CONTROL_FREQUENCY, build, dimensions, silence_warnings
from romgrl.humanoid.observation import OBSERVATION_SIZE, observe, varying_columns
from romgrl.humanoid.rendering import SideCamera
from romgrl.humanoid.reset import build_bank
from romgrl.humanoid.skeleton import HINGES, mirror_action, mirror_observation

Float32 = NDArray[np.float32]

_METADATA = {"render_modes": ["rgb_array"], "render_fps": round(CONTROL_FREQUENCY)}


class PlanarHumanoidEnv(gym.Env[Float32, Float32]):
    """The same task as `PlanarHumanoidVectorEnv`, bit for bit, for one humanoid and without autoreset.

    The arguments are those of the vector environment. `info` has `features` (5,), `forward_velocity`, `trunk_lean`
    and `diverged`; observations are float32 (358,), actions (21,) in [-1, 1].
    """

    metadata = _METADATA

    def __init__(
        self,
        *,
        model: mujoco.MjModel | None = None,
        speed: float = 4.0,
        alpha: float = 1.0,
        episode_steps: int = task.EPISODE_STEPS,
        reset_speed: Sequence[float] = task.RESET_SPEED,
        fall_pelvis_height: float = task.FALL_PELVIS_HEIGHT,
        fall_head_height: float = task.FALL_HEAD_HEIGHT,
        fall_trunk_lean: float = task.FALL_TRUNK_LEAN,
        control_frequency: float = CONTROL_FREQUENCY,
        render_mode: str | None = None,
    ) -> None:
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
        self.metadata = _METADATA | {"render_fps": round(control_frequency)}
        self.render_mode = render_mode
        self.compact_columns = varying_columns(self.model)
        self.mirror_observation, self.mirror_action = mirror_observation(), mirror_action()
        self.observation_space = gym.spaces.Box(-np.inf, np.inf, (OBSERVATION_SIZE,), np.float32)
        self.action_space = gym.spaces.Box(-1.0, 1.0, (len(HINGES),), np.float32)
        self._data = mujoco.MjData(self.model)
        self._generator = np.random.default_rng()
        self._bank = build_bank(self.model)
        self._elapsed = 0
        self._camera: SideCamera | None = None
        silence_warnings()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Float32, dict[str, Any]]:
        """Start anew; a seed makes everything that follows deterministic."""
        super().reset(seed=seed)
        if seed is not None:
            self._generator = np.random.default_rng(seed)
        self._restart()
        return self._observe(), self._info(float(self._data.qvel[0]), diverged=False)

    def step(self, action: Float32) -> tuple[Float32, float, bool, bool, dict[str, Any]]:
        """Advance by one control step with `action` (21,) held; numbers beyond [-1, 1] are clipped."""
        task.check_actions(action, self._data.ctrl.shape)
        self._data.ctrl[:] = np.clip(action, -1.0, 1.0)
        before = self._data.qpos[0]
        for _ in range(self.substeps):
            mujoco.mj_step(self.model, self._data)
        self._elapsed += 1
        diverged = self._has_diverged()
        if diverged:
            self._restart()
        else:
            self._update()
        velocity = 0.0 if diverged else (self._data.qpos[0] - before) / self.control_step
        reward = 0.0 if diverged else float(np.float32(self.task.reward(np.array([velocity]))[0]))
        terminated = diverged or bool(self.task.fallen(self._position())[0])
        truncated = self._elapsed >= self.task.episode_steps and not terminated
        return self._observe(), reward, terminated, truncated, self._info(velocity, diverged=diverged)

    def _has_diverged(self) -> bool:
        warnings = np.array([[warning.number for warning in self._data.warning]], dtype=np.int32)
        return bool(task.diverged(self._data.qpos[None], self._data.qvel[None], warnings)[0])

    def _restart(self) -> None:
        mujoco.mj_resetData(self.model, self._data)
        self._data.qpos[:], self._data.qvel[:] = (rows[0] for rows in self._bank.draw(self._generator, 1))
        self._data.qvel[0] += self.task.draw_speed(self._generator, 1)[0]
        self._elapsed = 0
        self._update()

    def _update(self) -> None:
        """Positions and velocities of the current state."""
        mujoco.mj_kinematics(self.model, self._data)
        mujoco.mj_comPos(self.model, self._data)
        mujoco.mj_comVel(self.model, self._data)

    def _position(self) -> NDArray[np.float64]:
        position: NDArray[np.float64] = self._data.xpos[None, 1:]
        return position

    def _observe(self) -> Float32:
        return observe(self.model, self._data).astype(np.float32)

    def _info(self, velocity: float, *, diverged: bool) -> dict[str, Any]:
        position = self._position()
        return {
            "features": task.gait_features(position)[0].astype(np.float32),
            "forward_velocity": np.float32(velocity),
            "trunk_lean": task.trunk_lean(position)[0].astype(np.float32),
            "diverged": diverged,
        }

    def state(self) -> NDArray[np.float64]:
        """Physics state (48,): qpos and qvel."""
        return np.concatenate([self._data.qpos, self._data.qvel])

    def render(self) -> NDArray[np.uint8] | None:
        """Picture (480, 640, 3) from the side, or None without a render mode."""
        if self.render_mode is None:
            return None
        if self._camera is None:
            self._camera = SideCamera(self.model)
        return self._camera.frame(self.state())

    def close(self) -> None:
        """Free the camera."""
        if self._camera is not None:
            self._camera.close()
            self._camera = None
