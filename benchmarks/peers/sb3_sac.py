"""Stable-Baselines3's SAC on random transitions: updates per second of `train`, as `learn` calls it."""

import time

import gymnasium
import numpy as np
import stable_baselines3
import torch
from serve import serve, settings

torch.set_num_threads(settings["threads"])
OBSERVATION, ACTION = settings["observation"], settings["action"]


class Nothing(gymnasium.Env):
    """Spaces without a world."""

    observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (OBSERVATION,), np.float32)
    action_space = gymnasium.spaces.Box(-1.0, 1.0, (ACTION,), np.float32)


model = stable_baselines3.SAC(
    "MlpPolicy",
    Nothing(),
    batch_size=settings["batch"],
    buffer_size=settings["transitions"],
    policy_kwargs={"net_arch": settings["hidden"]},
    device="cpu",
    seed=0,
)
model.set_logger(stable_baselines3.common.logger.Logger(None, []))
generator = np.random.default_rng(0)
for _ in range(settings["transitions"]):
    rows = generator.standard_normal((2, 1, OBSERVATION), np.float32)
    action = generator.uniform(-1, 1, (1, ACTION)).astype(np.float32)
    model.replay_buffer.add(rows[0], rows[1], action, generator.uniform(size=1), np.zeros(1), [{}])


def chunk() -> float:
    """Updates per second, sampling included."""
    start = time.perf_counter()
    model.train(gradient_steps=settings["updates"], batch_size=settings["batch"])
    return settings["updates"] / (time.perf_counter() - start)


serve(
    {
        "stable-baselines3": stable_baselines3.__version__,
        "policy updates per update": 1,
        "target updates per update": 1,
        "critics": model.n_critics if hasattr(model, "n_critics") else 2,
        "learning rate": model.learning_rate,
        "torch threads": torch.get_num_threads(),
    },
    chunk,
)
