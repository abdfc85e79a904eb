"""Stages run once, in order, and are found again; faults end in one line, an exit code and nothing half made."""

from __future__ import annotations

import io
import json
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from romgrl.artifacts import open_artifact
from romgrl.config.schema import STAGES, Config
from romgrl.errors import ArtifactError, ConfigurationError, DivergenceError
from romgrl.pipeline import run as pipeline
from romgrl.provenance import stage_graph
from tests.conftest import Composer
from tests.helpers.jobs import ROOT, Command, start, trainings
from tests.helpers.limits import LONG, PATIENCE


@pytest.fixture
def quiet(smoke_config: Config) -> Config:
    """Without MLflow."""
    return replace(smoke_config, tracking=replace(smoke_config.tracking, enabled=False))


def run(config: Config) -> tuple[dict[str, Path], str]:
    console = Console(file=io.StringIO(), width=120)
    return pipeline.run(config, console=console), console.file.getvalue()


@pytest.mark.usefixtures("fakes")
def test_all_stages_run_once_and_are_described(quiet: Config) -> None:
    finished, text = run(quiet)
    outputs = Path(quiet.paths.outputs)
    assert set(finished) == set(STAGES)
    assert [
        line.split()[0] for line in (outputs / "artifacts" / "calls.txt").read_text(encoding="utf-8").splitlines()
    ] == list(STAGES)
    for stage, path in finished.items():
        assert path.parent == outputs / "artifacts" / stage
        manifest = open_artifact(path, stage=stage)
        assert (manifest.stage, manifest.key, manifest.seed) == (stage, path.name, 0)
        assert {"data.npz", "curve.csv"} <= set(manifest.files)
        assert {"python", "torch", "numpy", "mujoco", "gymnasium", "romgrl"} <= set(manifest.versions)
        assert manifest.wall_time > 0
        assert f"artifact: {path}\n" in text
    evaluation = open_artifact(finished["evaluation"])
    assert set(evaluation.inputs) == {"reference", "student", "baseline"}
    assert evaluation.inputs["student"] == open_artifact(finished["student"]).digest
    assert evaluation.config["evaluation.episodes"] == quiet.evaluation.episodes
    assert "Error against the reference (m^2)" in text


@pytest.mark.usefixtures("fakes")
def test_what_a_finished_stage_says_of_the_last_one_ends_a_job_at_once(
    quiet: Config, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(config: Config, directory: Path) -> None:
        raise ConfigurationError(f"speed: {config.speed} is not allowed; allowed: what {directory.parent.name} says")

    monkeypatch.setattr(stage_graph, "load_function", lambda name: refuse)
    monkeypatch.setitem(
        stage_graph.STAGES, "robustness", replace(stage_graph.STAGES["robustness"], foresees={"teacher": "a:b"})
    )
    with pytest.raises(ConfigurationError, match=r"what teacher says"):
        run(replace(quiet, stage="robustness"))
    assert [path.name for path in (Path(quiet.paths.outputs) / "artifacts").iterdir() if path.is_dir()] == ["teacher"]


@pytest.mark.usefixtures("fakes")
def test_a_file_in_the_place_of_a_stage_is_told_before_any_work(quiet: Config) -> None:
    artifacts = Path(quiet.paths.outputs) / "artifacts"
    artifacts.mkdir(parents=True)
    (artifacts / "student").write_text("mine", encoding="utf-8")
    with pytest.raises(ArtifactError, match=r"artifacts/student: is no directory; remove it"):
        run(quiet)
    assert not (artifacts / "teacher").exists()
    assert (artifacts / "student").read_text(encoding="utf-8") == "mine"


@pytest.mark.usefixtures("fakes")
def test_finished_stages_are_reused(quiet: Config) -> None:
    run(quiet)
    finished, text = run(quiet)
    assert len(trainings(Path(quiet.paths.outputs))) == len(STAGES)
    assert text.count(": reused; it took") == len(STAGES)
    assert len(finished) == len(STAGES)


def test_a_run_that_makes_nothing_imports_nothing_heavy(command: Command, tmp_path: Path) -> None:
    """MLflow has a process of its own; torch and MuJoCo are for stages."""
    arguments = ["experiment=smoke", f"paths.outputs={tmp_path}/outputs"]
    assert command("experiment=smoke", "tracking=none").returncode == 0
    script = (
        "import sys, atexit; heavy = {'torch', 'mujoco', 'mlflow', 'matplotlib', 'pandas'};"
        "atexit.register(lambda: print(heavy & set(sys.modules)));"
        "from romgrl.__main__ import main; from tests.helpers import fake_stages; fake_stages.install(); main()"
    )
    process = [sys.executable, "-c", script, *arguments]
    result = subprocess.run(process, cwd=ROOT, capture_output=True, text=True, check=True, encoding="utf-8")
    assert result.stdout.count(": reused; it took") == len(STAGES)
    assert result.stdout.splitlines()[-1] == "set()"


@pytest.mark.usefixtures("fakes")
def test_one_stage_runs_with_what_it_needs(quiet: Config) -> None:
    assert set(run(replace(quiet, stage="baseline"))[0]) == {"baseline"}
    assert set(run(replace(quiet, stage="reference"))[0]) == {"teacher", "reference"}
    assert [line.split()[0] for line in trainings(Path(quiet.paths.outputs))] == ["baseline", "reference", "teacher"]


@pytest.mark.usefixtures("fakes")
def test_baseline_has_no_imitation(quiet: Config) -> None:
    run(replace(quiet, stage="evaluation", eta=0.4))
    assert {"baseline 4.0 1.0 0", "student 4.0 0.4 0"} <= set(trainings(Path(quiet.paths.outputs)))


@pytest.mark.usefixtures("fakes")
def test_damaged_artifact_is_refused_by_name(quiet: Config) -> None:
    finished, _ = run(replace(quiet, stage="teacher"))
    (finished["teacher"] / "data.npz").write_bytes(b"damaged")
    with pytest.raises(ArtifactError, match=r"data\.npz: does not have the SHA-256"):
        run(quiet)
    assert len(trainings(Path(quiet.paths.outputs))) == 1


@pytest.mark.usefixtures("fakes")
@pytest.mark.parametrize(("fault", "error"), [("interrupt", KeyboardInterrupt), ("diverge", DivergenceError)])
def test_a_stage_that_ends_early_is_kept_but_not_published(
    quiet: Config, monkeypatch: pytest.MonkeyPatch, fault: str, error: type[BaseException]
) -> None:
    monkeypatch.setenv("FAKE_FAULT", f"student:{fault}")
    with pytest.raises(error):
        run(quiet)
    folder = Path(quiet.paths.outputs) / "artifacts" / "student"
    assert [path.suffix for path in folder.iterdir() if path.is_dir()] == [".partial"]
    assert (next(folder.glob("*.partial")) / "half.npz").exists()
    monkeypatch.delenv("FAKE_FAULT")
    finished, _ = run(quiet)
    assert "half.npz" not in open_artifact(finished["student"]).files
    assert not list(folder.glob("*.partial"))


@pytest.mark.parametrize(("fault", "code"), [("interrupt", 130), ("diverge", 4)])
def test_exit_codes(command: Command, fault: str, code: int) -> None:
    result = command("experiment=smoke", "stage=teacher", "tracking=none", FAKE_FAULT=f"teacher:{fault}")
    assert result.returncode == code
    assert re.search(r"teacher: (interrupted|failed) after 0:0\d; kept /.*\.partial", result.stdout)
    assert "Traceback" not in result.stderr
    assert result.stderr == ("teacher: loss = nan at step 7\n" if code == 4 else "")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_signals(tmp_path: Path, number: signal.Signals) -> None:
    """What a terminal and a scheduler send: the stage stops at once, its directory is kept, no traceback."""
    arguments = ("experiment=smoke", "stage=teacher", "tracking=none", f"paths.outputs={tmp_path}/outputs")
    job = start(*arguments, FAKE_SECONDS=LONG)
    partial = tmp_path / "outputs" / "artifacts" / "calls.txt"
    while not partial.exists():
        time.sleep(0.1)
    job.send_signal(number)
    out, err = job.communicate(timeout=PATIENCE)
    assert (job.returncode, err) == (128 + number, "")
    assert re.search(r"interrupted after 0:\d\d; kept /.*\.partial", out)


def test_exit_code_of_a_damaged_artifact(command: Command, tmp_path: Path) -> None:
    arguments = ("experiment=smoke", "stage=teacher", "tracking=none")
    assert command(*arguments).returncode == 0
    manifest = next((tmp_path / "outputs/artifacts/teacher").glob("*/manifest.json"))
    manifest.write_text("{}", encoding="utf-8")
    result = command(*arguments)
    assert (result.returncode, len(result.stderr.splitlines())) == (3, 1)
    assert str(manifest) in result.stderr


def test_sweep_trains_what_jobs_share_once(command: Command, tmp_path: Path) -> None:
    result = command("-m", "experiment=smoke", "tracking=none", "speed=1,4", "eta=0.3,0.5")
    assert result.returncode == 0, result.stderr
    stages = [line.split()[0] for line in trainings(tmp_path / "outputs")]
    counts = {stage: stages.count(stage) for stage in STAGES}
    assert counts == {"teacher": 1, "reference": 1, "student": 4, "baseline": 2, "evaluation": 4, "report": 4}


def test_one_bad_job_does_not_stop_the_others(command: Command, tmp_path: Path) -> None:
    arguments = ("-m", "experiment=smoke", "tracking=none", "stage=student", "eta=0.3,0.5")
    result = command(*arguments, FAKE_FAULT="student:diverge")
    assert (result.returncode, result.stderr.count("loss = nan")) == (4, 2)
    assert len(trainings(tmp_path / "outputs")) == 4


def test_parallel_jobs_train_once(tmp_path: Path) -> None:
    """Four processes want the same teacher at the same moment: one makes it, the others wait, say so, and use it."""
    arguments = ("experiment=smoke", "stage=teacher", "tracking=none", f"paths.outputs={tmp_path}/outputs")
    jobs = [start(*arguments, FAKE_SECONDS="3") for _ in range(4)]
    texts = [job.communicate(timeout=PATIENCE)[0] for job in jobs]
    assert [job.returncode for job in jobs] == [0] * 4
    assert len(trainings(tmp_path / "outputs")) == 1
    assert sum("teacher: done in" in text for text in texts) == 1
    assert sum("waiting for it" in text for text in texts) >= 1
    assert len({re.search("artifact: (.*)", text).group(1) for text in texts}) == 1


def test_resolved_configuration(compose_config: Composer, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    config = pipeline.resolve(compose_config("paths.outputs=here"))
    assert config.paths.outputs == str(tmp_path / "here")
    assert config.threads >= 1


@pytest.mark.usefixtures("fakes")
def test_manifest_is_plain_json_without_places(quiet: Config, tmp_path: Path) -> None:
    finished, _ = run(quiet)
    document = json.loads((finished["student"] / "manifest.json").read_text(encoding="utf-8"))
    assert str(tmp_path) not in json.dumps(document)
    assert document["config"]["discriminator.gradient_penalty"] == quiet.discriminator.gradient_penalty
