"""The learner of a configuration: agent, discriminator, replay buffer and their mirrors, wired together."""

from __future__ import annotations

from concurrent.futures import Executor
from pathlib import Path
from typing import Any

import torch

from romgrl.algorithms.discriminator import Discriminator
from romgrl.algorithms.networks.running_normalizer import RunningNormalizer
from romgrl.algorithms.replay_buffer import ReplayBuffer
from romgrl.algorithms.rom_grl import RomGrl
from romgrl.algorithms.sac import SAC
from romgrl.config.schema import Config
from romgrl.gait.discriminator_windows import WindowLayout, reference_windows
from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv
from romgrl.stages.wiring.imitated import read_imitated


def build_student_learner(
    config: Config,
    env: PlanarHumanoidVectorEnv,
    layout: WindowLayout,
    reference: Path | None,
    lane: Executor | None = None,
) -> RomGrl:
    """Wire agent, discriminator and replay buffer from the configuration; `lane` is a second thread for the agent."""
    mirror = layout.mirror() if config.student.mirror else None
    return RomGrl(
        buffer=ReplayBuffer(window_size=layout.size, mirror_windows=mirror, **buffer_settings(config, env)),
        sac=build_agent(config, env, lane),
        discriminator=build_discriminator(config, layout, reference),
        **learner_settings(config, env),
    )


def buffer_settings(config: Config, env: PlanarHumanoidVectorEnv) -> dict[str, Any]:
    """What a replay buffer is made with, whatever its windows are."""
    student = config.student
    return {
        "capacity": student.buffer_size,
        "num_envs": env.num_envs,
        "observation_size": len(env.columns),
        "action_size": env.model.nu,
        "seed": config.seed,
        "n_steps": student.n_steps,
        "device": config.device,
        "mirror_observation": env.mirror_observation if student.mirror else None,
        "mirror_action": env.mirror_action if student.mirror else None,
    }


def learner_settings(config: Config, env: PlanarHumanoidVectorEnv) -> dict[str, Any]:
    """What a learner is made with beside its agent, discriminator and replay buffer."""
    student, discriminator = config.student, config.discriminator
    return {
        "normalizer": RunningNormalizer(len(env.columns), enabled=student.normalize_observation, device=config.device),
        "eta": config.eta,
        "batch_size": student.batch_size,
        "discriminator_interval": discriminator.update_interval,
        "discriminator_batch": discriminator.batch_size,
        "discriminator_recent": discriminator.recent_steps,
        "stored_reward": discriminator.reward == "stored",
    }


def build_agent(config: Config, env: PlanarHumanoidVectorEnv, lane: Executor | None) -> SAC:
    """The agent, which sees what the environment shows."""
    student = config.student
    return SAC(
        observation_size=len(env.columns),
        action_size=env.model.nu,
        hidden_sizes=list(student.hidden_sizes),
        layer_norm=student.layer_norm,
        policy_learning_rate=student.policy_learning_rate,
        critic_learning_rate=student.critic_learning_rate,
        temperature_learning_rate=student.temperature_learning_rate,
        initial_temperature=student.initial_temperature,
        target_entropy_scale=student.target_entropy_scale,
        gamma=student.gamma,
        tau=student.tau,
        policy_delay=student.policy_delay,
        policy_updates=student.policy_updates,
        initial_log_std=student.initial_log_std,
        critic_target=student.critic_target,
        policy_average=student.policy_average,
        simultaneous=student.simultaneous,
        lane=lane,
        seed=config.seed,
        device=config.device,
    )


def build_discriminator(config: Config, layout: WindowLayout, reference: Path | None) -> Discriminator | None:
    """The discriminator, with the windows of the reference; None for the baseline and where it has no weight."""
    discriminator = config.discriminator
    if not discriminator.enabled or reference is None or config.eta == 1:
        return None
    arrays = read_imitated(reference, config, steps=layout.span)
    real = reference_windows(
        arrays["features"],
        arrays["episode"],
        layout=layout,
        trunk_std=discriminator.trunk_std,
        trunk_time=discriminator.trunk_time,
        mirror=config.student.mirror,
        seed=config.seed,
    )
    weights = torch.from_numpy(layout.weights(discriminator.sole_weight))
    return Discriminator(
        reference=torch.from_numpy(real),
        standardize=discriminator.standardize,
        weights=weights,
        **discriminator_settings(config),
    )


def discriminator_settings(config: Config) -> dict[str, Any]:
    """What a discriminator is made with, whatever it sees."""
    discriminator = config.discriminator
    return {
        "hidden_sizes": list(discriminator.hidden_sizes),
        "dropout": discriminator.dropout,
        "learning_rate": discriminator.learning_rate,
        "penalty_weight": discriminator.gradient_penalty,
        "label_smoothing": discriminator.label_smoothing,
        "noise": config.noise,
        "reward_limit": discriminator.reward_limit,
        "held_out": discriminator.held_out,
        "patience": discriminator.patience,
        "early_stop": discriminator.early_stop,
        "loss": discriminator.loss,
        "penalty_on": discriminator.penalty_on,
        "accuracy": discriminator.accuracy,
        "seed": config.seed,
        "device": config.device,
    }
