"""PPO of a teacher: rollouts, updates, checks of its speed, checkpoints (paper section 3.2)."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from gymnasium.spaces import flatdim
from numpy.typing import NDArray

from romgrl.algorithms.divergence import check_physics, require_finite
from romgrl.algorithms.ppo import PPO
from romgrl.algorithms.ppo_policy import save_ppo_policy
from romgrl.algorithms.rollout_buffer import Rollout
from romgrl.algorithms.second_thread import second_lane
from romgrl.artifacts.checkpoint import State
from romgrl.config.schema import Config
from romgrl.config.teachers import ppo_keys
from romgrl.rom.interface import RomVectorEnv
from romgrl.rom.vector_env import SpringLegVectorEnv
from romgrl.runtime.stage_log import StageLog
from romgrl.stages.training.checkpoints import Stateful, TrainingCheckpoints
from romgrl.stages.training.cycle_bank import fill_bank
from romgrl.stages.training.speed_check import SpeedChecks
from romgrl.stages.training.teacher_statistics import TeacherTally
from romgrl.stages.wiring.rom import rom_env
from romgrl.stages.wiring.teacher_learner import build_teacher_learner


def train_by_ppo(config: Config, output: Path, log: StageLog) -> None:
    """Write policy.safetensors, checks.csv and curve.csv (through `log`).

    All threads step the physics; in the updates, one half of them has the policy and the other half the values.
    """
    torch.set_num_threads(max(1, config.threads // 2))
    path, teacher = output / "policy.safetensors", ppo_keys(config.teacher)
    env = rom_env(config, num_envs=teacher.num_envs, episode_steps=teacher.episode_steps, training=True)
    with second_lane(config.threads > 1) as lane:
        ppo = build_teacher_learner(config, env, lane)
        with closing(env):
            checks = SpeedChecks.of(config, output, log, interval=teacher.check_steps, total=teacher.total_steps)
            train_teacher(
                config, env, ppo, checks, log, output, save=lambda: save_ppo_policy(path, ppo, env.observation_names)
            )
            checks.keep_best(ppo)
    save_ppo_policy(path, ppo, env.observation_names)


@dataclass
class TeacherLoop:
    """What one rollout hands to the next."""

    env: RomVectorEnv
    observation: NDArray[np.float32]

    def state(self) -> State:
        """Everything that `restore` needs."""
        return {"worlds": self.env.save(), "observation": self.observation}

    def restore(self, state: State) -> None:
        """Go on from a state."""
        self.env.restore(np.asarray(state["worlds"]))
        self.observation = np.asarray(state["observation"])


def train_teacher(
    config: Config,
    env: RomVectorEnv,
    ppo: PPO,
    checks: SpeedChecks,
    log: StageLog,
    output: Path,
    save: Callable[[], None],
) -> None:
    """Collect a rollout, update, as often as fits into `total_steps`; DivergenceError if a number is not finite."""
    teacher = ppo_keys(config.teacher)
    rollout = Rollout(
        steps=teacher.rollout_steps,
        num_envs=env.num_envs,
        observation_size=flatdim(env.single_observation_space),
        action_size=flatdim(env.single_action_space),
        device=config.device,
    )
    tally = TeacherTally(env.num_envs, teacher.rollout_steps)
    parts: dict[str, Stateful] = {}
    if teacher.cycles is not None:
        assert isinstance(env, SpringLegVectorEnv)
        parts["cycles"] = fill_bank(config, env, log)
    loop = TeacherLoop(env, env.reset(seed=config.seed)[0])
    checkpoints = TrainingCheckpoints(
        output,
        {**parts, "loop": loop, "ppo": ppo, "tally": tally, "checks": checks},
        save_policy=save,
        seconds=config.checkpoint_seconds,
        total=lambda: teacher.total_steps,
        log=log,
    )
    rollout_size = teacher.rollout_steps * env.num_envs
    first = checkpoints.resume()
    with checkpoints.deferring_signals("teacher"):
        for done in range(first + rollout_size, max(teacher.total_steps, rollout_size) + 1, rollout_size):
            loop.observation = collect(env, ppo, rollout, loop.observation, tally)
            decay = 1.0 - (done - rollout_size) / teacher.total_steps if teacher.learning_rate_decay else 1.0
            losses = ppo.update(rollout, learning_rate_scale=decay)
            gait = tally.take()
            require_finite(gradient=np.array(losses["gradient_norm"]), weights=ppo.weights)
            require_finite(loss=np.array([losses["policy_loss"], losses["value_loss"], losses["approximate_kl"]]))
            log.metrics(gait | losses, done)
            log.progress(done, teacher.total_steps, speed=gait["speed"], correlation=gait["left_right_correlation"])
            checks.check_if_due(done, ppo)
            checkpoints.save_if_due(done)


def collect(
    env: RomVectorEnv, ppo: PPO, rollout: Rollout, observation: NDArray[np.float32], tally: TeacherTally
) -> NDArray[np.float32]:
    """Fill `rollout` with the exploring policy; returns the observation that the next one starts from."""
    for step in range(len(rollout.rewards)):
        seen = torch.from_numpy(observation).to(ppo.device)
        action, log_probability = ppo.act(seen)
        rollout.store_action(step, seen, action, log_probability)
        observation, reward, terminated, truncated, info = env.step(action.clamp(-1.0, 1.0).cpu().numpy())
        check_physics(info["diverged"])
        require_finite(observation=info["final_obs"], reward=reward)
        rollout.store_outcome(step, reward, terminated, truncated, info["final_obs"])
        tally.add(step, reward, terminated, truncated, info)
    return observation
