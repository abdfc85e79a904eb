"""What the surroundings say: a bad word is one line and left out, a good one is honoured, a job runs either way."""

from __future__ import annotations

import os
import subprocess
import sys
import warnings
from pathlib import Path
from threading import Event

import pytest

from romgrl.errors import TrackingError
from romgrl.provenance import versions
from romgrl.runtime import cores, surroundings
from romgrl.tracking.recorder import Recorder, bring_journals, default_uri, ui_command
from tests.conftest import Command
from tests.helpers.jobs import ROOT
from tests.helpers.limits import wait_until

UNIFIED = "42 31 0:38 / {place} rw,relatime shared:9 - cgroup2 cgroup2 rw,nsdelegate\n"
FIRST = "32 31 0:29 {top} {place} rw,relatime - cgroup cgroup rw,cpu,cpuacct\n"


def write(directory: Path, files: dict[str, str]) -> Path:
    """Files by their names in a directory."""
    for name, text in files.items():
        path = directory / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return directory


def test_quotas_of_nested_groups_count_rounded_up(tmp_path: Path) -> None:
    tree = write(
        tmp_path / "with a blank",
        {"cpu.max": "max 100000", "a/cpu.max": "250000 100000\n", "a/b/cpu.max": "max 100000\n", "c/cpu.max": "1000 5"},
    )
    mounted = UNIFIED.format(place=str(tree).replace(" ", "\\040"))
    assert cores.quotas(write(tmp_path / "in", {"mountinfo": mounted, "cgroup": "0::/a/b\n"})) == [3]
    assert cores.quotas(write(tmp_path / "top", {"mountinfo": mounted, "cgroup": "0::/\n"})) == []
    assert cores.quotas(write(tmp_path / "out", {"mountinfo": mounted, "cgroup": "0::/../a\n"})) == []
    assert cores.quotas(write(tmp_path / "c", {"mountinfo": mounted, "cgroup": "1:cpu:/c\n"})) == []
    assert cores.quotas(tmp_path / "nothing") == []


def test_quotas_of_the_first_version_seen_from_a_container(tmp_path: Path) -> None:
    tree = write(
        tmp_path / "cpu",
        {
            "cpu.cfs_quota_us": "150000\n",
            "cpu.cfs_period_us": "100000\n",
            "step/cpu.cfs_quota_us": "-1",
            "step/cpu.cfs_period_us": "100000",
        },
    )
    mounted = FIRST.format(top="/docker/9f", place=tree) + FIRST.format(top="/docker/9f", place=tmp_path / "other")
    groups = "5:memory:/docker/9f\n4:cpu,cpuacct:/docker/9f/step\n0::/docker/9f\n"
    assert cores.quotas(write(tmp_path / "in", {"mountinfo": mounted, "cgroup": groups})) == [2]


@pytest.mark.parametrize("value", ["", "abc", "0", "-1", "2.5", "4(x2)", "٣"])
def test_a_bad_word_of_slurm_is_told_once_and_left_out(value: str, capsys: pytest.CaptureFixture[str]) -> None:
    environment = {"SLURM_CPUS_PER_TASK": value, "SLURM_CPUS_ON_NODE": "6"}
    assert cores.granted(environment) == cores.granted(environment) == [6]
    told = f"warning: SLURM_CPUS_PER_TASK={value!r} is not allowed and left out; allowed: a whole number from 1 on\n"
    assert capsys.readouterr().err == told
    assert cores.granted({"SLURM_CPUS_PER_TASK": " 3 "}) == [3]


def test_the_least_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cores, "affinity", lambda: 8)
    monkeypatch.setattr(cores, "quotas", lambda: [5, 6])
    monkeypatch.setenv("SLURM_CPUS_ON_NODE", "7")
    monkeypatch.delenv("SLURM_CPUS_PER_TASK", raising=False)
    assert cores.available_cores() == 5
    monkeypatch.setenv("SLURM_CPUS_PER_TASK", "3")
    assert cores.available_cores() == 3
    monkeypatch.setattr(cores, "affinity", lambda: 2)
    assert cores.available_cores() == 2


def test_a_job_runs_whatever_the_environment_says(command: Command) -> None:
    """`Slurm` says nonsense, and so do variables that are set for other programs."""
    ended = command(
        "stage=teacher",
        "tracking=none",
        SLURM_CPUS_PER_TASK="abc",
        PYTHONWARNINGS="error",
        MPLBACKEND="nonsense",
        MUJOCO_GL="nonsense",
        HOME="/proc",
        TMPDIR="/proc/none",
        MKL_NUM_THREADS="abc",
    )
    assert ended.returncode == 0, ended.stderr
    (line,) = ended.stderr.splitlines()
    assert line.startswith("warning: SLURM_CPUS_PER_TASK='abc' is not allowed")
    assert "teacher: done" in ended.stdout


def test_what_was_set_for_other_programs_is_left_out() -> None:
    environment = {"PYTHONWARNINGS": "error", "HTTPS_PROXY": "http://proxy:3128", "NO_PROXY": "inside,localhost"}
    with warnings.catch_warnings(record=True) as told:
        warnings.resetwarnings()  # Python's own filters, and before them that of the environment
        warnings.simplefilter("ignore", DeprecationWarning)
        warnings.simplefilter("error", append=False)
        surroundings.adapt_environment(environment)
        warnings.warn("a library changes", FutureWarning, stacklevel=1)
        warnings.warn("of a library to itself", DeprecationWarning, stacklevel=1)
    assert len(told) == 1
    assert environment["no_proxy"] == environment["NO_PROXY"] == "inside,localhost,127.0.0.1,::1"
    assert "PYTHONWARNINGS" not in environment
    kept = {"PYTHONWARNINGS": "ignore", "NO_PROXY": "*", "ALL_PROXY": "socks5://proxy"}
    surroundings.adapt_environment(kept)
    assert (kept["PYTHONWARNINGS"], kept["NO_PROXY"]) == ("ignore", "*")
    unset: dict[str, str] = {}
    surroundings.adapt_environment(unset)
    assert "NO_PROXY" not in unset


@pytest.fixture
def proxies(monkeypatch: pytest.MonkeyPatch) -> None:
    """A proxy that nobody can reach, with a password."""
    for name in [name for name in os.environ if name.lower().endswith("_proxy")]:
        monkeypatch.delenv(name)
    monkeypatch.setenv("HTTP_PROXY", "http://me:secret@127.0.0.1:9")


@pytest.mark.usefixtures("proxies")
def test_a_proxy_in_the_way_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    note = (
        "; mlflow.example is asked through the proxy 127.0.0.1:9 of HTTP_PROXY; NO_PROXY=mlflow.example leaves it out"
    )
    assert surroundings.proxy_note("http://user:word@mlflow.example:5000/") == note
    assert surroundings.proxy_note("https://mlflow.example") == ""
    assert surroundings.proxy_note("sqlite:////tmp/mlflow.db") == ""
    assert surroundings.proxy_note("http://[broken") == ""
    monkeypatch.setenv("ALL_PROXY", "socks5://other:1080")
    assert "the proxy other:1080 of ALL_PROXY" in surroundings.proxy_note("https://mlflow.example")
    monkeypatch.setenv("NO_PROXY", "mlflow.example")
    assert surroundings.proxy_note("http://mlflow.example:5000") == ""


@pytest.mark.usefixtures("proxies")
def test_a_job_names_the_proxy_of_its_server(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recorder = Recorder("http://mlflow.example:5000", "e", tmp_path)
    try:
        assert recorder.process is not None
        wait_until(lambda: recorder.process.reason)
    finally:
        assert recorder.process is not None
        recorder.process.kill()
    said = capsys.readouterr().err
    assert "mlflow.example is asked through the proxy 127.0.0.1:9 of HTTP_PROXY; NO_PROXY=mlflow.example" in said
    assert "secret" not in said


@pytest.mark.usefixtures("proxies")
def test_a_server_on_this_machine_is_asked_directly(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MPLBACKEND", raising=False)
    for name in ("no_proxy", "NO_PROXY", "MPLBACKEND"):
        monkeypatch.setenv(name, "")
    surroundings.adapt_environment()
    assert surroundings.proxy_note("http://127.0.0.1:5000") == surroundings.proxy_note("http://localhost:5000") == ""


def helper(directory: Path, name: str, script: str) -> Path:
    """A program that is there and does something else."""
    directory.mkdir(exist_ok=True)
    path = directory / name
    path.write_text(f"#!/bin/sh\n{script}\n", encoding="utf-8")
    path.chmod(0o755)
    return path


def test_a_git_that_does_not_work_costs_the_revision_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(versions, "git_hung", Event())
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    monkeypatch.setattr(versions, "root_of_sources", lambda: tmp_path)
    (tmp_path / ".git").mkdir()
    helper(tmp_path, "git", "echo 'fatal: detected dubious ownership' >&2; exit 128")
    assert versions.git_state() == (None, None)
    helper(tmp_path, "git", "printf '\\377'")
    assert versions.git_state() == (None, None)
    asked: list[list[str]] = []

    def hang(command: list[str], **options: object) -> None:
        asked.append(command)
        raise subprocess.TimeoutExpired(command, versions.GIT_SECONDS)

    with monkeypatch.context() as patched:
        patched.setattr(versions.subprocess, "run", hang)
        assert versions.git_state() == versions.git_state() == (None, None)
    assert len(asked) == 1  # not once per stage
    monkeypatch.setattr(versions, "git_hung", Event())
    (tmp_path / "git").unlink()
    monkeypatch.setenv("PATH", "")
    assert versions.git_state() == (None, None)


def test_the_revision_is_that_of_the_sources(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A hook of git's sets GIT_DIR to the repository that it runs in."""
    if not (ROOT / ".git").exists():
        pytest.skip("no checkout")
    here = versions.git_state()[0]
    subprocess.run(["git", "init", "-q", str(tmp_path)], check=True)
    monkeypatch.setenv("GIT_DIR", str(tmp_path / ".git"))
    assert versions.git_state()[0] == here


def test_another_mlflow_on_the_path_is_not_recommended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own = helper(tmp_path / "own", "mlflow", "")
    helper(tmp_path / "other", "mlflow", "exit 1")
    monkeypatch.setattr(sys, "executable", str(own.with_name("python")))
    monkeypatch.setenv("PATH", f"{tmp_path / 'other'}:{tmp_path / 'own'}")
    assert ui_command(default_uri(tmp_path)).startswith(f"{own} ui ")
    monkeypatch.setenv("PATH", f"{tmp_path / 'own'}:{tmp_path / 'other'}")
    assert ui_command(default_uri(tmp_path)).startswith("mlflow ui ")


@pytest.mark.usefixtures("proxies")
def test_what_is_left_is_brought_or_the_proxy_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "journal").mkdir()
    (tmp_path / "journal" / "1.jsonl").touch()
    join = "romgrl.tracking.recorder.TrackingProcess.join"
    monkeypatch.setattr(join, lambda self: setattr(self, "failure", "refused"))
    with pytest.raises(TrackingError, match=r"refused; mlflow\.example is asked through the proxy 127"):
        bring_journals("http://mlflow.example", tmp_path)
