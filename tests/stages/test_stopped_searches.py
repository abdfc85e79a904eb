"""teacher=cmaes: a search that is stopped goes on with the same bits, from its own state alone."""

from __future__ import annotations

from base64 import b64decode, b64encode
from pathlib import Path

import numpy as np
import pytest

from romgrl.config.teachers import CMAESTeacher
from romgrl.errors import ArtifactError
from romgrl.runtime.stage_log import SilentLog
from romgrl.stages.training import cmaes_teacher
from romgrl.stages.training.cmaes_teacher import Searches
from romgrl.stages.wiring.teacher_policy import load_phase_policy
from tests.conftest import Composer
from tests.helpers.searches import SMALL, search_of, shorten_checks


@pytest.fixture
def _short_check(monkeypatch: pytest.MonkeyPatch) -> None:
    shorten_checks(monkeypatch)


@pytest.mark.usefixtures("_short_check")
@pytest.mark.parametrize("stopped", [2, 7])  # before and after the best of three is chosen
def test_a_search_that_is_stopped_goes_on_with_the_same_bits(
    stopped: int, compose_config: Composer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = compose_config(*SMALL, "teacher.generations=10", "teacher.scouts=3", "checkpoint_seconds=0.001")
    for name in ("whole", "cut"):
        (tmp_path / name).mkdir()
    whole = SilentLog()
    cmaes_teacher.train_by_cmaes(config, tmp_path / "whole", whole)
    made: list[int] = []
    generation = Searches.generation

    def until_stopped(searches: Searches, number: int) -> dict[str, float]:
        if number > stopped and not made.count(-1):
            made.append(-1)
            raise KeyboardInterrupt
        made.append(number)
        return generation(searches, number)

    monkeypatch.setattr(Searches, "generation", until_stopped)
    cut = SilentLog()
    with pytest.raises(KeyboardInterrupt):
        cmaes_teacher.train_by_cmaes(config, tmp_path / "cut", cut)
    load_phase_policy(tmp_path / "cut" / "policy.safetensors")
    cmaes_teacher.train_by_cmaes(config, tmp_path / "cut", cut)
    assert made == [*range(1, stopped + 1), -1, *range(stopped + 1, 11)]
    assert cut.rows == whole.rows
    for name in ("policy.safetensors", "checks.csv"):
        assert (tmp_path / "cut" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()


def test_a_state_of_other_searches_is_refused(compose_config: Composer) -> None:
    """Before the best of three is chosen, after three of ten generations, and after that."""
    config = compose_config(*SMALL, "teacher.generations=10", "teacher.scouts=3")
    tasks = search_of(config).tasks
    assert isinstance(config.teacher, CMAESTeacher)
    searches = Searches(config.teacher, tasks, 0)
    for number in (1, 2):
        searches.generation(number)
    state = searches.state()
    good, short = np.frombuffer(b64decode(state["losses"])), np.zeros(8 * 4)
    nan, long = np.where(good > 0.5, np.nan, good), np.zeros(3 * 8 * 11)
    for numbers, losses in (
        ([], good),
        ([0, 1], good),
        ([0, 1, 1], good),
        ([0, 1, 2], nan),
        ([-1], short),
        ([3], short),
    ):
        with pytest.raises(ArtifactError, match="none of this training"):
            searches.restore({"numbers": numbers, "losses": b64encode(losses.tobytes()).decode()})
    with pytest.raises(ArtifactError, match="11 generations"):
        searches.restore({"numbers": [2], "losses": b64encode(long[: 8 * 11].tobytes()).decode()})
    with pytest.raises(ValueError, match="reshape"):
        searches.restore({"numbers": [0, 1, 2], "losses": b64encode(good[:-1].tobytes()).decode()})
    with pytest.raises(ArtifactError, match="do not come to the mean"):
        searches.restore(state | {"mean": state["mean"] + 1e-12})
    searches.restore(state)
    np.testing.assert_equal(searches.state(), state)
