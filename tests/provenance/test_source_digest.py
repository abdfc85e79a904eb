"""What a stage key covers: every leaf of the configuration, every file of code, versions and upstream artifacts."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from romgrl.config.schema import Config
from romgrl.config.values import schema_keys, value_of
from romgrl.humanoid.own_body import human_spec
from romgrl.provenance import shipped, source_digest, stage_keys
from romgrl.provenance.stage_keys import LABELS, STAGES, stage_key
from tests.cli.test_config import with_value
from tests.conftest import Composer
from tests.pretrained.untrained import write_shipped
from tests.provenance.test_stage_keys import all_keys, different

COSMETIC = {"stage", "threads", "parallel_stages", "checkpoint_seconds", "experiment", "paths.outputs", *LABELS}
KINDS = {"Python": {".py"}, "C++": {".cpp", ".hpp", ".txt"}, "built": {".so"}}
ROOT = Path(__file__).resolve().parents[2]


def is_cosmetic(key: str) -> bool:
    return key in COSMETIC or key.startswith(("tracking.", "watch."))


def test_every_leaf_is_semantic_or_cosmetic(
    compose_config: Composer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each leaf changed in turn: a new key for at least one stage, or the same keys for all if it is cosmetic."""
    config = compose_config()
    monkeypatch.setattr(shipped, "PLACE", write_shipped(tmp_path / "shipped", config))
    before = all_keys(config)
    right = {"semantic": 0, "cosmetic": 0}
    for key in schema_keys():
        changed = all_keys(with_value(config, key, changed_value(config, key, tmp_path))) != before
        assert changed != is_cosmetic(key), key
        right["semantic" if changed else "cosmetic"] += 1
    print(f"{right['semantic']} semantic and {right['cosmetic']} cosmetic of {len(schema_keys())} leaves")
    assert sum(right.values()) == len(schema_keys())


def changed_value(config: Config, key: str, directory: Path) -> object:
    """Another value; a file that exists where the key names one."""
    if key != "humanoid.xml":
        return different(value_of(config, key))
    spec = human_spec(height=1.741, mass=73.0)
    spec.compile()
    (directory / "model.xml").write_text(spec.to_xml(), encoding="utf-8")
    return str(directory / "model.xml")


@pytest.fixture
def copied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of package and C++ sources, which keys are made from while the test runs."""
    shutil.copytree(ROOT / "romgrl", tmp_path / "romgrl", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(ROOT / "cpp", tmp_path / "cpp")
    for name in STAGES:
        module = STAGES[name].function.partition(":")[0]
        for extension in [n for n, path in source_digest.source_files(module).items() if path.suffix == ".so"]:
            target = tmp_path.joinpath(*extension.split(".")).with_suffix(".so")
            shutil.copy(source_digest.source_files(module)[extension], target)
    monkeypatch.setattr(source_digest, "extension", lambda name: tmp_path.joinpath(*name.split(".")).with_suffix(".so"))
    monkeypatch.setattr(stage_keys, "source_digest", lambda entry: fresh_digest(entry, tmp_path))
    return tmp_path


def fresh_digest(entry: str, root: Path) -> str:
    return source_digest.digest(code(entry, root))


def code(entry: str, root: Path) -> dict[str, Path]:
    """The files of a stage in a copy."""
    modules = (entry.partition(":")[0], "romgrl.pipeline.worker")
    found = [source_digest.source_files(module, root / "romgrl", root / "cpp") for module in modules]
    return {name: path for files in found for name, path in files.items()}


def test_every_file_of_code_counts(copied: Path) -> None:
    """Each Python, C++ and built file that a stage can import, edited in turn: other code for just these stages."""
    used = {stage: code(STAGES[stage].function, copied) for stage in STAGES}
    before = {stage: source_digest.digest(used[stage]) for stage in STAGES}
    files = sorted({file for stage in STAGES for file in used[stage].values()})
    for file in files:
        content = file.read_bytes()
        file.write_bytes(content + b"\n")
        for stage in STAGES:
            assert (source_digest.digest(used[stage]) != before[stage]) == (file in used[stage].values()), (stage, file)
        file.write_bytes(content)
    kinds = {kind: sum(file.suffix in suffixes for file in files) for kind, suffixes in KINDS.items()}
    print(f"{len(files)} files edited in turn: {kinds}, each changes the code of its stages")
    assert kinds["Python"] >= 50
    assert kinds["C++"] >= 25
    assert kinds["built"] == 2


def test_a_training_does_not_depend_on_figures(copied: Path, compose_config: Composer) -> None:
    """Whoever edits a plot does not train again."""
    before = {stage: stage_key(stage, compose_config(), {}) for stage in STAGES}
    (copied / "romgrl" / "report" / "figures.py").write_text("# empty", encoding="utf-8")
    after = {stage: stage_key(stage, compose_config(), {}) for stage in STAGES}
    assert {stage for stage in STAGES if before[stage] != after[stage]} == {"report"}


def test_code_versions_and_upstream_artifacts_count(compose_config: Composer, monkeypatch: pytest.MonkeyPatch) -> None:
    config = compose_config()
    before = stage_key("reference", config, {"teacher": "a"})
    assert stage_key("reference", config, {"teacher": "b"}) != before
    monkeypatch.setattr(stage_keys, "source_digest", lambda entry: "other")
    assert stage_key("reference", config, {"teacher": "a"}) != before
    monkeypatch.undo()
    versions = stage_keys.computing_versions()
    assert set(versions) == {"python", "romgrl", "torch", "numpy", "mujoco"}
    for name in versions:
        monkeypatch.setattr(stage_keys, "computing_versions", lambda name=name: versions | {name: "0.0"})
        assert stage_key("reference", config, {"teacher": "a"}) != before
    monkeypatch.undo()
    assert stage_key("reference", config, {"teacher": "a"}) == before
