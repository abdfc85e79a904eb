"""Numbers of sweeps that are kept without policies and rollouts say what the sweeps say."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from romgrl.config.schema import Config
from romgrl.results import keep as keep_module
from romgrl.results import statistics, sweep_tables
from romgrl.results.__main__ import main as write
from romgrl.results.keep import main as keep
from romgrl.results.kept import KEPT_FILE
from romgrl.results.text_table import Sheet
from romgrl.results.verify import verify
from tests.results.test_results_document import stored


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(statistics, "RESAMPLES", 999)
    monkeypatch.setattr(sweep_tables, "save_figures", lambda *_: None)


@pytest.fixture
def outputs(default_config: Config, tmp_path: Path) -> Path:
    """A sweep of three seeds, one of which fails."""
    directory = tmp_path / "outputs"
    values = {"speed": ["4.0"], "seed": ["5", "6", "7"]}
    stored(directory, default_config, "a", "paper", values, fail="speed=4.0 seed=6")
    return directory


def test_documents_are_the_same(outputs: Path, default_config: Config, tmp_path: Path) -> None:
    kept = tmp_path / "numbers"
    assert keep([str(outputs), str(kept)]) == 0
    assert keep([str(kept), str(tmp_path / "again")]) == 0
    stored(outputs, default_config, "aa", "paper", {"speed": ["4.0"], "seed": ["6", "8"]})  # on another day
    assert keep([str(outputs), str(kept)]) == 0
    texts = {}
    for name, place in {"whole": outputs, "kept": kept}.items():
        assert write([str(place), str(tmp_path / name)]) == 0
        texts[name] = (tmp_path / name / "results.md").read_text(encoding="utf-8")
    assert texts["kept"] == texts["whole"]
    assert "4 of 4 jobs finished" in texts["kept"]
    names = {path.name for path in kept.rglob("*") if path.is_file()}
    assert names == {KEPT_FILE, "sweep.json", "jobs.jsonl", "manifest.json", "mse.csv", "gait.csv", "null_models.csv"}
    everything = "".join(path.read_text(encoding="utf-8") for path in kept.rglob("*") if path.is_file())
    assert "/home" not in everything
    assert str(tmp_path) not in everything
    default_config.paths.outputs = str(kept)
    seeds = [line for line in verify(default_config, []) if not isinstance(line, Sheet)]
    default_config.paths.outputs = "outputs"
    assert any("4 seeds" in line for line in seeds), seeds


@pytest.mark.parametrize(("damage", "told"), [("change", "SHA-256"), ("remove", "missing")])
def test_a_table_that_is_not_as_it_was_is_told(outputs: Path, tmp_path: Path, damage: str, told: str) -> None:
    kept = tmp_path / "numbers"
    assert keep([str(outputs), str(kept)]) == 0
    table = sorted(kept.glob("artifacts/evaluation/*/mse.csv"))[0]
    if damage == "remove":
        table.unlink()
    else:
        table.write_bytes(table.read_bytes().replace(b"1", b"2"))
    assert write([str(kept), str(tmp_path / "docs")]) == 0
    assert told in (tmp_path / "docs" / "results.md").read_text(encoding="utf-8")


def test_what_cannot_be_kept(outputs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert keep([str(tmp_path / "nothing"), str(tmp_path / "numbers")]) != 0
    assert "holds no sweep" in capsys.readouterr().err
    damaged = sorted(outputs.glob("artifacts/evaluation/*/mse.csv"))[0]
    damaged.write_text("no", encoding="utf-8")
    assert keep([str(outputs), str(tmp_path / "numbers")]) != 0
    assert capsys.readouterr().err.count("\n") == 1
    (tmp_path / "file").write_text("", encoding="utf-8")
    assert keep([str(outputs), str(tmp_path / "file" / "numbers")]) != 0
    assert capsys.readouterr().err.count("\n") == 1


def test_a_job_without_artifacts_is_no_reason_to_stop(outputs: Path, tmp_path: Path) -> None:
    record = next(outputs.glob("sweeps/*/jobs.jsonl"))
    lines = [json.loads(line) for line in record.read_text(encoding="utf-8").splitlines()]
    record.write_text(json.dumps(lines[0] | {"error": None, "artifacts": {}}) + "\n", encoding="utf-8")
    assert keep_module.keep(outputs, tmp_path / "numbers") == 1
