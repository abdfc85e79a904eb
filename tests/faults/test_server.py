"""Two working directories that share a tracking server and nothing else: what one has made, the other takes over."""

from __future__ import annotations

import os
import re
import shutil
import socket
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import pytest
from mlflow import MlflowClient
from mlflow.entities import Run
from sqlalchemy import create_engine, inspect

from romgrl.artifacts import open_artifact
from romgrl.provenance.stage_graph import STAGES
from romgrl.tracking.process import BLOCKED_SECONDS
from romgrl.tracking.recorder import bring_journals, open_recorder
from tests.helpers.jobs import ROOT, trainings
from tests.helpers.limits import PATIENCE, SLACK
from tests.helpers.ports import free_port
from tests.helpers.servers import mlflow_server, postgresql


@dataclass
class Server:
    """A tracking server, its database and the directory of its files."""

    uri: str
    database: str
    files: Path

    def runs(self) -> list[Run]:
        """All runs."""
        client = MlflowClient(tracking_uri=self.uri)
        experiment = client.get_experiment_by_name("romgrl")
        return list(client.search_runs([experiment.experiment_id], max_results=1000))

    def artifact(self, run_id: str) -> Path:
        """Where the server keeps the files of a run."""
        (folder,) = self.files.rglob(f"{run_id}/artifacts")
        return folder


@pytest.fixture(scope="module", params=["sqlite", pytest.param("postgresql", marks=pytest.mark.slow)])
def server(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    directory = tmp_path_factory.mktemp("server")
    with ExitStack() as stack:
        if request.param == "postgresql":
            database = stack.enter_context(postgresql())
        else:
            database = f"sqlite:///{directory}/server.db"
        files = directory / "files"
        files.mkdir()
        yield Server(stack.enter_context(mlflow_server(files, database)), database, files)


def sweep(server: Server, directory: Path, *arguments: str) -> str:
    """A sweep of fake stages in a working directory of its own; what it said, warnings first."""
    directory.mkdir(exist_ok=True)
    common = ["experiment=smoke", "stage=evaluation", "tracking=server", f"tracking.uri={server.uri}"]
    command = [sys.executable, "-m", "tests.helpers.fake_stages", "-m", *common, *arguments]
    environment = os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    result = subprocess.run(
        command,
        cwd=directory,
        env=environment,
        capture_output=True,
        text=True,
        encoding="utf-8",
        timeout=PATIENCE,
        check=False,
    )
    assert result.returncode == 0
    return result.stderr + result.stdout


def made(directory: Path) -> Counter[str]:
    """The stages that ran in a working directory."""
    if not (directory / "outputs" / "artifacts" / "calls.txt").exists():
        return Counter()
    return Counter(line.split()[0] for line in trainings(directory / "outputs"))


def manifests(directory: Path) -> dict[str, str]:
    """The verified artifacts of a working directory: digests by stage and key."""
    paths = (path.parent for path in directory.glob("outputs/artifacts/*/*/manifest.json"))
    return {f"{path.parent.name}/{path.name}": open_artifact(path, stage=path.parent.name).digest for path in paths}


@pytest.mark.slow
def test_what_one_machine_made_the_other_takes_over(server: Server, tmp_path: Path) -> None:
    """Nothing is trained twice, every byte is verified, and what was damaged on the server is made anew."""
    first, second, third = (tmp_path / name for name in ("first", "second", "third"))
    sweep(server, first, "speed=1,4")
    expected = Counter(teacher=1, reference=1, student=2, baseline=2, evaluation=2)
    assert made(first) == expected
    said = sweep(server, second, "speed=1,2,4")
    assert made(second) == Counter(student=1, baseline=1, evaluation=1)
    fetched = said.count(": fetched from the tracking server")
    assert fetched == expected.total()
    assert manifests(first).items() <= manifests(second).items()
    assert not list(second.glob("outputs/artifacts/*/.*fetched*"))
    runs = server.runs()
    finished = Counter((run.data.tags["stage"], run.data.tags.get("key")) for run in runs if stage_of(run) in STAGES)
    assert set(finished.values()) == {1}
    sources = {
        run.data.tags[f"romgrl.reused_from.{stage}"]
        for run in runs
        for stage in STAGES
        if f"romgrl.reused_from.{stage}" in run.data.tags and run.data.params.get("speed") in ("1.0", "4.0")
    }
    assert sources <= {run.info.run_id for run in runs if stage_of(run) in STAGES}
    print(f"{len(finished)} stage keys, each trained once; {fetched} of {expected.total()} fetched and verified")
    refused = damage(server)
    said = sweep(server, third, "speed=1,4")
    told = r"^(?:warning: )?(\w+): (?:cannot be fetched from|what the tracking server has is refused)"
    lines = re.findall(told, said, re.MULTILINE)
    print(f"{len(lines)} of {len(refused)} damaged artifacts refused and made anew")
    assert Counter(lines) == Counter(refused), said
    assert made(third) == Counter(refused)
    assert manifests(first) == manifests(third)


def stage_of(run: Run) -> str:
    return str(run.data.tags.get("stage"))


def damage(server: Server) -> list[str]:
    """Damage artifacts on the server in three ways; their stages."""
    by_stage = {(stage_of(run), run.data.params.get("speed")): run.info.run_id for run in server.runs()}
    teacher = server.artifact(by_stage["teacher", None]) / "policy.safetensors"
    content = bytearray(teacher.read_bytes())
    content[-1] ^= 1
    teacher.write_bytes(bytes(content))
    (server.artifact(by_stage["student", "1.0"]) / "data.npz").unlink()
    foreign = server.artifact(by_stage["baseline", "1.0"])
    shutil.rmtree(foreign)
    shutil.copytree(server.artifact(by_stage["baseline", "4.0"]), foreign)
    return ["teacher", "student", "baseline"]


def test_the_database_has_the_tables_of_mlflow_alone(server: Server, tmp_path: Path) -> None:
    MlflowClient(tracking_uri=f"sqlite:///{tmp_path}/fresh.db").search_experiments()
    tables, fresh = tables_of(server.database), tables_of(f"sqlite:///{tmp_path}/fresh.db")
    print(f"{len(tables)} tables, all of them MLflow's")
    assert tables == fresh
    assert {"runs", "metrics", "alembic_version"} <= tables


@pytest.mark.slow
def test_long_names_arrive(server: Server, tmp_path: Path) -> None:
    """PostgreSQL refuses what is longer than its column; SQLite takes any length."""
    recorder = open_recorder(server.uri, "e" * 600, tmp_path, enabled=True)
    run = recorder.start("n" * 600, tags={"t" * 300: "v" * 9000}, params={"p" * 300: "w" * 9000})
    run.metrics({"m" * 300: 1.0}, 1)
    run.finish()
    recorder.close()
    assert recorder.process is not None
    recorder.process.join()  # on a busy machine the job does not wait to the end
    bring_journals(None, tmp_path)
    client = MlflowClient(tracking_uri=server.uri)
    experiment = client.get_experiment_by_name("e" * 247 + "...")
    (stored,) = client.search_runs([experiment.experiment_id])
    assert (stored.info.run_name, stored.info.status) == ("n" * 247 + "...", "FINISHED")
    assert stored.data.params == {"p" * 247 + "...": "w" * 5997 + "..."}
    assert list(stored.data.metrics) == ["m" * 247 + "..."]
    assert not [*tmp_path.glob("journal/*.jsonl")]


def tables_of(database: str) -> set[str]:
    engine = create_engine(database)
    try:
        return set(inspect(engine).get_table_names())
    finally:
        engine.dispose()


@pytest.mark.parametrize("hanging", [False, True])
def test_a_server_that_is_away_costs_seconds_once(tmp_path: Path, hanging: bool) -> None:
    """It refuses connections, or takes them and never answers."""
    with socket.create_server(("127.0.0.1", 0)) as silent:
        port = silent.getsockname()[1] if hanging else free_port()
        recorder = open_recorder(f"http://127.0.0.1:{port}", "romgrl", tmp_path, enabled=True)
        begin = time.monotonic()
        for stage in STAGES:
            assert not recorder.fetch(stage, "0123456789abcdef", tmp_path / stage)
        seconds = time.monotonic() - begin
        assert recorder.process is not None
        recorder.process.kill()
    print(f"{len(STAGES)} stages asked for, {seconds:.1f} s in all")
    assert seconds < BLOCKED_SECONDS + SLACK
    assert not any((tmp_path / stage).exists() for stage in STAGES)


def test_a_store_on_this_disk_is_not_asked(tmp_path: Path) -> None:
    for enabled in (True, False):
        recorder = open_recorder(None, "romgrl", tmp_path, enabled=enabled)
        assert not recorder.fetch("teacher", "0123456789abcdef", tmp_path / "teacher")
        recorder.close()
