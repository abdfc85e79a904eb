"""A measure of the gait of your own, the share of time in the air.

It is a row of MEASURES in romgrl/gait/measures.py and a value in `describe` of romgrl/gait/metrics.py; tables, reports,
MLflow and sweeps take it from there.
"""

import numpy as np

from romgrl.cli.compose import compose_config
from romgrl.gait.features import Bools
from romgrl.gait.measures import MEASURES, Measure
from romgrl.provenance.shipped import PLACE
from romgrl.report.numbers import measured
from romgrl.stages.wiring.rom import rom_env
from romgrl.stages.wiring.teacher_policy import read_teacher

MEASURES["flight_share"] = Measure("flight", decimals=2, meaning="share of the time in which no foot is on the ground")


def flight_share(contact: Bools, valid: Bools) -> float:
    """Share of the valid steps (E, T) without contact (E, T, 2); above zero the gait is a run."""
    return float((~contact.any(axis=2))[valid].mean())


def main() -> float:
    """Of the teacher that ships, over ten seconds after two that it takes to settle."""
    config = compose_config("teacher=pretrained", "threads=1")
    env = rom_env(config, num_envs=8, episode_steps=400)
    policy, contact = read_teacher(PLACE / "teacher", config, env), np.zeros((8, 360, 2), bool)
    observation, _ = env.reset(seed=0)
    for step in range(360):
        observation, _, _, _, info = env.step(policy(observation))
        contact[:, step] = info["contact"]
    env.close()
    return flight_share(contact[:, 60:], np.ones((8, 300), bool))


if __name__ == "__main__":
    print(MEASURES["flight_share"].title, measured("flight_share", main()))
