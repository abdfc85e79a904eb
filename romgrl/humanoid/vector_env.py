"""Many planar humanoids, stepped together in C++ threads."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Unpack

import gymnasium as gym
import mujoco
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from mujoco.batch import Batch
from numpy.typing import NDArray

from romgrl.humanoid import task
from romgrl.humanoid.command_checks import Rows
from romgrl.humanoid.command_schedules import CommandSchedule
from romgrl.humanoid.commands import Commanded, CurrentCommands, Given
from romgrl.humanoid.model import CONTROL_FREQUENCY, build, dimensions
from romgrl.humanoid.observation import mirror_observation, observation_names, varying_columns
from romgrl.humanoid.planar_observer import GAIT_FEATURES, SOLE_HEIGHT, TRUNK_LEAN, PlanarObserver
from romgrl.humanoid.process_settings import set_up_mujoco
from romgrl.humanoid.rendering import SideCamera
from romgrl.humanoid.skeleton import skeleton_of
from romgrl.humanoid.start_states import MixedStates, StartStates, StrideStates

Float32 = NDArray[np.float32]
Step = tuple[Float32, Float32, NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]

_METADATA = {"autoreset_mode": AutoresetMode.SAME_STEP, "render_modes": ["rgb_array"]}


class PlanarHumanoidVectorEnv(Commanded, VectorEnv[Float32, Float32, Any]):
    """`num_envs` humanoids that shall run forward at a speed; a finished row starts anew within the same step.

    Observations (N, C), 358 columns for SMPL's skeleton, belong to the state after the step; `observation_names` and
    `action_names` say what the columns are. `info` has, before the autoreset, `final_obs`,
    `features` (N, 5), `forward_velocity` (N,), `trunk_lean` (N,), `sole_height` (N, 2) and `diverged` (N,), and after
    it `reset_features`, `reset_trunk_lean` and `reset_sole_height`. A diverged humanoid ends its episode with
    reward 0 and reports the state it restarts from.

    With `commands` for G gaits each humanoid is asked for a speed, m/s, weights of the gaits and a style of its own.
    The last 2 + G columns of an observation are what is asked in the next step; `info` has `command` (N, 2 + G), of
    the step, and `reset_command`, of the next one, after an autoreset where there is one.

    Args:
        model: planar model of `romgrl.humanoid.model.build`; None: the project's own humanoid.
        num_envs: humanoids stepped together.
        num_threads: threads of the physics; the results do not depend on it.
        compact: observations have only the columns that vary in the plane, `columns` of all.
        render_mode: None or "rgb_array".
        commands: what humanoids are asked for, and when; None: to run at `speed`.
        settings: the task, see `romgrl.humanoid.task.SpeedSettings`.
    """

    metadata = _METADATA

    def __init__(
        self,
        *,
        model: mujoco.MjModel | None = None,
        num_envs: int = 1,
        num_threads: int = 1,
        compact: bool = False,
        render_mode: str | None = None,
        commands: CommandSchedule | None = None,
        **settings: Unpack[task.SpeedSettings],
    ) -> None:
        task.check_counts(num_envs=num_envs, num_threads=num_threads)
        frequency = settings.get("control_frequency", CONTROL_FREQUENCY)
        self.model = build(control_frequency=frequency) if model is None else model
        self.task = task.SpeedTask.of(self.model, **settings)
        self.dimensions = dimensions(self.model)
        self.substeps, self.control_step = self.task.substeps, self.task.control_step
        self.num_envs, self.render_mode = num_envs, render_mode
        self._commands = CurrentCommands(commands, num_envs, self.control_step)
        skeleton, varying = skeleton_of(self.model), varying_columns(self.model)
        self._observer = PlanarObserver(self.model, varying if compact else None)
        size, seen = skeleton.observation_size, self._observer.columns.astype(np.int64)
        self.compact_columns = self._commands.columns_beside(varying, size)
        self.columns = self._commands.columns_beside(seen, size)
        names = observation_names(skeleton, self._commands.names)
        self.observation_names, self.action_names = tuple(names[i] for i in self.columns), skeleton.hinges
        self.mirror_observation = mirror_observation(skeleton, self._commands.names).kept(self.columns)
        self.mirror_action = skeleton.mirror_action()
        self.single_observation_space = gym.spaces.Box(-np.inf, np.inf, self.columns.shape, np.float32)
        self.single_action_space = gym.spaces.Box(-1.0, 1.0, (len(skeleton.hinges),), np.float32)
        self.observation_space = gym.vector.utils.batch_space(self.single_observation_space, num_envs)
        self.action_space = gym.vector.utils.batch_space(self.single_action_space, num_envs)
        self.diverged_count = 0
        """Episodes ended by a diverged simulation since construction."""
        self._generator = np.random.default_rng()
        self._starts: StartStates = StrideStates(self.model)
        self._elapsed = np.zeros(num_envs, dtype=np.int64)
        self._camera: SideCamera | None = None
        set_up_mujoco()
        self._bind(num_threads)

    def _bind(self, num_threads: int) -> None:
        """Live views of the states of all simulations."""
        self._batch = Batch(self.model, self.num_envs, num_threads)
        self._qpos, self._qvel = self._batch.bind("qpos"), self._batch.bind("qvel")
        self._controls, self._forces = self._batch.bind("ctrl"), self._batch.bind("xfrc_applied")
        self._pushed = self.model.body(skeleton_of(self.model).pushed).id
        self._warnings = self._batch.warning[..., 1]
        self._rest = self._batch.state[0].copy()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Float32, dict[str, Any]]:
        """Start every humanoid anew; a seed makes everything that follows deterministic.

        options: arguments of `command`, which hold to the end of each episode; ValueError for any others.
        """
        given = self._commands.checked_options(options)
        if seed is not None:
            self._generator = np.random.default_rng(seed)
        self._restart(np.arange(self.num_envs), given)
        observation, posture = self._observe()
        nothing = np.zeros(self.num_envs, dtype=np.bool_)
        info = _before_reset(observation.copy(), posture, self._qvel[:, 0], nothing)
        told = self._commands.told(command=self._commands.values.copy(), reset_command=self._commands.values.copy())
        return observation, _after_reset(info, posture, np.arange(0)) | told

    def step(self, actions: Float32) -> Step:
        """Advance by one control step with `actions` (N, A) in [-1, 1] held; larger ones are clipped.

        ValueError for actions of another shape or not finite, and, with commands, before the first reset.
        """
        task.check_actions(actions, self._controls.shape)
        self._commands.require_begun()
        self._controls[:] = task.controls(self.model, actions)
        before, asked, acted = self._qpos[:, 0].copy(), self._commands.speeds, self._commands.values.copy()
        self._batch.step(nstep=self.substeps)
        self._elapsed += 1
        self._commands.advance(self._generator, self._elapsed)
        observation, posture = self._observe()
        diverged = task.diverged(posture, self._warnings)
        if diverged.any():
            self.diverged_count += int(diverged.sum())
            self._replace(np.flatnonzero(diverged), observation, posture)
        velocity = np.where(diverged, 0.0, (self._qpos[:, 0] - before) / self.control_step)
        reward = np.where(diverged, 0.0, self.task.reward(velocity, posture, asked)).astype(np.float32)
        terminated = diverged | self.task.fallen(posture)
        truncated = (self._elapsed >= self.task.episode_steps) & ~terminated
        info = _before_reset(observation.copy(), posture, velocity, diverged)
        rows = np.flatnonzero(terminated | truncated)
        if len(rows):
            self._replace(rows, observation, posture)
        told = self._commands.told(command=acted, reset_command=self._commands.values.copy())
        info = _after_reset(info, posture, rows) | told
        return observation, reward, terminated, truncated, info

    def _replace(self, rows: Rows, observation: Float32, posture: NDArray[np.float64]) -> None:
        """Start `rows` anew and write what is then seen into their rows of the arrays."""
        self._restart(rows)
        observation[rows], posture[rows] = self._observe(rows)

    def _observe(self, rows: Rows | slice = slice(None)) -> tuple[Float32, NDArray[np.float64]]:
        """Observations (n, C) and postures (n, POSTURE_SIZE) of `rows`."""
        observation, posture = self._observer(self._qpos[rows], self._qvel[rows])
        return self._commands.beside(observation, rows), posture

    def _restart(self, rows: Rows, given: Given = ()) -> None:
        """Draw new commands and states for `rows`; `given` replaces the commands of all."""
        self._commands.begin(self._generator, rows, given)
        asked = self._commands.speeds
        commands = None if asked is None else self._commands.values[rows]
        qpos, qvel = self._starts.draw(self._generator, len(rows), commands)
        qvel[:, 0] += self.task.draw_speed(self._generator, len(rows), None if asked is None else asked[rows])
        self._place(rows, qpos, qvel)

    def _place(self, rows: Rows, qpos: NDArray[np.float64], qvel: NDArray[np.float64]) -> None:
        """Begin episodes in the given states, with everything else as at rest."""
        self._batch.state[rows] = self._rest
        self._qpos[rows], self._qvel[rows] = qpos, qvel
        self._warnings[rows] = 0
        self._elapsed[rows] = 0

    def start_from(self, states: StartStates, share: float) -> None:
        """Let `share` of the episodes begin in other states."""
        self._starts = MixedStates(self._starts, states, share)

    def push(self, force: NDArray[np.float64]) -> None:
        """From now on, forward forces (N,), N, act on the pushed body's centre of mass; a restarted row has none."""
        self._forces[:, self._pushed, 0] = force

    def states(self) -> NDArray[np.float64]:
        """Physics states (N, nq + nv): qpos and qvel, for films and for `set_states`."""
        return np.concatenate([self._qpos, self._qvel], axis=1)

    def set_states(self, states: NDArray[np.float64]) -> Float32:
        """Start episodes in the given states (N, nq + nv), with new commands, and return their observations."""
        if states.shape != (self.num_envs, self.model.nq + self.model.nv):
            raise ValueError(f"states must have shape {(self.num_envs, self.model.nq + self.model.nv)}")
        self._place(np.arange(self.num_envs), *np.split(states, [self.model.nq], axis=1))
        self._commands.begin(self._generator, np.arange(self.num_envs))
        return self._observe()[0]

    def state(self) -> dict[str, Any]:
        """All that the next steps depend on, for `restore`: MuJoCo's integration states, counters, random stream."""
        state = {
            "states": self._batch.state,
            "warnings": self._warnings,
            "elapsed": self._elapsed,
            "diverged_count": self.diverged_count,
            "generator": self._generator.bit_generator.state,
        }
        return state | ({"commands": self._commands.state()} if self._commands.schedule is not None else {})

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a state; the observation is the one that was last returned before it.

        ValueError, and no change, for the state of another number of humanoids, of another body, or of other commands.
        """
        for name, own in (("states", self._batch.state), ("warnings", self._warnings), ("elapsed", self._elapsed)):
            if (found := np.asarray(state.get(name)).shape) != own.shape:
                raise ValueError(f"state must have {name} of shape {own.shape}, not {found}")
        try:
            np.random.default_rng(0).bit_generator.state = state["generator"]
            int(state["diverged_count"])
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError("state must have generator and diverged_count as an environment gives them") from error
        self._commands.restore(state.get("commands"))  # the first that changes anything
        self._batch.state[:] = state["states"]
        self._warnings[:] = state["warnings"]
        self._elapsed[:] = state["elapsed"]
        self.diverged_count = state["diverged_count"]
        self._generator.bit_generator.state = state["generator"]

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


def _before_reset(
    final: Float32, posture: NDArray[np.float64], velocity: NDArray[np.float64], diverged: NDArray[np.bool_]
) -> dict[str, Any]:
    """What `info` says of the states before an autoreset."""
    return {
        "final_obs": final,
        "features": posture[:, GAIT_FEATURES].astype(np.float32),
        "forward_velocity": velocity.astype(np.float32),
        "trunk_lean": posture[:, TRUNK_LEAN].astype(np.float32),
        "sole_height": posture[:, SOLE_HEIGHT].astype(np.float32),
        "diverged": diverged,
    }


def _after_reset(info: dict[str, Any], posture: NDArray[np.float64], rows: Rows) -> dict[str, Any]:
    """Add what belongs to the states after an autoreset of `rows`."""
    seen: dict[str, slice | int] = {"features": GAIT_FEATURES, "trunk_lean": TRUNK_LEAN, "sole_height": SOLE_HEIGHT}
    for name, columns in seen.items():
        info[f"reset_{name}"] = info[name].copy()
        info[f"reset_{name}"][rows] = posture[rows, columns]
    return info
