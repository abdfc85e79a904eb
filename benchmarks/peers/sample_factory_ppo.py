"""Sample Factory's APPO on the reduced-order model: environment steps per second between its training steps.

Its runner starts and ends with a run, so every chunk is one run in a process of its own, without its start.
"""

from __future__ import annotations

import math
import multiprocessing
import os
import sys
import tempfile
import time
from importlib.metadata import version
from typing import Any

import gymnasium
import numpy as np
import torch
from rom_worlds import make
from serve import serve, settings

WARM_UP = 3  # training steps before the measured ones


def from_inside(wrapper: gymnasium.Wrapper[Any, Any, Any, Any], name: str) -> Any:
    """Attributes of the wrapped environment, as Gymnasium had them before 1.0, for which Sample Factory was written."""
    if name == "env" or name.startswith("_"):
        raise AttributeError(name)
    return getattr(wrapper.env, name)


gymnasium.Wrapper.__getattr__ = from_inside


class Worlds(gymnasium.Env[Any, Any]):
    """Sample Factory's batched environment: all worlds as agents of one."""

    def __init__(self, count: int) -> None:
        self.env = make(settings, count)
        self.observation_space, self.action_space = self.env.single_observation_space, self.env.single_action_space
        self.num_agents, self.is_multiagent, self.render_mode = count, True, None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        """All worlds anew."""
        return torch.from_numpy(self.env.reset(seed=seed or 0)[0].copy()), {}

    def step(self, action: Any) -> Any:
        """One control step; the arrays are copied because those of the environment are reused."""
        results = self.env.step(np.asarray(action, np.float32))[:4]
        return *(torch.from_numpy(array.copy()) for array in results), {}


def make_worlds(name: str, cfg: Any = None, env_config: Any = None, render_mode: str | None = None) -> Worlds:
    """As Sample Factory calls it."""
    return Worlds(settings["num_envs"] // cfg.num_envs_per_worker)


def arguments(directory: str) -> list[str]:
    """The teacher's settings in Sample Factory's words, and the mode of running."""
    synchronous = settings["mode"] == "synchronous"
    rollout = settings["num_envs"] * settings["rollout_steps"]
    values = {
        "algo": "APPO",
        "env": "worlds",
        "experiment": "benchmark",
        "train_dir": directory,
        "device": "cpu",
        "seed": 0,
        "serial_mode": synchronous,
        "async_rl": not synchronous,
        "batched_sampling": True,
        "num_workers": 1,
        "num_envs_per_worker": 1 if synchronous else 2,
        "worker_num_splits": 1 if synchronous else 2,
        "rollout": settings["rollout_steps"],
        "batch_size": settings["minibatch_size"],
        "num_batches_per_epoch": rollout // settings["minibatch_size"],
        "num_epochs": settings["epochs"],
        "shuffle_minibatches": True,
        "use_rnn": False,
        "recurrence": 1,
        "actor_critic_share_weights": False,
        "nonlinearity": settings["activation"],
        "adaptive_stddev": False,
        "initial_stddev": math.exp(settings["initial_log_std"]),
        "learning_rate": settings["learning_rate"],
        "gamma": settings["gamma"],
        "gae_lambda": settings["gae_lambda"],
        "ppo_clip_ratio": settings["clip_ratio"],
        "value_loss_coeff": settings["value_coefficient"],
        "exploration_loss_coeff": settings["entropy_coefficient"],
        "max_grad_norm": settings["max_gradient_norm"],
        "normalize_input": False,
        "normalize_returns": False,
        "train_for_env_steps": settings["steps"] + WARM_UP * rollout,
        "save_every_sec": 10_000,
        "decorrelate_experience_max_seconds": 0,
        "set_workers_cpu_affinity": False,
    }
    sizes = ["--encoder_mlp_layers", *map(str, settings["hidden_sizes"])]
    return [f"--{name}={value}" for name, value in values.items()] + sizes


def train(found: Any) -> None:
    """One run; puts its steps per second."""
    from sample_factory.algo.runners.runner import AlgoObserver
    from sample_factory.cfg.arguments import parse_full_cfg, parse_sf_args
    from sample_factory.envs.env_utils import register_env
    from sample_factory.train import make_runner

    stamps: list[tuple[int, float]] = []

    class Clock(AlgoObserver):
        def on_training_step(self, runner: Any, training_iteration_since_resume: int) -> None:
            stamps.append((sum(runner.env_steps.values()), time.perf_counter()))

    torch.set_num_threads(settings["threads"])
    register_env("worlds", make_worlds)
    with tempfile.TemporaryDirectory() as directory:
        parser, _ = parse_sf_args(arguments(directory))
        _, runner = make_runner(parse_full_cfg(parser, arguments(directory)))
        runner.register_observer(Clock())
        runner.init()
        runner.run()
    (first, start), (last, end) = stamps[WARM_UP], stamps[-1]
    found.put((last - first) / (end - start))


def chunk() -> float:
    """One run in its own process."""
    context = multiprocessing.get_context("spawn")
    found: Any = context.Queue()
    process = context.Process(target=train, args=(found,))
    process.start()
    while process.is_alive() and found.empty():
        time.sleep(0.05)
    if found.empty():
        print("the run ended without a number", file=sys.stderr)
        os._exit(1)
    value = float(found.get())
    process.join()
    return value


if __name__ == "__main__":
    serve({"sample-factory": version("sample-factory"), "mode": settings["mode"]}, chunk)
