"""When the discriminator stops learning: with the paper's numbers on a real reference, and on one learned by heart."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from romgrl.algorithms.discriminator import Discriminator
from romgrl.cli.compose import compose_config
from romgrl.config.schema import Config
from romgrl.gait.discriminator_windows import FrameWindows, WindowLayout
from romgrl.provenance.shipped import PLACE
from romgrl.runtime.stage_log import SilentLog
from romgrl.stages import reference
from romgrl.stages.wiring.humanoid import humanoid_env
from romgrl.stages.wiring.student_learner import build_discriminator

PAPER = WindowLayout("paper", 1)


@pytest.fixture(scope="module")
def config() -> Config:
    return compose_config("discriminator=paper", "teacher=pretrained", "threads=1")


@pytest.fixture(scope="module")
def recorded(config: Config, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The reference of the teacher that ships with the package."""
    output = tmp_path_factory.mktemp("reference")
    reference.run(config, {"teacher": PLACE / "teacher"}, output, SilentLog())
    return output


@pytest.fixture(scope="module")
def untrained(config: Config) -> Tensor:
    """Frames of a humanoid that acts at random, (N, 5)."""
    env, windows = humanoid_env(config, num_envs=16), FrameWindows(num_envs=16, layout=PAPER)
    _, info = env.reset(seed=0)
    windows.restart(PAPER.frame(info))
    random, seen = np.random.default_rng(0), []
    for _ in range(100):
        actions = random.uniform(-1, 1, (16, env.model.nu)).astype(np.float32)
        _, _, terminated, truncated, info = env.step(actions)
        seen.append(windows.push(PAPER.frame(info)).copy())
        windows.restart(PAPER.frame(info, "reset_"), terminated | truncated)
    return torch.from_numpy(np.concatenate(seen))


def updates_until_stopped(discriminator: Discriminator, fake: Tensor, most: int) -> int:
    """Updates that it makes before it stops, at most `most`."""
    drawn = torch.Generator().manual_seed(1)
    while discriminator.updates < most and not discriminator.stopped:
        discriminator.update(fake[torch.randint(len(fake), (256,), generator=drawn)])
    return discriminator.updates


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_chance_does_not_stop_it(config: Config, recorded: Path, untrained: Tensor, seed: int) -> None:
    """The paper's learning rate, patience and network, on a reference that it does not learn by heart."""
    config.seed, config.discriminator.early_stop = seed, "gap"
    discriminator = build_discriminator(config, PAPER, recorded)
    assert discriminator is not None
    assert discriminator.patience == 10
    assert updates_until_stopped(discriminator, untrained, 500) == 500


def test_the_papers_words_are_a_matter_of_luck(config: Config, recorded: Path, untrained: Tensor) -> None:
    """A new lowest held-out loss within ten updates: one seed goes on, another stops before it has learned a thing."""
    config.discriminator.early_stop = compose_config("discriminator=paper").discriminator.early_stop
    assert config.discriminator.early_stop == "held_out"
    updates = []
    for config.seed in range(3):
        discriminator = build_discriminator(config, PAPER, recorded)
        assert discriminator is not None
        updates.append(updates_until_stopped(discriminator, untrained, 200))
    assert min(updates) < 50 < max(updates)


def test_a_reference_learned_by_heart_stops_it() -> None:
    """Sixty windows of noise in twenty columns, a large network, no dropout, no noise, no penalty."""
    generator = torch.Generator().manual_seed(0)
    reference = torch.randn((60, 20), generator=generator)
    fake = torch.randn((5000, 20), generator=generator)
    discriminator = Discriminator(
        reference=reference,
        hidden_sizes=[256, 256],
        dropout=0.0,
        learning_rate=1e-3,
        penalty_weight=0.0,
        label_smoothing=0.1,
        noise=0.0,
        reward_limit=None,
        held_out=0.3,
        patience=10,
        standardize=True,
        seed=0,
    )
    assert updates_until_stopped(discriminator, fake, 1000) < 200
