"""The examples of the documents run, and show what they say."""

from __future__ import annotations

import numpy as np
import pytest

from romgrl.algorithms.adversarial_losses import LOSSES
from romgrl.algorithms.sac import load_sac_policy
from romgrl.cli.arguments import faults
from romgrl.gait.measures import MEASURES
from romgrl.humanoid.skeleton import SKELETONS
from romgrl.provenance.stage_graph import STAGES
from tests.helpers.examples import EXAMPLES, example


@pytest.fixture(autouse=True)
def registries_as_before() -> object:
    """What an example registers is gone after it."""
    before = [(registry, dict(registry)) for registry in (LOSSES, MEASURES, SKELETONS, STAGES)]
    yield
    for registry, entries in before:
        registry.clear()
        registry.update(entries)


def test_each_is_short() -> None:
    for path in EXAMPLES.glob("*.py"):
        assert len(path.read_text(encoding="utf-8").splitlines()) <= 60, path.name


def test_a_variant_of_the_reduced_order_model() -> None:
    assert faults([f"--config-dir={EXAMPLES}/presets", "rom=stiff_legs"]) == []


def test_a_loss_of_the_discriminator() -> None:
    found = example("discriminator_loss").main()
    assert found["accuracy"] > 0.95
    assert found["teacher"] > 0.9 > 0.1 > found["student"]


def test_a_measure_of_the_gait() -> None:
    assert 0.2 < example("gait_measure").main() < 0.5  # a run: duty factor about 0.3


def test_a_stage() -> None:
    lines = example("stage").main().read_text(encoding="utf-8").splitlines()
    heights = [float(line.partition(",")[2]) for line in lines[1:]]
    assert heights == sorted(heights)
    assert 0.7 < heights[0] < heights[-1] < 1.1


def test_another_body() -> None:
    policy = load_sac_policy(example("other_body").main(1000))
    assert policy.policy.sizes[-1] == 2 * 7  # mean and spread for each of its hinges


def test_commands() -> None:
    commands = example("commands")
    earned, relabelled = commands.drawn(60)
    assert 0 < relabelled.mean() < earned.mean()  # 3 m/s is further off than what most were asked for
    assert commands.played(121)[[0, 30, 60, 90, 120]] == pytest.approx([1, 2, 3, 2, 1], abs=1e-6)
    assert commands.steered() == [[1.0, 1.0, 0.0, 1.0], [2.0, 0.5, 0.5, 1.0]]


def test_legs_with_motors() -> None:
    asked, power = example("legs_with_motors").main(10)
    assert ((asked >= 1.5) & (asked <= 5.0)).all()
    assert np.ptp(asked) > 1.0
    assert (power > 0).any()


def test_sac_on_another_environment() -> None:
    rewards = example("sac_on_your_environment").main(1000)
    assert rewards[-200:].mean() > 2 * rewards[:200].mean()  # both below zero
    assert rewards[-200:].mean() > -3.0
