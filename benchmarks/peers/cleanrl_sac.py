"""CleanRL's sac_continuous_action.py as its authors wrote it, run on an environment that only takes the time.

Every control step of the script is one action, one stored transition and, after `learning_starts`, one update. The
time of a step before learning (a random action and the storing) is subtracted, so what is left is the update.
"""

from __future__ import annotations

import os
import runpy
import statistics
import sys
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import torch
from serve import answer, settings, wait

torch.set_num_threads(settings["threads"])
CHECKOUT = os.environ.get("CLEANRL")
WARM_UP = 20  # updates that are not measured, and at least 2 steps for the policy's turn


def script() -> Path | None:
    """File in the user's checkout; None for the package's module."""
    return Path(CHECKOUT) / "cleanrl" / "sac_continuous_action.py" if CHECKOUT else None


def is_old() -> bool:
    """Whether the script is for OpenAI's gym, as the package is; later ones are for Gymnasium."""
    file = script()
    return file is None or "import gymnasium" not in file.read_text(encoding="utf-8")


class Clock:
    """Takes the time of every step and stops between the chunks."""

    def __init__(self) -> None:
        self.stamps: list[float] = []
        self.idle = 0.0
        self.steps = 0

    def tick(self) -> None:
        """One control step begins."""
        self.steps += 1
        now = time.perf_counter()
        learning = self.steps - settings["transitions"] - WARM_UP
        if learning < 0:
            self.stamps.append(now)
        elif learning == 0:
            steps = np.diff(self.stamps[: settings["transitions"] - 1])
            self.idle = statistics.median(steps)
            answer({"cleanrl": name(), "torch threads": torch.get_num_threads(), "step without update, s": self.idle})
            wait()
            self.start = time.perf_counter()
        elif learning % settings["updates"] == 0:
            each = (now - self.start) / settings["updates"] - self.idle
            answer(1 / each)
            wait()
            self.start = time.perf_counter()


def name() -> str:
    """Which CleanRL this is."""
    return f"checkout {CHECKOUT}" if CHECKOUT else version("cleanrl")


clock = Clock()
if is_old():
    import gym
else:
    import gymnasium as gym


class Stopwatch(gym.Env):
    """An environment of the humanoid's sizes whose observations are random and whose episodes do not end."""

    observation_space = gym.spaces.Box(-np.inf, np.inf, (settings["observation"],), np.float32)
    action_space = gym.spaces.Box(-1.0, 1.0, (settings["action"],), np.float32)
    generator = np.random.default_rng(0)

    def seed(self, seed: int | None = None) -> None:
        """Gym's old way to seed; there is nothing to seed."""

    def reset(self, **options: Any) -> Any:
        """Old gym wants the observation alone."""
        observation = np.zeros(self.observation_space.shape, np.float32)
        return observation if is_old() else (observation, {})

    def step(self, action: Any) -> Any:
        """Take the time."""
        clock.tick()
        observation = self.generator.standard_normal(self.observation_space.shape[0], np.float32)
        return (observation, 0.0, False, {}) if is_old() else (observation, 0.0, False, False, {})


gym.register("Stopwatch-v0", entry_point=Stopwatch)
sys.argv = ["sac_continuous_action", "--env-id", "Stopwatch-v0", "--buffer-size", str(2 * settings["transitions"])]
sys.argv += ["--learning-starts", str(settings["transitions"]), "--batch-size", str(settings["batch"])]
file = script()
with patch.object(torch, "set_num_threads"):  # newer versions of the script set a number of their own
    if file is None:
        runpy.run_module("cleanrl.sac_continuous_action", run_name="__main__")
    else:
        sys.path.insert(0, str(CHECKOUT))
        runpy.run_path(str(file), run_name="__main__")
