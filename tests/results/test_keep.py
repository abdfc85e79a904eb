"""Numbers of sweeps that are kept without policies and rollouts say what the sweeps say."""

from __future__ import annotations

import json
from dataclasses import replace
from inspect import signature
from pathlib import Path

import pandas as pd
import pytest

from romgrl.artifacts import read_manifest, write_manifest
from romgrl.cli.locations import outputs_directory
from romgrl.config.addresses import KEPT_FILE
from romgrl.config.schema import Config
from romgrl.provenance.stage_graph import STAGES
from romgrl.results import keep as keep_module
from romgrl.results import statistics, sweep_tables
from romgrl.results.__main__ import main as write
from romgrl.results.evaluation_index import select
from romgrl.results.keep import main as keep
from romgrl.results.sweep_record import JobEnd, note_end, write_sweep
from romgrl.results.text_table import Sheet
from romgrl.results.verify import verify
from tests.results.chains import changed, write_numbers
from tests.results.test_results_document import stored

MADE = [name for name in signature(write_manifest).parameters if name != "directory"]
Capsys = pytest.CaptureFixture[str]


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
    said = []
    for place in (outputs, kept, tmp_path / "again"):
        assert write([str(place), str(tmp_path / "first")]) == 0
        said.append((tmp_path / "first" / "results.md").read_text(encoding="utf-8"))
    assert said == [said[0]] * 3
    assert "- seed=6: student: loss = nan at step 7" in said[0]
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


def test_no_place_of_a_file_is_kept(default_config: Config, tmp_path: Path) -> None:
    """Of a body of one's own its name alone."""
    outputs, kept = tmp_path / "outputs", tmp_path / "numbers"
    stored(outputs, default_config, "a", "paper", {"seed": ["5"]})
    for path in (outputs / "sweeps" / "a").glob("*.json*"):
        text = path.read_text(encoding="utf-8")
        path.write_text(
            text.replace('"seed=5"', '"seed=5", "humanoid.xml=/home/me/bodies/robot.xml"'), encoding="utf-8"
        )
    assert keep([str(outputs), str(kept)]) == 0
    records = [path.read_text(encoding="utf-8") for path in (kept / "sweeps").rglob("*.json*")]
    assert all("humanoid.xml=robot.xml" in text and "bodies" not in text for text in records)
    assert len(records) == 2


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


def test_what_is_there_is_not_lost(outputs: Path, default_config: Config, tmp_path: Path, capsys: Capsys) -> None:
    kept, other = tmp_path / "numbers", tmp_path / "other"
    assert keep([str(outputs), str(kept)]) == 0
    before = {path: path.read_bytes() for path in kept.rglob("*") if path.is_file()}
    stored(other, default_config, "b", "paper", {"speed": ["4.0"], "seed": ["5"]})
    evaluation = next(other.glob("artifacts/evaluation/*"))
    write_numbers(evaluation, 0.5, 0.6, {}, comparable=True)  # other bits of the same settings
    manifest = read_manifest(evaluation)
    write_manifest(evaluation, **{name: getattr(manifest, name) for name in MADE})
    stored(tmp_path / "third", default_config, "a", "eta", {"eta": ["0.4"], "seed": ["5"]})  # a sweep of the same name
    wrong = {
        tmp_path / "third": "another sweep",
        kept: "apart from",
        kept / "sweeps": "apart from",
    }
    for place, told in wrong.items():
        assert keep([str(place), str(kept)]) != 0
        assert told in capsys.readouterr().err
    assert keep([str(kept), str(outputs)]) != 0
    assert "holds results" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in kept.rglob("*") if path.is_file()} == before
    assert keep([str(other), str(kept)]) == 0
    assert {path: path.read_bytes() for path in before} == before
    beside = [path for path in kept.glob("artifacts/evaluation/*") if "-" in path.name]
    assert [path.name.partition("-")[0] for path in beside] == [evaluation.name]
    selection = select(kept, default_config)
    assert "other bits of seed 5" in selection.left_out[beside[0]]
    assert evaluation.name in {each.directory.name for each in selection.used}
    assert write([str(kept), str(tmp_path / "docs")]) == 0
    errors = pd.read_csv(tmp_path / "docs" / "results" / "paper_jobs.csv").set_index("seed")["average/aligned/student"]
    assert errors[5] == pytest.approx(0.5)  # each job as it ended last


def test_nothing_is_trained_where_numbers_are_kept(outputs: Path, default_config: Config, tmp_path: Path) -> None:
    kept = tmp_path / "numbers"
    assert keep([str(outputs), str(kept)]) == 0
    told = {}
    for stage in ("all", "verify"):
        told[stage] = [*outputs_directory(changed(default_config, f"stage={stage}", f"paths.outputs={kept}"))]
    assert told["verify"] == []
    assert "kept.txt" in told["all"][0]
    config = changed(default_config, f"paths.outputs={kept}")
    assert not any("paths.outputs" in str(line) for line in verify(config, [f"paths.outputs={kept}"]))


@pytest.mark.parametrize("name", ["../../../teacher/loot", "/tmp/loot", "other"])
def test_a_forged_key_leads_nowhere(outputs: Path, tmp_path: Path, name: str) -> None:
    manifest = next(outputs.glob("artifacts/teacher/*/manifest.json"))
    manifest.write_text(replace(read_manifest(manifest.parent), key=name).text, encoding="utf-8")
    assert keep([str(outputs), str(tmp_path / "out" / "numbers")]) != 0
    assert not (tmp_path / "out").exists()


def test_the_curve_of_a_student_is_verified(outputs: Path, default_config: Config, tmp_path: Path) -> None:
    """The steps of a training are told by it."""
    student = next(outputs.glob("artifacts/student/*"))
    (student / "content.txt").write_text("changed", encoding="utf-8")
    assert keep([str(outputs), str(tmp_path / "numbers")]) != 0


def test_a_job_without_artifacts_is_no_reason_to_stop(outputs: Path, tmp_path: Path) -> None:
    record = next(outputs.glob("sweeps/*/jobs.jsonl"))
    lines = [json.loads(line) for line in record.read_text(encoding="utf-8").splitlines()]
    record.write_text(json.dumps(lines[0] | {"error": None, "artifacts": {}}) + "\n", encoding="utf-8")
    assert keep_module.keep(outputs, tmp_path / "numbers") == 1


def test_what_follows_commands_is_kept_with_its_library_and_its_bars(tmp_path: Path) -> None:
    outputs, kept, docs = tmp_path / "outputs", tmp_path / "numbers", tmp_path / "docs"
    bar = {"name": "speed_held_percent", "student": 88.0, "baseline": 50.0, "reached": False}
    tables = {
        "teacher": {"gait.csv": "walker\n"},
        "library": {"library.csv": "fit,multiplier\nTrue,0.5\n", "report.html": "page"},
        "student": {"curve.csv": "step\n", "policy.txt": "weights"},
        "baseline": {"policy.txt": "weights"},
        "evaluation": {"grid.csv": "walker\n", "grid.json": json.dumps({"bars": [bar], "ramp": {}, "reached": 0})},
    }
    digests: dict[str, str] = {}
    for stage, files in tables.items():
        directory = outputs / "artifacts" / stage / "0123"
        directory.mkdir(parents=True)
        for name, text in files.items():
            (directory / name).write_text(text, encoding="utf-8")
        read = {name: digests[name] for name in STAGES[stage].reads(conditioned=True)}
        made = {"config": {}, "versions": {}, "revision": None, "dirty": False, "seed": 5, "wall_time": 1.0}
        digests[stage] = write_manifest(directory, stage=stage, key="0123", inputs=read, **made).digest
    write_sweep(outputs / "sweeps" / "a", "made", "", [["seed=5"]], machine={}, started=1.0, usual={})
    note_end(JobEnd(["seed=5"], {stage: str(outputs / "artifacts" / stage / "0123") for stage in tables}))
    assert keep([str(outputs), str(kept)]) == 0
    names = {path.name for path in kept.glob("artifacts/*/*/*")}
    assert names == {"manifest.json", "gait.csv", "library.csv", "curve.csv", "grid.csv", "grid.json"}
    assert write([str(kept), str(docs)]) == 0
    assert "| 88 |" in (docs / "results.md").read_text(encoding="utf-8")
    (kept / "artifacts" / "evaluation" / "0123" / "grid.json").write_text("{", encoding="utf-8")
    assert write([str(kept), str(docs)]) != 0  # no job is left
