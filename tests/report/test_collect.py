"""Results of several runs in one table."""

from pathlib import Path

import pandas as pd
import pytest

from romgrl.artifacts import write_manifest
from romgrl.errors import ArtifactError
from romgrl.gait.features import CHANNELS
from romgrl.report import collect


def evaluation(outputs: Path, seed: int, reduction: float) -> None:
    directory = outputs / "artifacts" / "evaluation" / f"key{seed}"
    directory.mkdir(parents=True)
    rows = [
        {"channel": channel, "alignment": alignment, "reduction_percent": reduction}
        for alignment in ("aligned", "raw")
        for channel in (*CHANNELS, "average")
    ]
    pd.DataFrame(rows).to_csv(directory / "mse.csv", index=False)
    gait = {"episodes": 16, "falls": seed, collect.SPEED: 4.0, collect.LEAN: 5.0, collect.STRIDES: 2.0}
    pd.DataFrame([{"walker": name, **gait} for name in ("teacher", "student", "baseline")]).to_csv(
        directory / "gait.csv", index=False
    )
    write_manifest(
        directory,
        stage="evaluation",
        key=f"key{seed}",
        config={"speed": 4.0},
        inputs={},
        versions={},
        revision=None,
        dirty=None,
        seed=seed,
        wall_time=1.0,
    )


def test_one_column_per_run_and_their_mean(tmp_path: Path) -> None:
    evaluation(tmp_path, seed=1, reduction=60.0)
    evaluation(tmp_path, seed=0, reduction=70.0)
    table = collect.results_table(tmp_path).set_index("measure")
    assert list(table) == ["4 m/s, seed 0", "4 m/s, seed 1", "mean", "deviation"]
    average = table.loc["aligned error, average: reduction [%]"]
    assert list(average[:3]) == [70.0, 60.0, 65.0]
    assert average["deviation"] == pytest.approx(50**0.5)
    assert table.loc["student: episodes upright to the end [%]", "4 m/s, seed 1"] == 93.75


def test_the_table_goes_between_the_markers(tmp_path: Path) -> None:
    evaluation(tmp_path, seed=0, reduction=70.0)
    document = tmp_path / "README.md"
    document.write_text(f"before\n{collect.START}\nold\n{collect.END}\nafter\n")
    collect.main([str(tmp_path), str(document)])
    text = document.read_text()
    assert text.startswith("before\n")
    assert text.endswith("after\n")
    assert "old" not in text
    assert "| student: speed after 2 s [m/s] | 4 | 4 |" in text


def test_no_evaluation_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(ArtifactError, match="no finished evaluation"):
        collect.results_table(tmp_path)
