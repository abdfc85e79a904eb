"""The whole pipeline on real physics in under a minute: every artifact, every MLflow run, and reuse."""

from __future__ import annotations

import csv
import io
import time
from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mlflow import MlflowClient
from rich.console import Console

from romgrl.artifacts import load_arrays, load_tensors, open_artifact
from romgrl.config.schema import OPTIONAL_STAGES, STAGES, Config
from romgrl.config.values import schema_keys
from romgrl.gait.features import ALIGNMENTS
from romgrl.humanoid import model
from romgrl.pipeline import run as pipeline
from romgrl.pipeline import worker
from romgrl.provenance.stage_graph import STAGES as STAGE_GRAPH
from romgrl.provenance.stage_keys import NAME_KEYS, stage_settings
from romgrl.tracking.recorder import default_uri
from tests.conftest import Composer

FREE = {
    "checkpoint_seconds",
    "device",
    "threads",
    "parallel_stages",
    "stage",
    "experiment",
    "student.kind",  # in the key where it is not one_speed, which has none of it
    "comparison",
    "objective",
    *NAME_KEYS,
}  # may be read anywhere, change no result
SIZELESS = {"humanoid.actuation", "humanoid.substeps"}  # the teacher builds the body only to measure it
pytestmark = pytest.mark.xdist_group("smoke")  # one process makes the run that all of them read

CHANNELS = ["pelvis_y", "left_foot_x", "left_foot_z", "right_foot_x", "right_foot_z", "average"]


class Reads:
    """Which key of the configuration each stage reads."""

    def __init__(self) -> None:
        self.stage: str | None = None
        self.keys: dict[str, set[str]] = {stage: set() for stage in STAGES + OPTIONAL_STAGES}

    def install(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Watch the attributes of the schema's classes while a stage function runs."""
        groups = {entry.name: entry.default_factory for entry in fields(Config) if f"{entry.name}" not in schema_keys()}
        self._watch(monkeypatch, Config, "")
        for name, schema in groups.items():
            self._watch(monkeypatch, schema, f"{name}.")
        load = worker.load_function

        def watched_load(entry: str) -> Callable[..., None]:
            function = load(entry)

            def watched(config: Config, inputs: Mapping[str, Path], output: Path, log: object) -> None:
                self.stage = output.parent.name
                try:
                    function(config, inputs, output, log)
                finally:
                    self.stage = None

            return watched

        monkeypatch.setattr(worker, "load_function", watched_load)

    def _watch(self, monkeypatch: pytest.MonkeyPatch, schema: Any, prefix: str) -> None:
        known, reads = schema_keys(), self

        def getattribute(instance: object, name: str) -> object:
            if reads.stage is not None and prefix + name in known:
                reads.keys[reads.stage].add(prefix + name)
            return object.__getattribute__(instance, name)

        monkeypatch.setattr(schema, "__getattribute__", getattribute, raising=False)


@pytest.fixture(scope="module")
def smoke(compose_config: Composer, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """One run of everything, then the same again."""
    outputs = tmp_path_factory.mktemp("smoke") / "outputs"
    config = compose_config("experiment=smoke", f"paths.outputs={outputs}")
    reads, console = Reads(), Console(file=io.StringIO(), width=120)
    with pytest.MonkeyPatch.context() as monkeypatch:
        reads.install(monkeypatch)
        start = time.monotonic()
        finished = pipeline.run(config, name="smoke", console=console)
        seconds = time.monotonic() - start
    return {
        "config": config,
        "finished": finished,
        "reads": reads.keys,
        "seconds": seconds,
        "text": console.file.getvalue(),
    }


def test_takes_less_than_a_minute(smoke: dict[str, Any]) -> None:
    assert smoke["seconds"] < 60


def test_a_stage_reads_only_keys_that_are_in_its_key(smoke: dict[str, Any]) -> None:
    """Otherwise a finished stage would be reused although its result would differ."""
    found = {}
    for stage in STAGES:
        read = smoke["reads"][stage]
        assert read, stage
        undeclared = read - set(stage_settings(stage, smoke["config"])) - FREE
        if stage in ("teacher", "reference"):
            undeclared -= SIZELESS
        if stage == "baseline":  # sees no imitation, whatever the configuration says
            undeclared = {
                key for key in undeclared if key not in ("eta", "noise") and not key.startswith("discriminator.")
            }
        found |= {stage: sorted(undeclared)} if undeclared else {}
    assert not found


def test_body_dimensions_do_not_depend_on_actuation_and_substeps() -> None:
    """That is why they may be missing from the teacher's key."""
    body = {"height": 1.7, "mass": 70.0, "control_frequency": 30.0}
    one = model.dimensions(model.build(actuation="servo", substeps=8, **body))
    assert one == model.dimensions(model.build(actuation="torque", substeps=16, **body))


def test_every_artifact_verifies(smoke: dict[str, Any]) -> None:
    payload = {
        "teacher": {"policy.safetensors", "curve.csv", "gait.csv"},
        "reference": {"reference.npz"},
        "student": {"policy.safetensors", "curve.csv"},
        "baseline": {"policy.safetensors", "curve.csv"},
        "evaluation": {"rollouts.npz", "mse.csv", "distances.csv", "gait.csv", "null_models.csv"},
        "report": set(),
    }
    assert set(smoke["finished"]) == set(STAGES)
    for stage, path in smoke["finished"].items():
        manifest = open_artifact(path, stage=stage)
        assert payload[stage] <= set(manifest.files), stage
        assert f"artifact: {path}\n" in smoke["text"]


def test_reference_and_rollouts_keep_the_feature_contract(smoke: dict[str, Any]) -> None:
    finished, config = smoke["finished"], smoke["config"]
    reference = load_arrays(finished["reference"] / "reference.npz")
    assert (reference["features"].shape, reference["features"].dtype) == ((200, 5), np.float32)
    assert (reference["episode"].shape, reference["episode"].dtype) == ((200,), np.int32)
    assert (reference["dt"], reference["speed"]) == (np.float32(1 / 30), 4)
    rollouts = load_arrays(finished["evaluation"] / "rollouts.npz")
    size = (config.evaluation.episodes, config.evaluation.steps)
    for name in ("student", "baseline"):
        assert rollouts[f"{name}_features"].shape == (*size, 5)
        assert rollouts[f"{name}_upright"].dtype == np.bool_
        for series in ("velocity", "upright", "trunk_lean"):
            assert rollouts[f"{name}_{series}"].shape == size
    assert rollouts["dt"] == np.float32(1 / 30)


def test_tables_have_the_fixed_names(smoke: dict[str, Any]) -> None:
    evaluation = smoke["finished"]["evaluation"]
    with (evaluation / "mse.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0])[:5] == ["channel", "alignment", "baseline", "student", "reduction_percent"]
    assert [(row["channel"], row["alignment"]) for row in rows] == [
        (channel, alignment) for alignment in ALIGNMENTS for channel in CHANNELS
    ]
    with (evaluation / "gait.csv").open(newline="", encoding="utf-8") as file:
        assert [next(iter(row.values())) for row in csv.DictReader(file)] == ["teacher", "student", "baseline"]


def test_figures_are_there(smoke: dict[str, Any]) -> None:
    files = open_artifact(smoke["finished"]["report"]).files
    for suffix in (".png", ".pdf"):
        assert sum(name.endswith(suffix) for name in files) >= 3


def test_policies_carry_their_network(smoke: dict[str, Any]) -> None:
    for stage in ("teacher", "student", "baseline"):
        tensors, metadata = load_tensors(smoke["finished"][stage] / "policy.safetensors")
        assert "network" in metadata
        assert all(bool(tensor.isfinite().all()) for tensor in tensors.values())


def test_runs_in_mlflow(smoke: dict[str, Any]) -> None:
    uri = default_uri(Path(smoke["config"].paths.outputs))
    client = MlflowClient(tracking_uri=uri)
    runs = {
        run.data.tags["stage"]: run
        for run in client.search_runs([client.get_experiment_by_name("romgrl").experiment_id])
    }
    assert set(runs) == {"job", *STAGES}
    for stage in STAGES:
        assert runs[stage].data.tags["key"] == smoke["finished"][stage].name
        logged = {file.path for file in client.list_artifacts(runs[stage].info.run_id)}
        assert "manifest.json" in logged
    assert "critic_loss" in runs["student"].data.metrics
    assert "student/mean_speed_m_per_s" in runs["job"].data.metrics
    assert f"mlflow ui --backend-store-uri {uri} --host 127.0.0.1\n" in smoke["text"]


def test_second_run_makes_nothing(smoke: dict[str, Any]) -> None:
    before = {path: path.stat().st_mtime_ns for path in smoke["finished"].values()}
    console = Console(file=io.StringIO(), width=120)
    finished = pipeline.run(smoke["config"], console=console)
    assert {path: path.stat().st_mtime_ns for path in finished.values()} == before
    assert console.file.getvalue().count(": reused; it took") == len(STAGES)


@pytest.mark.parametrize("stage", OPTIONAL_STAGES)
def test_a_stage_that_is_asked_for_by_name(smoke: dict[str, Any], stage: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """It takes what the pipeline has made, is no part of `stage=all`, and reads only keys that are in its key."""
    assert stage not in smoke["finished"]
    config, reads, console = replace(smoke["config"], stage=stage), Reads(), Console(file=io.StringIO(), width=120)
    reads.install(monkeypatch)
    finished = pipeline.run(config, console=console)
    assert set(finished) == {stage, *STAGE_GRAPH[stage].upstream}
    assert console.file.getvalue().count(": reused; it took") == len(finished) - 1
    assert reads.keys[stage]
    sizes = SIZELESS if stage == "library" else set()
    assert reads.keys[stage] <= set(stage_settings(stage, config)) | FREE | sizes
    open_artifact(finished[stage], stage=stage)
