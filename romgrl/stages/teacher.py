"""Teacher: it learns a gait on the reduced-order model (paper section 3.2)."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path

from romgrl.config.schema import Config
from romgrl.gait import human_bands
from romgrl.gait.footfall import FOOTFALLS
from romgrl.gait.metrics import describe
from romgrl.gait.recording import record
from romgrl.runtime.stage_log import StageLog
from romgrl.stages.training.cmaes_teacher import train_by_cmaes
from romgrl.stages.training.ppo_teacher import train_by_ppo
from romgrl.stages.training.speed_check import STEADY, STEPS
from romgrl.stages.wiring.commands import checked_tasks, name_of_task
from romgrl.stages.wiring.jumps_asked import jumps_asked
from romgrl.stages.wiring.rom import rom_env
from romgrl.stages.wiring.seeds import TEACHER_GAIT_SEED
from romgrl.stages.wiring.teacher_policy import read_teacher

CHECK_EPISODES = 100
ALGORITHMS = {"ppo": train_by_ppo, "cmaes": train_by_cmaes}
"""How a teacher learns, by `teacher.algorithm`: each writes policy.safetensors, checks.csv and curve.csv."""


def run(config: Config, inputs: Mapping[str, Path], output: Path, log: StageLog) -> None:
    """Train the teacher; write policy.safetensors, checks.csv, curve.csv (through `log`) and gait.csv of the policy."""
    ALGORITHMS[config.teacher.algorithm](config, output, log)
    rows = []
    for at in checked_tasks(config):
        row = gait_row(at, output)
        rows.append({"walker": name_of_task(at), **row})
        told = "" if name_of_task(at) == "teacher" else f"{name_of_task(at)}: "
        log.message(
            f"{told}{row['falls']:.0f} falls in {CHECK_EPISODES} episodes, {row['mean_speed_m_per_s']:.2f} m/s, "
            f"left-right correlation {row['left_right_correlation']:.2f}, {row['stride_frequency_hz']:.2f} strides/s"
        )
        compared = human_bands.COMPARED_WITH.get(at.teacher.gait, ())
        if at.teacher.apex:
            log.message(
                f"{told}{row['jumps']:.0f} jumps to {row['jump_apex_m']:.3f} m, "
                f"{100 * row['jump_apex_error_m']:.1f} cm from what was asked"
            )
        log.message(f"{told}{human_bands.human_verdict(row, at.teacher.speed, compared)}")
    write_gaits(output / "gait.csv", rows)


def gait_row(config: Config, directory: Path) -> dict[str, float]:
    """What the finished policy does at the speed of a configuration in CHECK_EPISODES from resets that no training saw.

    Falls count from the reset on, the gait over the steps that a check of the speed counts.
    """
    env = rom_env(config, num_envs=CHECK_EPISODES, episode_steps=STEPS + 1)
    policy = read_teacher(directory, config, env)
    gait = record(env, policy, steps=STEPS, seed=config.seed + TEACHER_GAIT_SEED, dt=env.dt)
    gait.valid[:, :-STEADY] = False
    hops = FOOTFALLS[config.teacher.gait].together
    row = describe(gait, target_speed=config.teacher.speed, mass=env.parameters.mass, hops=hops)
    return row | jumps_asked(config, gait, env.parameters)


def write_gaits(path: Path, rows: Sequence[Mapping[str, object]]) -> None:
    """Rows of CSV with their header."""
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([rows[0].keys(), *(row.values() for row in rows)])
