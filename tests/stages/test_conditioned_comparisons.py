"""What comparisons make of a student that follows commands: each works, or is refused in one line."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from romgrl.algorithms.sac import load_sac_policy
from romgrl.cli.consistency import misfits
from romgrl.humanoid.start_states import MixedStates
from romgrl.runtime.stage_log import SilentLog
from romgrl.stages import student
from romgrl.stages.conditioned import grid_check
from tests.conftest import Composer
from tests.helpers.commanded import commanded, small_library


def test_all_but_the_one_by_sinusoids_are_permitted(compose_config: Composer) -> None:
    for name in ("student", "last_policy", "no_resets", "no_trunk", "same_choice", "same_resets", "upright"):
        assert not [*misfits(compose_config("experiment=every_speed", f"comparison={name}"))], name
    (line,) = misfits(compose_config("experiment=every_speed", "comparison=sinusoid"))
    assert line.startswith("discriminator.imitated: sinusoid is not allowed; allowed: teacher with student.kind=cond")


@pytest.mark.parametrize("comparison", ["upright", "no_resets"])
def test_it_is_trained(
    comparison: str, compose_config: Composer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is left out is left out, and what is asked for is paid."""
    monkeypatch.setattr(grid_check, "STEPS", 20)
    made = []
    training = student.train_student
    monkeypatch.setattr(student, "train_student", lambda *given: (made.append(given[1]), training(*given)))
    library, log = small_library(tmp_path / "library"), SilentLog()
    config = commanded(compose_config, f"comparison={comparison}", "student.total_steps=600")
    student.run(config, {"library": library}, tmp_path, log)
    assert "command.run" in load_sac_policy(tmp_path / "policy.safetensors").names
    learner = made[0].learner
    assert (learner.discriminator is None) == (comparison == "upright")
    assert isinstance(made[0].env._starts, MixedStates) == (comparison != "no_resets")
    batch = learner.draw(256)
    moving = batch.windows[..., learner.relabelling.columns.window] > 0
    assert bool(moving.any())
    assert bool(torch.isfinite(batch.task_reward).all())
    assert learner.relabelling.weight == (0.75 if comparison == "upright" else 1.0)
