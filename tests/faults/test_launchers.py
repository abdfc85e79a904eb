"""Jobs of a sweep in processes of joblib and of submitit: what they share, how they fail, how they are preempted."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
from importlib.util import find_spec
from pathlib import Path

import psutil
import pytest
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from romgrl.artifacts.workspace import CHECKPOINT
from romgrl.cli.compose import register_schema
from romgrl.cli.config_files import CONF
from romgrl.errors import ConfigurationError
from romgrl.runtime import cores
from romgrl.sweeps import callback
from romgrl.sweeps.launch import RUNNING_SUFFIX
from tests.faults import fake_slurm
from tests.helpers.jobs import start, trainings
from tests.helpers.limits import LONG, PATIENCE, wait_until

LAUNCHERS = ("joblib", "submitit_local", "submitit_slurm")
pytestmark = pytest.mark.skipif(
    find_spec("submitit") is None or find_spec("hydra_plugins") is None,
    reason="the extras joblib and submitit are not installed",
)


def sweep_config(*overrides: str) -> callback.DictConfig:
    """What Hydra composes for a sweep, its own part included."""
    register_schema()
    with initialize_config_dir(str(CONF), version_base="1.3"):
        return compose("config", overrides=list(overrides), return_hydra_config=True)


def begin(outputs: Path, launcher: str, *arguments: str, **variables: str) -> subprocess.Popen[str]:
    """Start a sweep of fake stages without MLflow."""
    overrides = (f"hydra/launcher={launcher}", "experiment=smoke", "tracking=none", f"paths.outputs={outputs}")
    return start("-m", *overrides, *arguments, module="tests.helpers.fake_jobs", **variables)


def end(process: subprocess.Popen[str]) -> tuple[int, str, str]:
    """Exit code and what was said."""
    out, err = process.communicate(timeout=PATIENCE)
    return process.returncode, out, err


@pytest.mark.parametrize("launcher", LAUNCHERS)
def test_configs_fit_the_launchers(launcher: str) -> None:
    config = sweep_config(f"hydra/launcher={launcher}", "paths.outputs=/somewhere")
    schema = OmegaConf.get_type(config.hydra.launcher)
    assert schema is not None
    assert schema.__module__ == f"hydra_plugins.hydra_{launcher.partition('_')[0]}_launcher.config"
    if launcher != "joblib":
        folder = OmegaConf.to_container(config.hydra.launcher, resolve=False)["submitit_folder"]
        assert folder == "${hydra.sweep.dir}/.submitit/%j"
        assert config.hydra.sweep.dir.startswith("/somewhere/sweeps/")


def test_a_launcher_passes_the_check_of_what_hydra_makes(tmp_path: Path) -> None:
    """Its directory has the time in it, which Hydra learns to resolve late."""
    job = start("-m", "hydra/launcher=submitit_local", "speed=99", f"paths.outputs={tmp_path}", module="romgrl")
    code, out, err = end(job)
    assert (code, out) == (2, "")
    assert err.startswith("speed: 99 is not allowed")
    assert len(err.splitlines()) == 1


def test_missing_extras_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    lines = {
        "joblib": "hydra/launcher=joblib: is not installed; pip install hydra-joblib-launcher",
        "submitit_local": "hydra/launcher=submitit_local: is not installed; pip install hydra-submitit-launcher",
    }
    for launcher, line in lines.items():
        config = sweep_config(f"hydra/launcher={launcher}")
        with monkeypatch.context() as patch:
            patch.setattr(callback, "find_spec", lambda name: None)
            with pytest.raises(ConfigurationError, match=f"^{re.escape(line)}$"):
                callback.check_launcher(config)
    monkeypatch.setenv("PATH", "")
    with pytest.raises(ConfigurationError, match="there is no sbatch and srun of Slurm on this machine"):
        callback.check_launcher(sweep_config("hydra/launcher=submitit_slurm"))


def test_jobs_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """How many jobs share the cores of a machine; a job of Slurm has its own."""
    monkeypatch.setattr(cores, "affinity", lambda: 8)
    monkeypatch.setattr(cores, "quotas", list)
    for name in cores.SLURM:
        monkeypatch.delenv(name, raising=False)
    cases = {
        ("joblib", 5): 2,
        ("joblib", 1): 1,
        ("joblib hydra.launcher.n_jobs=-1", 20): 8,
        ("joblib hydra.launcher.n_jobs=-2", 20): 7,
        ("joblib hydra.launcher.n_jobs=4", 3): 3,
        ("submitit_local", 5): 5,
        ("submitit_slurm", 5): 1,
    }
    for (launcher, jobs), expected in cases.items():
        launch = callback.plan_launch(sweep_config(*f"hydra/launcher={launcher}".split()), jobs)
        assert launch is not None
        assert launch.at_once == expected, launcher
    for launcher in ([], ["hydra/launcher=joblib", "hydra.launcher.n_jobs=1"]):
        assert callback.plan_launch(sweep_config(*launcher), 5) is None
    assert cores.available_cores() == 8
    monkeypatch.setenv("SLURM_CPUS_PER_TASK", "3")
    assert cores.available_cores() == 3


def test_joblib_trains_what_jobs_share_once(tmp_path: Path) -> None:
    """Two processes, half of the cores each, and one line of a job after the other."""
    code, out, err = end(begin(tmp_path, "joblib", "stage=student", "threads=0", "speed=1,4", FAKE_SECONDS="0.5"))
    assert (code, err) == (0, "")
    made = [line.split()[0] for line in trainings(tmp_path)]
    print(f"2 jobs side by side: {len(made)} trainings, {made.count('teacher')} of it the teacher they share")
    assert made == ["reference", "student", "student", "teacher"]
    told, _, table = out.partition("\n# ")  # at the end one table of all jobs
    lines = [line for line in told.splitlines() if not line.startswith("sweep: ")]
    assert table.startswith("sweep over speed")
    assert out.splitlines()[0] == "sweep: 2 jobs, 2 at once"
    assert {re.match(r"\[speed=[14]\] ", line) is not None for line in lines} == {True}
    students = [
        line.split() for line in (tmp_path / "artifacts" / "times.txt").read_text(encoding="utf-8").splitlines()
    ][-2:]
    assert len({process for *_, process, _, _ in students}) == 2
    assert {int(threads) for *_, threads, _ in students} == {max(1, cores.available_cores() // 2)}


@pytest.mark.parametrize("launcher", ["joblib", pytest.param("submitit_local", marks=pytest.mark.slow)])
def test_failures_in_other_processes_are_told(tmp_path: Path, launcher: str) -> None:
    job = begin(tmp_path, launcher, "stage=baseline", "speed=1,4", FAKE_FAULT="baseline:diverge", FAKE_FAULT_CALLS="2")
    code, _, err = end(job)
    assert code == 4
    assert sorted(err.splitlines()) == [f"[speed={speed}] baseline: loss = nan at step 7" for speed in (1, 4)]


@pytest.mark.parametrize(
    "number",
    [
        pytest.param(signal.SIGINT, marks=pytest.mark.slow),
        signal.SIGTERM,
        pytest.param(signal.SIGHUP, marks=pytest.mark.slow),
    ],
)
def test_a_signal_to_the_sweep_ends_its_jobs_in_good_order(tmp_path: Path, number: signal.Signals) -> None:
    """Two jobs run and save themselves; the third does not start. What a terminal sends comes to all."""
    job = begin(tmp_path, "joblib", "stage=baseline", "speed=1,2,3", FAKE_SECONDS=LONG)
    wait_until(lambda: len(list(tmp_path.glob("artifacts/*/*.partial/curve.csv"))) == 0 and calls(tmp_path) == 2)
    for process in [*(jobs(tmp_path) if number != signal.SIGTERM else []), job.pid]:
        os.kill(process, number)
    code, _, err = end(job)
    assert code == 128 + number
    assert sorted(set(err.splitlines())) == [f"[speed={speed}] interrupted by SIGTERM" for speed in (1, 2, 3)]
    assert calls(tmp_path) == 2
    assert len(list(tmp_path.glob("artifacts/baseline/*.partial/half.npz"))) == 2
    assert jobs(tmp_path) == []


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_a_sweep_of_one_process(tmp_path: Path, number: signal.Signals) -> None:
    """Its jobs run in the process of the sweep, which answers for them."""
    job = begin(tmp_path, "joblib", "hydra.launcher.n_jobs=1", "stage=baseline", "speed=1,2", FAKE_SECONDS=LONG)
    wait_until(lambda: calls(tmp_path) == 1)
    job.send_signal(number)
    code, _, _ = end(job)
    assert code == 128 + number
    assert calls(tmp_path) == 1


def test_the_jobs_of_a_sweep_that_is_killed_end_in_good_order(tmp_path: Path) -> None:
    job = begin(tmp_path, "joblib", "stage=baseline", "speed=1,2", FAKE_SECONDS=LONG)
    wait_until(lambda: calls(tmp_path) == 2)
    processes = jobs(tmp_path)
    job.kill()
    job.communicate(timeout=PATIENCE)
    wait_until(lambda: not any(psutil.pid_exists(process) for process in processes))
    assert len(list(tmp_path.glob("artifacts/baseline/*.partial/half.npz"))) == 2


@pytest.mark.slow
def test_a_job_that_is_killed_is_told(tmp_path: Path) -> None:
    job = begin(tmp_path, "joblib", "stage=baseline", "speed=1,2", FAKE_SECONDS=LONG)
    wait_until(lambda: calls(tmp_path) == 2)
    os.kill(jobs(tmp_path)[0], signal.SIGKILL)
    code, _, err = end(job)
    assert code == 1
    assert len(err.splitlines()) == 1
    assert err.startswith("a job of the sweep was lost: A worker process managed by the executor was unexpectedly")


def calls(outputs: Path) -> int:
    """How many trainings have begun."""
    return len(trainings(outputs)) if (outputs / "artifacts" / "calls.txt").exists() else 0


def jobs(outputs: Path) -> list[int]:
    """The processes of the jobs that run."""
    return [int(path.stem) for path in outputs.glob(f"sweeps/*/*{RUNNING_SUFFIX}")]


@pytest.mark.slow
@pytest.mark.parametrize("launcher", ["submitit_local", "submitit_slurm"])
def test_a_preempted_job_goes_on(tmp_path: Path, launcher: str) -> None:
    """Each job gets the signal of its scheduler in the middle of its training, is queued again and goes on."""
    fake_slurm.install(tmp_path / "slurm")
    arguments = ("experiment=smoke", "tracking=none", "threads=1", "stage=teacher", "seed=0,1")
    steps = "teacher.total_steps=40_000"
    path = f"{tmp_path / 'slurm'}:{os.environ['PATH']}"
    outputs = tmp_path / "outputs"
    overrides = (f"hydra/launcher={launcher}", f"paths.outputs={outputs}", *arguments, steps)
    job = start("-m", *overrides, module="romgrl", PATH=path)
    preempted: set[Path] = set()
    while len(preempted) < 2:
        wait_until(lambda: bool(training(outputs) - preempted))
        for workspace in training(outputs) - preempted:
            owner = json.loads(workspace.with_name(f".{workspace.stem}.owner").read_text(encoding="utf-8"))
            for number in [signal.SIGTERM, signal.SIGUSR2] if launcher == "submitit_slurm" else [signal.SIGUSR2]:
                os.kill(owner["process"], number)  # Slurm sends both where it preempts
            preempted.add(workspace)
    code, _, err = end(job)
    assert (code, err) == (0, "")
    logs = [log.read_text(encoding="utf-8") for log in outputs.glob("sweeps/*/.submitit/*/*_log.out")]
    assert len(logs) == 2
    goes_on = [step for log in logs for step in re.findall(r"goes on at step ([\d,]+)", log)]
    print(f"{len(preempted)} preempted, {len(goes_on)} went on at steps {goes_on}")
    assert len(goes_on) == 2
    assert all(0 < int(step.replace(",", "")) < 40_000 for step in goes_on)
    assert len(list(outputs.glob("artifacts/teacher/*/manifest.json"))) == 2
    assert not list(outputs.rglob(CHECKPOINT))
    if launcher == "submitit_slurm":
        script = (tmp_path / "slurm" / "script.sh").read_text(encoding="utf-8")
        flags = {"array=0-1%2", "cpus-per-task=4", "time=720", "signal=USR2@120", "mem=8GB", "job-name=romgrl"}
        assert flags <= set(re.findall(r"^#SBATCH --(\S+)$", script, re.MULTILINE))


def training(outputs: Path) -> set[Path]:
    """The workspaces of trainings that have made steps."""
    return {path.parent for path in outputs.glob("artifacts/teacher/*.partial/curve.csv")}
