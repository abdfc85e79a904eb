"""Robustness: how often student and baseline fall under pushes, observation noise, and other masses and grounds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from gymnasium.spaces import flatdim
from numpy.typing import NDArray
from scipy.stats import binomtest

from romgrl.algorithms.sac import SACPolicy
from romgrl.config.schema import Config
from romgrl.gait.metrics import SETTLING_TIME, mean_speed
from romgrl.humanoid.changed_body import scaled
from romgrl.humanoid.model import configured
from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv
from romgrl.report.fall_rate_figure import fall_rates
from romgrl.report.style import save
from romgrl.runtime.stage_log import StageLog
from romgrl.stages.rollouts.disturbed import Outcome, Start, disturb, walk_in
from romgrl.stages.rollouts.orbital_stability import teacher_multipliers, verdict
from romgrl.stages.wiring.artifact_arrays import WALKERS
from romgrl.stages.wiring.humanoid import humanoid_env
from romgrl.stages.wiring.seeds import ROBUSTNESS_SEED
from romgrl.stages.wiring.teacher_strides import teacher_strides
from romgrl.stages.wiring.walker_policy import read_walker

STRIDE_TIME = 1.0  # s that hold a stride at any speed: a disturbance begins at a random time within them


@dataclass(frozen=True)
class Disturbance:
    """One disturbance at one level, in the unit of its configuration key."""

    name: str
    level: float
    unit: str


def run(config: Config, inputs: Mapping[str, Path], output: Path, log: StageLog) -> None:
    """Write robustness.csv, the figure fall_rates, and floquet.csv of the teacher.

    All trials of a level, and of both walkers, begin at the same resets: curves differ by walker and level only.
    """
    table = measure(config, inputs, log)
    table.to_csv(output / "robustness.csv", index=False)
    save(fall_rates(table, config.speed), output, "fall_rates")
    for line in headlines(table):
        log.message(line)
    strides = teacher_strides(config, inputs["teacher"])
    if strides is None:
        log.message(f"teacher: no multipliers, rom.model={config.rom.model} has no return map")
        return
    orbit = teacher_multipliers(strides, config.robustness.orbit_worlds, config.seed)
    orbit.to_csv(output / "floquet.csv", index=False)
    log.message(verdict(orbit))


def measure(config: Config, inputs: Mapping[str, Path], log: StageLog) -> pd.DataFrame:
    """robustness.csv: one row per disturbance, level and walker."""
    dt = 1.0 / config.humanoid.control_frequency
    steps, delays = max(1, round(config.robustness.horizon / dt)), settling_steps(config)
    longest = int(delays.max())
    todo = disturbances(config)
    env = humanoid_env(config, num_envs=config.robustness.trials, episode_steps=longest + steps + 1)
    policies = {walker: read_walker(inputs[walker], env) for walker in WALKERS}
    total = len(WALKERS) * (longest + len(todo) * steps)
    ticks = iter(range(1, total + 1))

    def tick() -> None:
        log.progress(next(ticks), total)

    starts = {
        walker: walk_in(env, policy, delays, seed=config.seed + ROBUSTNESS_SEED, tick=tick)
        for walker, policy in policies.items()
    }
    spread = observation_spread(list(policies.values()), flatdim(env.single_observation_space))
    rows = []
    for one in todo:
        changed = environment(config, env, one)
        for walker, policy in policies.items():
            outcome = disturb(
                changed,
                policy,
                starts[walker],
                steps=steps,
                force=force(config, one, env.dimensions.mass),
                push_steps=push_steps(config),
                noise=np.float32(one.level) * spread if one.name == "observation_noise" else None,
                seed=config.seed + ROBUSTNESS_SEED,
                tick=tick,
            )
            rows.append(row(one, walker, starts[walker], outcome))
        if changed is not env:
            changed.close()
    env.close()
    return pd.DataFrame(rows)


def disturbances(config: Config) -> list[Disturbance]:
    """Every disturbance at every level, in the order of robustness.csv."""
    levels = config.robustness
    named: list[tuple[str, list[float], str]] = [
        ("push_forward", levels.push_impulse, "N s/kg"),
        ("push_backward", levels.push_impulse, "N s/kg"),
        ("observation_noise", levels.observation_noise, "standard deviations"),
        ("mass", levels.mass, "share"),
        ("friction", levels.friction, "share"),
    ]
    return [Disturbance(name, level, unit) for name, values, unit in named for level in values]


def settling_steps(config: Config) -> NDArray[np.int64]:
    """Control steps (trials,) from reset until the disturbance: SETTLING_TIME, and up to STRIDE_TIME by chance."""
    low, width = (round(seconds * config.humanoid.control_frequency) for seconds in (SETTLING_TIME, STRIDE_TIME))
    generator = np.random.default_rng(config.seed + ROBUSTNESS_SEED)
    return max(1, low) + generator.integers(max(1, width), size=config.robustness.trials)


def push_steps(config: Config) -> int:
    """Control steps that a push lasts."""
    return max(1, round(config.robustness.push_duration * config.humanoid.control_frequency))


def force(config: Config, one: Disturbance, mass: float) -> float:
    """Forward force in N that gives a body of `mass` kg its impulse over `push_steps`; 0 unless it is a push."""
    sign = {"push_forward": 1.0, "push_backward": -1.0}.get(one.name, 0.0)
    return sign * one.level * mass * config.humanoid.control_frequency / push_steps(config)


def environment(config: Config, env: PlanarHumanoidVectorEnv, one: Disturbance) -> PlanarHumanoidVectorEnv:
    """The environment of a disturbance: another one where the model is another."""
    if one.name not in ("mass", "friction"):
        return env
    body = scaled(configured(config.humanoid), **{one.name: one.level})
    return humanoid_env(config, num_envs=env.num_envs, episode_steps=env.task.episode_steps, body=body)


def observation_spread(policies: list[SACPolicy], size: int) -> NDArray[np.float32]:
    """Standard deviation (size,) of each entry of the observation as the trainings standardised it: root mean square
    over the walkers, so that the same noise meets them all. Zero for entries that no policy reads."""
    variance = np.zeros((len(policies), size))
    for index, policy in enumerate(policies):
        variance[index, policy.columns.numpy()] = policy.scale.double().numpy() ** -2
    spread: NDArray[np.float32] = np.sqrt(variance.mean(axis=0)).astype(np.float32)
    return spread


def row(one: Disturbance, walker: str, start: Start, outcome: Outcome) -> dict[str, object]:
    """One row of robustness.csv, with the 95% interval of Wilson (1927, J. Am. Stat. Assoc. 22:209) of the rate."""
    trials, falls = len(outcome.fallen), int(outcome.fallen.sum())
    interval = binomtest(falls, trials).proportion_ci(0.95, method="wilson")
    return {
        "perturbation": one.name,
        "level": one.level,
        "unit": one.unit,
        "walker": walker,
        "trials": trials,
        "falls": falls,
        "fall_rate": falls / trials,
        "low": interval.low,
        "high": interval.high,
        "falls_before": int(start.fallen.sum()),
        "mean_speed_m_per_s": mean_speed(outcome.velocity, outcome.upright),
    }


def extremes(levels: pd.Series) -> tuple[float, float]:
    """The lowest and the highest level."""
    return float(levels.min()), float(levels.max())


def headlines(table: pd.DataFrame) -> Iterator[str]:
    """One line per disturbance: each walker's fall rate at the first and the last level."""
    for name, part in table.groupby("perturbation", sort=False):
        first, last = (part[part.level == level].set_index("walker").fall_rate for level in extremes(part.level))
        rates = [f"{walker} {first[walker]:.0%} to {last[walker]:.0%}" for walker in WALKERS]
        low, high = extremes(part.level)
        yield f"{name} {low:g} to {high:g} {part.unit.iloc[0]}: {', '.join(rates)} of the trials fell"
