"""A training that was cut anywhere and goes on ends with the bits of one that was not."""

from __future__ import annotations

import random
import shutil
from pathlib import Path

import pytest

from romgrl.checkpoint import CHECKPOINT
from romgrl.interruption import Interrupted
from tests.conftest import Composer
from tests.faults.trainings import TOTAL, Recorder, files, train, training

CUTS = 10


@pytest.mark.parametrize("name", ["teacher", "student"])
def test_resume_is_bit_exact(
    name: str, compose_config: Composer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Networks, targets, optimisers, temperature, discriminator, normaliser, buffer, environments, random streams."""
    config = training(name, compose_config)
    recorder = Recorder(monkeypatch)
    train(name, config, tmp_path / "whole")
    whole, passes = (recorder.state, files(tmp_path / "whole")), recorder.steps
    cuts, equal = random.Random(0).sample(passes[:-1], CUTS), 0
    for cut in cuts:
        output = tmp_path / f"cut-{cut}"
        recorder.cut = cut
        recorder.again()
        with pytest.raises(Interrupted):
            train(name, config, output)
        assert recorder.steps[-1] == cut
        recorder.again()
        train(name, config, output)
        assert recorder.steps == [step for step in passes if step > cut]
        assert (recorder.state, files(output)) == whole, f"cut at step {cut}"
        equal += 1
        shutil.rmtree(output / CHECKPOINT)
    print(f"{name}: cut at {sorted(cuts)} of {TOTAL[name]}: {equal} of {CUTS} end with the same bits")
