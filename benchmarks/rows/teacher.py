"""The teacher's training beside PPO of the peers, on the same environment."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmarks.measure import Options, Result, compare
from benchmarks.peers import started
from benchmarks.setup import configuration
from romgrl.config.schema import Config
from romgrl.config.teachers import ppo_keys
from romgrl.runtime.stage_log import SilentLog
from romgrl.stages import teacher
from romgrl.stages.wiring.rom import rom_env

ROLLOUTS = 12  # measured after a first one; a training has hundreds, all alike
KEYS = [
    *("num_envs", "rollout_steps", "epochs", "minibatch_size", "hidden_sizes", "activation", "learning_rate"),
    *("gamma", "gae_lambda", "clip_ratio", "value_coefficient", "entropy_coefficient", "max_gradient_norm"),
    *("initial_log_std", "episode_steps", "alpha", "speed"),
]
MODES = ("synchronous", "asynchronous")  # of Sample Factory


class StampedLog(SilentLog):
    """Remembers when each step was reported."""

    def __init__(self) -> None:
        super().__init__()
        self.stamps: list[tuple[int, float]] = []

    def metrics(self, values: Mapping[str, float], step: int) -> None:
        """Take the time."""
        super().metrics(values, step)
        self.stamps.append((step, time.perf_counter()))


def training_rate(config: Config) -> float:
    """Environment steps per second of the stage between its first and its last report."""
    log = StampedLog()
    with tempfile.TemporaryDirectory() as directory:
        teacher.run(config, {}, Path(directory), log)
    (first, start), (last, end) = log.stamps[0], log.stamps[-1]
    return (last - first) / (end - start)


def comparable(options: Options, *overrides: str) -> Config:
    """The default teacher without mirrored batches, which the peers do not have, and as many rollouts as are timed."""
    config = configuration("teacher.mirror=false", "teacher.check_steps=0", *overrides, threads=options.threads)
    rollouts = 1 + max(3, options.scaled(ROLLOUTS))
    keys = ppo_keys(config.teacher)
    keys.total_steps = rollouts * keys.num_envs * keys.rollout_steps
    return config


def beside_peer(options: Options, script: str, target: str, repeats: int, **more: Any) -> Result:
    """Training steps per second in alternation with a peer."""
    config = comparable(options)
    same = {name: getattr(config.teacher, name) for name in KEYS}
    same["hidden_sizes"] = list(same["hidden_sizes"])
    world = vars(rom_env(config, num_envs=1, episode_steps=1).parameters)
    steps = ppo_keys(config.teacher).total_steps
    with started("rl", script, threads=options.threads, parameters=world, steps=steps, **same, **more) as peer:
        return compare(
            lambda: training_rate(config),
            peer.measure,
            unit="env steps/s",
            target=target,
            settings={
                "both": same,
                "threads": options.threads,
                "engine": world["engine"],
                "ours": "stage=teacher, teacher.mirror=false",
                "peer": peer.settings,
                "steps per round": steps,
            },
            repeats=repeats,
        )


def beside_sb3(options: Options) -> Result:
    """Stable-Baselines3's PPO."""
    return beside_peer(options, "sb3_ppo.py", ">= 3", options.repeats)


def beside_sample_factory(options: Options) -> Result:
    """Sample Factory's APPO, in whichever of its modes is the faster one here."""
    rounds = 1 if options.quick else 3
    modes = {mode: beside_peer(options, "sample_factory_ppo.py", ">= 2", rounds, mode=mode) for mode in MODES}
    best = max(modes.values(), key=lambda result: result.reference or 0.0)
    rates = {f"{mode}, env steps/s": result.reference for mode, result in modes.items()}
    return replace(best, settings={**best.settings, "modes": rates})
