"""The teacher's learner of a configuration."""

from __future__ import annotations

from concurrent.futures import Executor

from gymnasium.spaces import flatdim

from romgrl.algorithms.ppo import PPO
from romgrl.config.schema import Config
from romgrl.config.teachers import ppo_keys
from romgrl.rom.interface import RomVectorEnv


def build_teacher_learner(config: Config, env: RomVectorEnv, lane: Executor | None = None) -> PPO:
    """PPO of the configuration for the environment; `lane` is a second thread for its updates."""
    teacher = ppo_keys(config.teacher)
    return PPO(
        observation_size=flatdim(env.single_observation_space),
        action_size=flatdim(env.single_action_space),
        hidden_sizes=teacher.hidden_sizes,
        activation=teacher.activation,
        learning_rate=teacher.learning_rate,
        gamma=teacher.gamma,
        gae_lambda=teacher.gae_lambda,
        clip_ratio=teacher.clip_ratio,
        epochs=teacher.epochs,
        minibatch_size=teacher.minibatch_size,
        value_coefficient=teacher.value_coefficient,
        entropy_coefficient=teacher.entropy_coefficient,
        max_gradient_norm=teacher.max_gradient_norm,
        initial_log_std=teacher.initial_log_std,
        adam_epsilon=teacher.adam_epsilon,
        hidden_gain=teacher.hidden_gain,
        policy_gain=teacher.policy_gain,
        value_clip=teacher.value_clip,
        normalize_observation=teacher.normalize_observation,
        normalize_return=teacher.normalize_return,
        bootstrap_truncated=teacher.bootstrap_truncated,
        segment_steps=teacher.segment_steps,
        mirror_observation=env.mirror_observation if teacher.mirror else None,
        mirror_action=env.mirror_action if teacher.mirror else None,
        lane=lane,
        seed=config.seed,
        device=config.device,
    )
