"""The documents of the project are what its kept numbers say: nothing in them is typed in by hand."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pandas as pd
import pytest

from romgrl.results.__main__ import main
from romgrl.results.evaluation_index import select
from romgrl.results.results_document import PAPER, merged
from romgrl.results.sweep_cells import results
from romgrl.results.sweep_record import sweeps
from tests.conftest import Composer

ROOT = Path(__file__).resolve().parents[2]
NUMBERS = ROOT / "docs" / "numbers"


def test_documents_are_what_is_kept(tmp_path: Path) -> None:
    docs, readme = tmp_path / "docs", tmp_path / "README.md"
    shutil.copy(ROOT / "README.md", readme)
    assert main([str(NUMBERS), str(docs), str(readme)]) == 0
    assert readme.read_text(encoding="utf-8") == (ROOT / "README.md").read_text(encoding="utf-8")
    assert (docs / "results.md").read_text(encoding="utf-8") == (ROOT / "docs" / "results.md").read_text(
        encoding="utf-8"
    )
    names = {path.name for path in (docs / "results").iterdir()}
    assert names == {path.name for path in (ROOT / "docs" / "results").iterdir()}
    for name in sorted(name for name in names if name.endswith(".csv")):
        tables = [pd.read_csv(place / name) for place in (docs / "results", ROOT / "docs" / "results")]
        pd.testing.assert_frame_equal(*tables, rtol=1e-6)


@pytest.mark.parametrize("newest_first", [False, True])
def test_verdicts_are_of_the_trainings_that_the_documents_begin_with(
    newest_first: bool, compose_config: Composer, tmp_path: Path
) -> None:
    """Those seeds trained again on another processor count in neither: nobody chose between the two.

    A checkout gives files any times, so that the records of the sweeps say what was first.
    """
    first = next(sweep for sweep in merged(sweeps(NUMBERS)) if sweep.name == PAPER and not sweep.on)
    told = {each.evaluation.directory.name for each in results(first, NUMBERS) if each.evaluation is not None}
    numbers = tmp_path / "numbers"
    shutil.copytree(NUMBERS, numbers)
    for path in numbers.glob("artifacts/evaluation/*/manifest.json"):
        os.utime(path, (1e9, 1e9 + ((path.parent.name in told) == newest_first)))
    selection = select(numbers, compose_config("evaluation=thorough"))
    assert {each.directory.name for each in selection.used} == told
    assert sum("other bits" in reason for reason in selection.left_out.values()) == len(told) == 5


def test_walks_that_were_trained_before_a_gait_could_be_named_still_count(compose_config: Composer) -> None:
    """They alternated, and were checked for no more; another gait than these two they were not."""
    config = compose_config("experiment=walking", "evaluation=thorough")
    assert select(NUMBERS, config).seeds == [5, 6, 7, 8, 9]
    config.teacher.gait = "hop"
    assert select(NUMBERS, config).used == []
