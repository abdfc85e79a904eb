"""What arrives in a real SQLite store, and that a store that fails costs nothing."""

from __future__ import annotations

import io
import json
import shutil
import subprocess
import sys
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest
from mlflow import MlflowClient
from mlflow.entities import Run
from rich.console import Console

from romgrl.artifacts import open_artifact, read_manifest
from romgrl.config.schema import STAGES, Config
from romgrl.pipeline import run as pipeline
from romgrl.report.terminal_tables import TRAINING_MINUTES
from romgrl.tracking.recorder import NOTE, bring_journals, default_uri, open_recorder
from romgrl.tracking.sending.failures import RefusedError
from romgrl.tracking.sending.store import PARENT_TAG, Store
from tests.helpers.jobs import ROOT, Command, start
from tests.helpers.limits import PATIENCE, wait_until
from tests.helpers.tracked import all_runs


def only_run(outputs: Path) -> Run:
    (run,) = all_runs(outputs)
    return run


@pytest.mark.usefixtures("fakes")
def test_one_run_per_stage_under_one_job(smoke_config: Config) -> None:
    console = Console(file=io.StringIO(), width=120)
    finished = pipeline.run(smoke_config, name="mine", console=console)
    outputs = Path(smoke_config.paths.outputs)
    runs = {run.data.tags["stage"]: run for run in all_runs(outputs)}
    assert set(runs) == {"job", *STAGES}
    job, student = runs["job"], runs["student"]
    assert job.info.run_name == "mine v=4 eta=0.3 noise=0.05 s=0"
    assert student.info.run_name == "student v=4 eta=0.3 noise=0.05 s=0"
    assert runs["baseline"].info.run_name == "baseline v=4 s=0"
    assert f"- [reference](#/runs/{runs['reference'].info.run_id})" in student.data.tags[NOTE]
    assert f"| [student](#/runs/{student.info.run_id}) | made | 0:0" in job.data.tags[NOTE]
    assert all(runs[stage].data.tags[PARENT_TAG] == job.info.run_id for stage in STAGES)
    assert all(run.info.status == "FINISHED" for run in runs.values())
    assert student.data.tags["key"] == finished["student"].name
    assert student.data.tags["upstream"] == f"reference={finished['reference'].name}"
    assert job.data.tags["romgrl.run.student"] == student.info.run_id
    assert student.data.params["student.gamma"] == str(smoke_config.student.gamma)
    assert student.data.params["eta"] == "0.3"
    assert job.data.params["teacher.speed"] == "4.0"
    numbers = {
        f"average/raw/{name}": value for name, value in (("baseline", 2), ("student", 1), ("reduction_percent", 50))
    }
    assert 0 < job.data.metrics.pop(TRAINING_MINUTES) < 1
    assert job.data.metrics == numbers
    assert "rom.stiffness" not in student.data.params
    client = MlflowClient(tracking_uri=default_uri(outputs))
    history = client.get_metric_history(student.info.run_id, "loss")
    assert sorted((point.step, point.value) for point in history) == [(0, 0.0), (10, 1.0), (20, 2.0)]
    assert {file.path for file in client.list_artifacts(student.info.run_id)} == {
        "curve.csv",
        "data.npz",
        "manifest.json",
        "policy.safetensors",
    }
    assert (outputs / "mlartifacts").is_dir()
    assert '"path": "tables/mse.json", "type": "table"' in runs["evaluation"].data.tags["mlflow.loggedArtifacts"]
    table = json.loads(
        Path(client.download_artifacts(runs["evaluation"].info.run_id, "tables/mse.json")).read_text(encoding="utf-8")
    )
    assert table["columns"] == ["channel, alignment", "student", "baseline", "reduction_percent"]
    assert table["data"] == [["average, raw", 1, 2, 50]]
    text = console.file.getvalue()
    assert f"mlflow run: {student.info.run_id}\n" in text
    assert f"mlflow ui --backend-store-uri sqlite:///{outputs.resolve()}/mlflow.db --host 127.0.0.1\n" in text
    assert "jobs, best first: http://127.0.0.1:5000/#/experiments/1/runs?workflowType=machine_learning&" in text


@pytest.mark.usefixtures("fakes")
def test_reused_stages_are_referenced_not_logged_again(smoke_config: Config) -> None:
    for _ in range(2):
        pipeline.run(smoke_config, console=Console(file=io.StringIO()))
    runs = all_runs(Path(smoke_config.paths.outputs))
    stages = [run.data.tags["stage"] for run in runs]
    assert (len(runs), stages.count("job")) == (len(STAGES) + 2, 2)
    first, second = sorted(
        (run for run in runs if run.data.tags["stage"] == "job"), key=lambda run: run.info.start_time
    )
    made = {run.data.tags["stage"]: run.info.run_id for run in runs}
    for stage in STAGES:
        assert f"romgrl.reused_from.{stage}" not in first.data.tags
        assert second.data.tags[f"romgrl.reused_from.{stage}"] == made[stage]
        assert second.data.metrics[f"time_saved/{stage}"] > 0


def test_sweep_is_the_parent_of_its_jobs(command: Command, tmp_path: Path) -> None:
    result = command("-m", "experiment=smoke", "stage=baseline", "speed=1,4")
    assert result.returncode == 0, result.stderr
    runs = all_runs(tmp_path / "outputs")
    (sweep,) = [run for run in runs if run.data.tags["stage"] == "sweep"]
    jobs = [run for run in runs if run.data.tags["stage"] == "job"]
    assert [job.data.tags[PARENT_TAG] for job in jobs] == [sweep.info.run_id] * 2
    assert {job.data.params["speed"] for job in jobs} == {"1.0", "4.0"}
    assert (sweep.info.status, sweep.data.params["jobs"]) == ("FINISHED", "2")
    assert sweep.info.run_name == "sweep experiment=smoke speed=1,4"


@pytest.mark.usefixtures("fakes")
def test_interrupted_runs_are_closed(smoke_config: Config, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FAKE_FAULT", "student:interrupt")
    with pytest.raises(KeyboardInterrupt):
        pipeline.run(smoke_config, console=Console(file=io.StringIO()))
    status = {run.data.tags["stage"]: run.info.status for run in all_runs(Path(smoke_config.paths.outputs))}
    assert status == {"job": "KILLED", "student": "KILLED", "teacher": "FINISHED", "reference": "FINISHED"}


@pytest.mark.slow
def test_four_processes_open_a_fresh_store_at_once(tmp_path: Path) -> None:
    script = (
        "import sys; from pathlib import Path; from romgrl.tracking.recorder import open_recorder;"
        "recorder = open_recorder(None, 'romgrl', Path(sys.argv[1]), enabled=True);"
        "run = recorder.start('x', tags={'stage': 'x'}, params={'a': 1}); run.metrics({'m': 1.0}, 1); run.finish();"
        "recorder.close(); sys.exit(run.run_id is None)"
    )
    command = [sys.executable, "-c", script, str(tmp_path)]
    jobs = [subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True, encoding="utf-8") for _ in range(4)]
    errors = [job.communicate(timeout=PATIENCE)[1] for job in jobs]
    assert [job.returncode for job in jobs] == [0] * 4, errors
    assert errors == [""] * 4
    runs = all_runs(tmp_path)
    assert len(runs) == 4
    assert all(run.data.metrics == {"m": 1.0} for run in runs)
    store = (tmp_path / "mlflow.db").read_bytes()
    assert store[18:20] == b"\x02\x02"  # file format of the SQLite header: write-ahead log


@pytest.mark.slow
def test_a_store_that_fails_is_told_and_nothing_is_lost(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "mlflow.db").write_text("this is not a database", encoding="utf-8")
    recorder = open_recorder(None, "romgrl", tmp_path, enabled=True)
    run = recorder.start("x", tags={}, params={"a": 1})
    run.metrics({"m": 1.0}, 1)
    run.finish()
    assert run.run_id == run.local_id
    recorder.close()
    errors = capsys.readouterr().err
    assert errors.count("warning: MLflow at ") == 2
    assert errors.count("is not a database); going on, everything is kept") == 1
    assert errors.count("does not have everything yet; kept in ") == 1
    (tmp_path / "mlflow.db").unlink()
    brought = "1 params, 1 metrics, FINISHED"
    assert bring_journals(None, tmp_path) == [f"{run.local_id} is {only_run(tmp_path).info.run_id}: {brought}"]
    assert only_run(tmp_path).data.metrics == {"m": 1.0}


@pytest.mark.slow
def test_the_sender_does_not_wait(tmp_path: Path) -> None:
    """A training logs some 20 numbers a second. A hundred times that is sent at once, and all of it arrives."""
    recorder = open_recorder(None, "romgrl", tmp_path, enabled=True)
    run = recorder.start("x", tags={})
    run_id = run.run_id
    before = time.process_time()
    for step in range(100):
        run.metrics({f"m{i}": float(step) for i in range(20)}, step)
    assert time.process_time() - before < 0.1
    run.finish()
    assert time.process_time() - before < 0.2
    recorder.close()
    (stored,) = all_runs(tmp_path)
    assert (stored.info.run_id, stored.info.status) == (run_id, "FINISHED")
    assert stored.data.metrics == {f"m{i}": 99.0 for i in range(20)}
    assert not (tmp_path / "mlflow.db-wal").exists() or (tmp_path / "mlflow.db-wal").stat().st_size == 0


def test_a_pipeline_that_is_killed_leaves_no_run_open(tmp_path: Path) -> None:
    Store(default_uri(tmp_path), tmp_path).experiment_id("romgrl")
    job = start("experiment=smoke", "stage=teacher", f"paths.outputs={tmp_path}", FAKE_SECONDS="60")
    wait_for_runs(tmp_path, {"job": "RUNNING", "teacher": "RUNNING"})
    job.kill()
    job.communicate()
    wait_for_runs(tmp_path, {"job": "KILLED", "teacher": "KILLED"})


def wait_for_runs(outputs: Path, status: Mapping[str, str]) -> None:
    """Wait until the runs of a store have a status, by stage."""
    wait_until(lambda: {run.data.tags["stage"]: run.info.status for run in all_runs(outputs)} == status)


@pytest.mark.slow
def test_a_process_of_mlflow_that_dies_costs_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recorder = open_recorder(None, "romgrl", tmp_path, enabled=True)
    job = recorder.start("job", tags={})
    run_id = job.run_id
    assert recorder.process is not None
    recorder.process.kill()
    run = recorder.start("stage", parent=job, tags={})
    for step in range(3):
        run.metrics({"m": 1.0}, step)
    run.finish()
    job.finish()
    recorder.close()
    assert run.run_id == run.local_id
    errors = capsys.readouterr().err
    assert errors.count("its process ended with -9") == 1
    assert errors.count("stage=sync") == 1
    bring_journals(None, tmp_path)
    runs = {stored.info.run_name: stored for stored in all_runs(tmp_path)}
    assert len(all_runs(tmp_path)) == 2
    assert runs["job"].info.run_id == run_id
    assert runs["stage"].data.tags[PARENT_TAG] == run_id
    assert {stored.info.status for stored in runs.values()} == {"FINISHED"}


@pytest.mark.slow
def test_jobs_of_a_sweep_share_a_process(tmp_path: Path) -> None:
    one = open_recorder(None, "romgrl", tmp_path, enabled=True)
    other = open_recorder(None, "romgrl", tmp_path, enabled=True)
    assert one is other
    other.close()
    run = one.start("x", tags={})
    run.finish()
    one.close()
    assert all_runs(tmp_path)[0].info.status == "FINISHED"
    elsewhere = open_recorder(None, "romgrl", tmp_path, enabled=False)
    assert elsewhere is not one
    assert elsewhere.start("x", tags={}).run_id is None
    elsewhere.close()


@pytest.mark.slow
@pytest.mark.usefixtures("fakes")
def test_the_load_of_the_machine_is_recorded_on_request(smoke_config: Config, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MLFLOW_SYSTEM_METRICS_SAMPLING_INTERVAL", "0.1")
    monkeypatch.setenv("FAKE_SECONDS", "0.3")
    tracking = replace(smoke_config.tracking, system_metrics=True)
    pipeline.run(replace(smoke_config, tracking=tracking), console=Console(file=io.StringIO()))
    runs = {run.data.tags["stage"]: run.data.metrics for run in all_runs(Path(smoke_config.paths.outputs))}
    assert 0 < runs["job"]["system/system_memory_usage_percentage"] < 100
    assert "system/cpu_utilization_percentage" in runs["job"]
    assert not [name for name in runs["student"] if name.startswith("system/")]


def test_tables_are_logged_once(tmp_path: Path) -> None:
    """What is sent again after a lost answer does not double the rows; a file that is no table is refused."""
    store = Store(default_uri(tmp_path), tmp_path)
    run_id = store.request("create_run", store.experiment_id("romgrl")).info.run_id
    (tmp_path / "results").mkdir()
    (tmp_path / "results" / "mse.csv").write_text("channel,student\npelvis_y,0.123456\n", encoding="utf-8")
    for _ in range(2):
        store.artifacts(run_id, tmp_path / "results")
    table = Path(store.request("download_artifacts", run_id, "tables/mse.json"))
    assert json.loads(table.read_text(encoding="utf-8")) == {
        "columns": ["channel", "student"],
        "data": [["pelvis_y", 0.1235]],
    }
    (tmp_path / "results" / "gait.csv").write_text("", encoding="utf-8")
    with pytest.raises(RefusedError, match=r"gait\.csv: No columns"):
        store.artifacts(run_id, tmp_path / "results")


@pytest.mark.usefixtures("fakes")
def test_a_report_is_rebuilt_from_mlflow_alone(smoke_config: Config) -> None:
    """All artifacts of the disk are gone; the store of MLflow has them, and nothing is trained again."""
    config = replace(smoke_config, stage="report")
    outputs = Path(config.paths.outputs)
    before = {
        name: read_manifest(path) for name, path in pipeline.run(config, console=Console(file=io.StringIO())).items()
    }
    shutil.rmtree(outputs / "artifacts")
    console = Console(file=io.StringIO(), width=200)
    finished = pipeline.run(config, console=console)
    assert {name: open_artifact(path, stage=name) for name, path in finished.items()} == before
    assert not (outputs / "artifacts" / "calls.txt").exists()
    assert console.file.getvalue().count(": fetched from the tracking server") == len(STAGES)
