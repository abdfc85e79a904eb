"""Which policy of a training is kept: of those along its second half, the one that earns most."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from romgrl.algorithms.networks.stacked_mlp import StackedMLP
from romgrl.algorithms.rom_grl import RomGrl
from romgrl.algorithms.sac import SACPolicy
from romgrl.config.schema import Config
from romgrl.gait.discriminator_windows import FrameWindows, WindowLayout
from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv
from romgrl.runtime.stage_log import StageLog
from romgrl.stages.training.budget import Budget
from romgrl.stages.wiring.humanoid import humanoid_env

EPISODES, STEPS = 16, 300
FILE = "selection.csv"


@dataclass
class Candidates:
    """`count` averaged policies, evenly spaced over the second half of a budget, with the moments they need."""

    count: int
    steps: list[int] = field(default_factory=list)
    weights: list[Tensor] = field(default_factory=list)
    moments: list[tuple[Tensor, Tensor]] = field(default_factory=list)

    def keep(self, step: int, budget: Budget, learner: RomGrl) -> None:
        """Take in the policy as it is after `step`, where one is due; the last one is due at the end."""
        if len(self.steps) < self.count and budget.reached(step, (1 + (len(self.steps) + 1) / self.count) / 2):
            self.steps.append(step)
            self.weights.append(learner.sac.average.flat.clone())
            self.moments.append(learner.normalizer.mean_and_scale())

    def state(self) -> dict[str, Any]:
        """Everything that `restore` needs."""
        if not self.steps:
            return {"steps": []}
        means, scales = (torch.stack(parts) for parts in zip(*self.moments, strict=True))
        return {"steps": list(self.steps), "weights": torch.stack(self.weights), "means": means, "scales": scales}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a state."""
        self.steps = [int(step) for step in state["steps"]]
        self.weights = list(state["weights"]) if self.steps else []
        self.moments = list(zip(state["means"], state["scales"], strict=True)) if self.steps else []


def choose(
    config: Config,
    learner: RomGrl,
    candidates: Candidates,
    columns: Tensor,
    layout: WindowLayout,
    output: Path,
    log: StageLog,
) -> tuple[Tensor, Tensor]:
    """Give the agent's averaged policy the weights of the best candidate, and return its mean and scale.

    The reward is the one of the training, eta r_env + (1 - eta) r_im, with the discriminator as it is at the end: one
    judge for all. selection.csv has what each earns per step and in how many episodes it stays upright.
    """
    if not candidates.steps:
        return learner.normalizer.mean_and_scale()
    env = humanoid_env(config, num_envs=EPISODES, episode_steps=STEPS + 1)
    network, rows = StackedMLP(stack=1, **learner.sac.network), []
    for step, weights, moments in zip(candidates.steps, candidates.weights, candidates.moments, strict=True):
        network.flat.copy_(weights)
        policy = SACPolicy(network, columns, *(part.cpu() for part in moments))
        rows.append({"step": step, **earned(env, policy, learner, layout, seed=config.seed)})
    env.close()
    table = pd.DataFrame(rows)
    table.to_csv(output / FILE, index=False)
    best = int(table.reward.to_numpy().argmax())
    learner.sac.average.flat.copy_(candidates.weights[best])
    earnings = f"reward {table.reward[best]:.3f} per step, the last one {table.reward.iloc[-1]:.3f}"
    log.message(f"kept the policy of step {table.step[best]:,}: {earnings}")
    return candidates.moments[best]


def earned(
    env: PlanarHumanoidVectorEnv, policy: SACPolicy, learner: RomGrl, layout: WindowLayout, *, seed: int
) -> dict[str, float]:
    """Total reward per step, nothing after a fall, and share of episodes upright to the end, from the same resets."""
    observation, info = env.reset(seed=seed)
    windows = FrameWindows(num_envs=env.num_envs, layout=layout)
    windows.restart(layout.frame(info))
    upright, total = np.ones(env.num_envs, np.bool_), 0.0
    for _ in range(STEPS):
        observation, task_reward, terminated, _, info = env.step(policy(observation))
        upright &= ~terminated
        imitation = learner.imitation(torch.from_numpy(windows.push(layout.frame(info)))).cpu().numpy()
        total += float((upright * (learner.eta * task_reward + (1 - learner.eta) * imitation)).sum())
    return {"reward": total / (STEPS * env.num_envs), "upright_share": float(upright.mean())}
