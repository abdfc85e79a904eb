"""One planar humanoid as a plain Gymnasium environment."""

from __future__ import annotations

from typing import Any, Unpack

import gymnasium as gym
import mujoco
import numpy as np
from numpy.typing import NDArray

from romgrl.humanoid import task
from romgrl.humanoid.command_schedules import CommandSchedule
from romgrl.humanoid.commands import Commanded, CurrentCommands, Given
from romgrl.humanoid.model import CONTROL_FREQUENCY, build, dimensions
from romgrl.humanoid.observation import mirror_observation, observation_names, varying_columns
from romgrl.humanoid.planar_observer import GAIT_FEATURES, SOLE_HEIGHT, TRUNK_LEAN, PlanarObserver
from romgrl.humanoid.process_settings import set_up_mujoco
from romgrl.humanoid.rendering import SideCamera
from romgrl.humanoid.skeleton import skeleton_of
from romgrl.humanoid.start_states import StrideStates

Float32 = NDArray[np.float32]

_METADATA = {"render_modes": ["rgb_array"], "render_fps": round(CONTROL_FREQUENCY)}


class PlanarHumanoidEnv(Commanded, gym.Env[Float32, Float32]):
    """The same task as `PlanarHumanoidVectorEnv`, bit for bit, for one humanoid and without autoreset.

    `info` has `features` (5,), `forward_velocity`, `trunk_lean`, `sole_height` (2,) and `diverged`; observations are
    float32, (358,) for SMPL's skeleton, and actions (21,) in [-1, 1]; `observation_names` and `action_names` say what
    they are. With commands for G gaits observations have 2 + G more columns, the command of the next step, and `info`
    has `command` (2 + G,), that of the step.

    Args:
        model: planar model of `romgrl.humanoid.model.build`; None: the project's own humanoid.
        render_mode: None or "rgb_array".
        commands: what the humanoid is asked for, and when; None: to run at `speed`.
        settings: the task, see `romgrl.humanoid.task.SpeedSettings`.
    """

    metadata = _METADATA

    def __init__(
        self,
        *,
        model: mujoco.MjModel | None = None,
        render_mode: str | None = None,
        commands: CommandSchedule | None = None,
        **settings: Unpack[task.SpeedSettings],
    ) -> None:
        frequency = settings.get("control_frequency", CONTROL_FREQUENCY)
        self.model = build(control_frequency=frequency) if model is None else model
        self.task = task.SpeedTask.of(self.model, **settings)
        self._commands = CurrentCommands(commands, 1, self.task.control_step)
        self.dimensions = dimensions(self.model)
        self.substeps, self.control_step = self.task.substeps, self.task.control_step
        self.metadata = _METADATA | {"render_fps": round(frequency)}
        self.render_mode = render_mode
        skeleton, asked = skeleton_of(self.model), self._commands.names
        self.compact_columns = self._commands.columns_beside(varying_columns(self.model), skeleton.observation_size)
        self.observation_names, self.action_names = observation_names(skeleton, asked), skeleton.hinges
        self.mirror_observation, self.mirror_action = mirror_observation(skeleton, asked), skeleton.mirror_action()
        self.observation_space = gym.spaces.Box(-np.inf, np.inf, (len(self.observation_names),), np.float32)
        self.action_space = gym.spaces.Box(-1.0, 1.0, (len(skeleton.hinges),), np.float32)
        self._data = mujoco.MjData(self.model)
        self._generator = np.random.default_rng()
        self._starts = StrideStates(self.model)
        self._elapsed = 0
        self._camera: SideCamera | None = None
        self._observer = PlanarObserver(self.model)
        set_up_mujoco()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Float32, dict[str, Any]]:
        """Start anew; a seed makes everything that follows deterministic.

        options: arguments of `command`, which hold to the end of the episode; ValueError for any others.
        """
        given = self._commands.checked_options(options)
        super().reset(seed=seed)
        if seed is not None:
            self._generator = np.random.default_rng(seed)
        self._restart(given)
        observation, posture = self._observe()
        info = _info(posture, float(self._data.qvel[0]), diverged=False)
        return observation, info | self._commands.told(command=self._commands.values[0].copy())

    def step(self, action: Float32) -> tuple[Float32, float, bool, bool, dict[str, Any]]:
        """Advance by one control step with `action` (A,) held; numbers beyond [-1, 1] are clipped.

        ValueError for actions of another shape or not finite, and, with commands, before the first reset.
        """
        task.check_actions(action, self._data.ctrl.shape)
        self._commands.require_begun()
        self._data.ctrl[:] = task.controls(self.model, action)
        before, asked, acted = self._data.qpos[0], self._commands.speeds, self._commands.values.copy()
        mujoco.mj_step(self.model, self._data, nstep=self.substeps)
        self._elapsed += 1
        self._commands.advance(self._generator, np.array([self._elapsed]))
        observation, posture = self._observe()
        warnings = np.array([[warning.number for warning in self._data.warning]], dtype=np.int32)
        diverged = bool(task.diverged(posture, warnings)[0])
        if diverged:
            self._restart()
            observation, posture = self._observe()
        velocity = 0.0 if diverged else (self._data.qpos[0] - before) / self.control_step
        reward = 0.0 if diverged else float(np.float32(self.task.reward(np.array([velocity]), posture, asked)[0]))
        terminated = diverged or bool(self.task.fallen(posture)[0])
        truncated = self._elapsed >= self.task.episode_steps and not terminated
        info = _info(posture, velocity, diverged=diverged) | self._commands.told(command=acted[0])
        return observation, reward, terminated, truncated, info

    def _restart(self, given: Given = ()) -> None:
        self._commands.begin(self._generator, np.arange(1), given)
        mujoco.mj_resetData(self.model, self._data)
        self._data.qpos[:], self._data.qvel[:] = (rows[0] for rows in self._starts.draw(self._generator, 1))
        self._data.qvel[0] += self.task.draw_speed(self._generator, 1, self._commands.speeds)[0]
        self._elapsed = 0

    def _observe(self) -> tuple[Float32, NDArray[np.float64]]:
        """Observation and posture (1, POSTURE_SIZE)."""
        observation, posture = self._observer(self._data.qpos[None], self._data.qvel[None])
        return self._commands.beside(observation)[0], posture

    def state(self) -> NDArray[np.float64]:
        """Physics state (nq + nv,): qpos and qvel."""
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


def _info(posture: NDArray[np.float64], velocity: float, *, diverged: bool) -> dict[str, Any]:
    return {
        "features": posture[0, GAIT_FEATURES].astype(np.float32),
        "forward_velocity": np.float32(velocity),
        "trunk_lean": np.float32(posture[0, TRUNK_LEAN]),
        "sole_height": posture[0, SOLE_HEIGHT].astype(np.float32),
        "diverged": diverged,
    }
