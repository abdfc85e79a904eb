"""Results have one place: what the command named, seen from where it was started; a sweep has a directory to itself."""

from __future__ import annotations

import json
import os
import pickle
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from hydra.types import RunMode
from omegaconf import DictConfig

from romgrl.cli.allowlist import GuardedLoader
from romgrl.cli.arguments import read_options
from romgrl.cli.compose import register_schema
from romgrl.cli.hydra_loader import Loader
from romgrl.errors import ConfigurationError
from romgrl.results.sweep_record import sweeps, write_sweep
from romgrl.sweeps import sweep_directory
from romgrl.sweeps.launch import FAILURES_FILE, RUNNING_SUFFIX, STOPPING, Launch
from romgrl.sweeps.sweep_directory import claim, made_anew
from tests.helpers.jobs import Command, start
from tests.helpers.limits import PATIENCE

SWEEP = ("-m", "stage=baseline", "seed=0,1", "tracking=none")


@pytest.fixture
def loader(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> GuardedLoader:
    """Hydra's loader as the command line has it, started in the test's directory, which is nobody's home."""
    register_schema()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", f"{tmp_path}/home")
    options, lines = read_options([])
    assert options is not None, lines
    return Loader(options)._loader


def composed(loader: GuardedLoader, *overrides: str) -> DictConfig:
    """The configuration of a sweep."""
    return loader.load_configuration("config", [*overrides], RunMode.MULTIRUN)


def test_paths_are_seen_from_where_the_command_was_started(loader: GuardedLoader, tmp_path: Path) -> None:
    overrides = ["paths.outputs=out", "humanoid.xml='~/robot.xml'", "hydra.run.dir=here", "hydra.job.chdir=true"]
    config = composed(loader, *overrides)
    assert config.paths.outputs == f"{tmp_path}/out"
    assert config.humanoid.xml == f"{tmp_path}/home/robot.xml"
    assert config.hydra.run.dir == f"{tmp_path}/here"
    assert Path(config.hydra.sweep.dir).parent == tmp_path / "out" / "sweeps"
    (tmp_path / "elsewhere").mkdir()
    os.chdir(tmp_path / "elsewhere")
    assert config.hydra.sweep.dir.startswith(f"{tmp_path}/out/sweeps/")
    assert composed(loader, "hydra.sweep.dir='~/2026_10_05'").hydra.sweep.dir == f"{tmp_path}/home/2026_10_05"


def test_paths_with_interpolations_are_whole_too(loader: GuardedLoader, tmp_path: Path) -> None:
    for written, whole in {
        "${oc.env:HOME}/out": f"{tmp_path}/home/out",
        "${speed}_${seed}": f"{tmp_path}/4.0_0",
        "out_${seed}": f"{tmp_path}/out_0",
    }.items():
        assert composed(loader, f"paths.outputs={written}").paths.outputs == whole
    config = composed(loader, timed := "paths.outputs=at_${now:%H%M%S%f}")
    job = loader.load_sweep_config(config, ["seed=1", timed])
    assert job.paths.outputs == config.paths.outputs  # not the time of the job


def test_sweeps_of_the_same_second_have_directories_of_their_own(loader: GuardedLoader, tmp_path: Path) -> None:
    config = composed(loader)
    places = [claim(config.copy())[0] for _ in range(3)]
    assert places == [Path(f"{config.hydra.sweep.dir}{end}") for end in ("", "_2", "_3")]
    write_sweep(places[2], "config", "python -m romgrl", [["seed=0"]], machine={}, started=1.0, usual={})
    assert [sweep.directory for sweep in sweeps(tmp_path / "outputs")] == [places[2]]


def test_the_jobs_of_a_sweep_know_its_directory(loader: GuardedLoader) -> None:
    for overrides in ([], ["hydra.sweep.dir='a (1), x'"]):
        config = composed(loader, *overrides)
        directory, _ = claim(config)
        far_away = pickle.loads(pickle.dumps(loader))
        job = far_away.load_sweep_config(config, ["seed=1", "paths.outputs='lr=0.1'"])
        assert job.hydra.sweep.dir == str(directory) == config.hydra.sweep.dir


def test_a_directory_that_was_given_has_one_sweep_at_a_time(loader: GuardedLoader, tmp_path: Path) -> None:
    config = composed(loader, "hydra.sweep.dir=grid")
    line = f"^hydra.sweep.dir: {tmp_path}/grid is not allowed; allowed: a directory that no other sweep is using now$"
    directory, lock = claim(config.copy())
    assert directory == tmp_path / "grid"
    with pytest.raises(ConfigurationError, match=line):
        claim(config.copy())
    lock.release()
    assert claim(config.copy())[0] == directory
    (tmp_path / "file").touch()
    with pytest.raises(ConfigurationError, match="file is not allowed; allowed: a directory that can be written"):
        claim(composed(loader, "hydra.sweep.dir=file"))


def test_what_stopped_a_sweep_does_not_stop_it_again(loader: GuardedLoader, tmp_path: Path) -> None:
    """What a stopped sweep of joblib, and a failed job of submitit, leave; and the process of a job, long dead."""
    (tmp_path / "grid").mkdir()
    launch = Launch("submitit_local", str(tmp_path / "grid"), 1, [])
    launch.leave("[seed=0] interrupted by SIGTERM", 143)
    launch.stop()
    (tmp_path / "grid" / f"1{RUNNING_SUFFIX}").touch()
    (tmp_path / "grid" / "jobs.jsonl").write_text("{}\n", encoding="utf-8")
    assert {path.name for path in (tmp_path / "grid").iterdir()} == {
        STOPPING,
        FAILURES_FILE,
        f"1{RUNNING_SUFFIX}",
        "jobs.jsonl",
    }
    claim(composed(loader, "hydra.sweep.dir=grid"))
    assert {path.name for path in (tmp_path / "grid").iterdir()} == {sweep_directory.LOCK, "jobs.jsonl"}
    assert launch.failures() == []
    with launch.running():
        pass


def test_names_that_are_taken(tmp_path: Path) -> None:
    assert [made_anew(tmp_path / "a" / "x").name for _ in range(3)] == ["x", "x_2", "x_3"]


def test_labels_of_jobs_keep_their_values_whole() -> None:
    launch = Launch("joblib", "", 1, ["rom.name"])
    assert launch.label(["rom.name='a b'", "seed=0"]) == "rom.name='a b'"
    assert launch.label(["seed=0", "speed=1"]) == "seed=0 speed=1"
    assert launch.label([]) == "job"


def test_a_job_that_changes_its_directory_keeps_its_results_in_one_place(tmp_path: Path) -> None:
    place = "paths.outputs=" + "'" + os.path.relpath(tmp_path / "run%41 #ü?", Path(__file__).parents[2]) + "'"
    process = start("-m", "stage=baseline", "seed=0", place, "hydra.job.chdir=true")
    _, err = process.communicate(timeout=PATIENCE)
    assert (process.returncode, err) == (0, "")
    outputs = tmp_path / "run%41 #ü?"
    assert len(list(tmp_path.rglob("manifest.json"))) == 2  # the artifact, and MLflow's copy
    (directory,) = outputs.glob("sweeps/*")
    document = json.loads((directory / "sweep.json").read_text(encoding="utf-8"))
    assert document["jobs"] == [["stage=baseline", "seed=0", place]]
    with closing(sqlite3.connect(outputs / "mlflow.db")) as store:
        assert store.execute("select count(*) from runs").fetchone() == (3,)


@pytest.mark.slow
def test_a_sweep_in_a_directory_of_its_own_goes_on(command: Command, tmp_path: Path) -> None:
    grid = f"hydra.sweep.dir={tmp_path}/grid"
    assert command(*SWEEP, grid, FAKE_FAULT="baseline:diverge").returncode == 4
    assert command(*SWEEP, grid).returncode == 0
    assert len((tmp_path / "grid" / "jobs.jsonl").read_text(encoding="utf-8").splitlines()) == 4
    assert not (tmp_path / "outputs" / "sweeps").exists()
