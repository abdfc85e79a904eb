"""Stable-Baselines3's PPO on the reduced-order model: environment steps per second of `learn`."""

import time

import stable_baselines3
import torch
from rom_worlds import SB3Worlds, make
from serve import serve, settings

torch.set_num_threads(settings["threads"])
ACTIVATIONS = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU, "elu": torch.nn.ELU}
model = stable_baselines3.PPO(
    "MlpPolicy",
    SB3Worlds(make(settings, settings["num_envs"])),
    n_steps=settings["rollout_steps"],
    n_epochs=settings["epochs"],
    batch_size=settings["minibatch_size"],
    learning_rate=settings["learning_rate"],
    gamma=settings["gamma"],
    gae_lambda=settings["gae_lambda"],
    clip_range=settings["clip_ratio"],
    vf_coef=settings["value_coefficient"],
    ent_coef=settings["entropy_coefficient"],
    max_grad_norm=settings["max_gradient_norm"],
    policy_kwargs={
        "net_arch": {"pi": settings["hidden_sizes"], "vf": settings["hidden_sizes"]},
        "activation_fn": ACTIVATIONS[settings["activation"]],
        "log_std_init": settings["initial_log_std"],
    },
    device="cpu",
    seed=0,
)


def chunk() -> float:
    """Steps per second of some rollouts and their updates."""
    start = time.perf_counter()
    model.learn(settings["steps"], reset_num_timesteps=False)
    return settings["steps"] / (time.perf_counter() - start)


serve({"stable-baselines3": stable_baselines3.__version__, "torch threads": torch.get_num_threads()}, chunk)
