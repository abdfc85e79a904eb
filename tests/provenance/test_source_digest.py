"""What a stage key covers: every leaf of the configuration, every file of code, versions and upstream artifacts."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from romgrl.config.schema import Config
from romgrl.config.values import keys_of, value_of
from romgrl.humanoid.own_body import human_spec
from romgrl.provenance import shipped, source_digest, stage_keys
from romgrl.provenance.stage_graph import STAGES
from romgrl.provenance.stage_keys import NAME_KEYS, stage_key
from tests.conftest import Composer
from tests.helpers.configurations import all_keys, with_value
from tests.helpers.cycles import write_cycles
from tests.helpers.synthetic_library import synthetic_library, write_library
from tests.helpers.untrained import write_shipped
from tests.provenance.test_stage_keys import different

COSMETIC = {
    "stage",
    "objective",
    "threads",
    "parallel_stages",
    "checkpoint_seconds",
    "experiment",
    "comparison",
    "paths.outputs",
    *NAME_KEYS,
}
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
    for key in keys_of(config):
        changed = all_keys(with_value(config, key, changed_value(config, key, tmp_path))) != before
        assert changed != is_cosmetic(key), key
        right["semantic" if changed else "cosmetic"] += 1
    print(f"{right['semantic']} semantic and {right['cosmetic']} cosmetic of {len(keys_of(config))} leaves")
    assert sum(right.values()) == len(keys_of(config))


def changed_value(config: Config, key: str, directory: Path) -> object:
    """Another value; a file or an artifact that exists where the key names one."""
    if key == "library.others":
        return [write_library(directory / "library", *synthetic_library())]
    if key == "evaluation.specialists":  # any artifact is one to a key, which is made when it has been looked at
        return [write_library(directory / "evaluation", *synthetic_library(), stage="evaluation")]
    if key == "teacher.cycles":
        write_cycles(directory / "cycles", config)
        return str(directory / "cycles")
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

    def fresh_digest(entry: str, *, drawing: bool) -> str:
        files = source_digest.stage_files(entry, drawing=drawing, package=tmp_path / "romgrl", core=tmp_path / "cpp")
        return source_digest.digest(files)

    monkeypatch.setattr(stage_keys, "source_digest", fresh_digest)
    return tmp_path


def code(stage: str, root: Path) -> dict[str, Path]:
    """The files of a stage in a copy."""
    function, drawing = STAGES[stage].function, STAGES[stage].drawn
    return source_digest.stage_files(function, drawing=drawing, package=root / "romgrl", core=root / "cpp")


def test_every_file_of_code_counts(copied: Path) -> None:
    """Each Python, C++ and built file that a stage can import, edited in turn: other code for just these stages."""
    used = {stage: code(stage, copied) for stage in STAGES}
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


ROM_LEARNED, TRAINED = {"teacher", "reference"}, {"student", "baseline"}
HUMANOID_RUNS = TRAINED | {"evaluation", "robustness", "export"}
ROM_RUNS = ROM_LEARNED | {"library", "evaluation", "robustness"}  # an evaluation beside another teacher
EDITED = {
    "errors.py": set(STAGES),
    "config/schema.py": set(),
    "config/worlds.py": set(),
    "config/commanded.py": set(),
    "config/addresses.py": set(),
    "cli/arguments.py": set(),
    "cli/consistency.py": set(),
    "cli/other_libraries.py": set(),
    "cli/conditioned_students.py": set(),
    "cli/specialists.py": set(),
    "cli/onnx_installed.py": set(),
    "runtime/stage_log.py": set(STAGES),
    "runtime/cores.py": set(),
    "artifacts/checkpoint.py": TRAINED | {"teacher", "library"},
    "artifacts/locks.py": set(),
    "provenance/stage_keys.py": set(),
    "provenance/stage_graph.py": set(),
    "provenance/library_grid.py": {"library"},
    "provenance/cycles.py": {"teacher"},
    "tracking/recorder.py": set(),
    "tracking/sending/store.py": set(),
    "rom/vector_env.py": ROM_RUNS | {"report"},
    "rom/registry.py": ROM_RUNS | {"report"},
    "rom/return_map.py": {"robustness", "library"},
    "rom/phase_policy.py": ROM_RUNS,
    "rom/drawing.py": {"report", "robustness", "library"},
    "humanoid/skeleton.py": set(STAGES),
    "humanoid/own_body.py": set(STAGES),  # its sizes are those of the reduced-order model
    "humanoid/joints.py": set(STAGES),
    "humanoid/load_sensors.py": set(STAGES),  # of the model
    "humanoid/loads.py": {"evaluation"},
    "humanoid/task.py": HUMANOID_RUNS,
    "humanoid/vector_env.py": HUMANOID_RUNS,
    "humanoid/commands.py": HUMANOID_RUNS,
    "humanoid/command_schedules.py": HUMANOID_RUNS,
    "humanoid/start_states.py": HUMANOID_RUNS,
    "humanoid/planar_observer.py": HUMANOID_RUNS,
    "humanoid/rendering.py": {"report", "robustness"},
    "humanoid/reference_states.py": TRAINED | {"export"},
    "humanoid/cell_states.py": TRAINED | {"export"},
    "humanoid/command_limits.py": {"export"},
    "humanoid/changed_body.py": {"robustness"},
    "humanoid/model_xml.py": {"export"},
    "gait/discriminator_windows.py": TRAINED,
    "gait/symmetry.py": set(STAGES),
    "gait/alignment.py": TRAINED | {"evaluation", "report", "library"},  # the check of a training's gait, and pages
    "gait/load_metrics.py": set(STAGES),  # among the rows of a gait, which every check reads
    "gait/gait_classes.py": TRAINED,
    "gait/command_following.py": TRAINED,
    "gait/floquet.py": {"robustness", "library"},
    "gait/measures.py": {"report", "library"},
    "algorithms/ppo.py": {"teacher"},
    "provenance/kept_check.py": TRAINED,
    "provenance/taught_cells.py": TRAINED | {"export"},
    "provenance/grid_episodes.py": set(),  # of the evaluation of a conditioned student
    "algorithms/ppo_policy.py": ROM_RUNS,
    "algorithms/rollout_buffer.py": {"teacher"},
    "algorithms/networks/running_normalizer.py": ROM_RUNS | TRAINED,
    "algorithms/sac.py": HUMANOID_RUNS,
    "algorithms/replay_buffer.py": HUMANOID_RUNS,
    "algorithms/networks/stacked_mlp.py": ROM_RUNS | HUMANOID_RUNS,
    "algorithms/onnx_policy.py": {"export"},
    "algorithms/discriminator.py": TRAINED,
    "algorithms/commanded_windows.py": TRAINED,
    "algorithms/conditioned_discriminator.py": TRAINED,
    "algorithms/conditioned_rom_grl.py": TRAINED,
    "algorithms/relabelling.py": TRAINED,
    "stages/conditioned/asked_at_first.py": {"export"},
    "stages/conditioned/cells.py": TRAINED | {"export"},
    "stages/conditioned/command_keys.py": set(),
    "stages/conditioned/command_watch.py": TRAINED,
    "stages/conditioned/commanded_frames.py": TRAINED,
    "stages/conditioned/conditioned_learner.py": TRAINED,
    "stages/conditioned/curriculum.py": TRAINED,
    "stages/conditioned/grid_check.py": TRAINED,
    "stages/conditioned/asked_episodes.py": set(),  # of the evaluation of a conditioned student, as all of these
    "stages/conditioned/grid_cells.py": set(),
    "stages/conditioned/grid_summary.py": set(),
    "stages/conditioned/transitions.py": set(),
    "stages/grid_evaluation.py": set(),
    "stages/grid_report.py": set(),
    "stages/conditioned/grid_artifact.py": set(),
    "stages/wiring/rom.py": ROM_RUNS | {"report"},
    "stages/wiring/humanoid.py": HUMANOID_RUNS,
    "stages/wiring/artifact_arrays.py": TRAINED | {"evaluation", "report", "robustness"},
    "stages/training/cycle_bank.py": {"teacher"},
    "stages/training/gait_check.py": TRAINED,
    "stages/training/adapted_eta.py": TRAINED,
    "stages/training/student_statistics.py": TRAINED,
    "gait/recording.py": ROM_LEARNED | TRAINED | {"library", "evaluation"},
    "stages/rollouts/humanoid.py": {"evaluation"},
    "stages/rollouts/disturbed.py": {"robustness"},
    "stages/library.py": {"library"},
    "stages/exporting/run_policy.py": {"export"},
    "stages/exporting/follow_commands.py": {"export"},
    "report/finished_library.py": TRAINED | {"library", "export"},
    "report/library_table.py": set(),
    "report/grid_tables.py": set(),
    "report/specialists.py": set(),
    "report/cost_over_speed.py": set(),
    "report/gait_atlas.py": {"library"},
    "report/figures.py": {"report"},
    "report/library_cells.py": {"library"},
    "report/page/scene.py": {"report", "library"},
    "report/page/library_page.py": {"library"},
    "report/page/player.js": {"report", "library"},
    "report/page/cells.js": {"report", "library"},
    "report/page/cells.html": {"report", "library"},
    "report/page/commands_page.py": set(),
    "report/page/played_cells.py": set(),
    "report/command_grid.py": set(),
    "report/grid_figure.py": set(),
    "report/ramp_strides.py": set(),
    "report/ramp_film.py": set(),
    "report/terminal_tables.py": set(),
    "results/statistics.py": set(),
    "results/exact_tests.py": set(),
    "results/seed_groups.py": set(),
    "pipeline/run.py": set(),
    "pipeline/worker.py": set(STAGES),
    "sweeps/launch.py": set(),
    "pretrained/card.py": set(),
    "pretrained/conditioned.py": set(),
    "../cpp/common/thread_pool.cpp": set(STAGES),
    "../cpp/rom/batch.cpp": ROM_RUNS | {"report"},
    "../cpp/rom/native/kernel.cpp": ROM_RUNS | {"report"},
    "../cpp/rom/native/contact.hpp": ROM_RUNS | {"report"},
    "../cpp/humanoid/planar_bodies.cpp": HUMANOID_RUNS,
}  # which stages are made again when a file is edited, by hand


def test_rooms_are_walls_between_trainings(copied: Path, compose_config: Composer) -> None:
    """Each file is code of the stages that are made again when it is edited, and of no other; every room is there."""
    used = {stage: {path.resolve() for path in code(stage, copied).values()} for stage in STAGES}
    wrong = []
    for name, expected in EDITED.items():
        path = (copied / "romgrl" / name).resolve()
        changed = {stage for stage in STAGES if path in used[stage]}
        wrong += [f"{name}: {sorted(changed)}, not {sorted(expected)}"] if changed != expected else []
    assert not wrong, "\n".join(wrong)
    config, edited = compose_config(), copied / "romgrl" / "gait" / "alignment.py"
    before = {stage: stage_key(stage, config, {}) for stage in STAGES}
    edited.write_bytes(edited.read_bytes() + b"\n")
    assert {stage for stage in STAGES if before[stage] != stage_key(stage, config, {})} == EDITED["gait/alignment.py"]
    rooms = {path.name for path in (ROOT / "romgrl").iterdir() if path.is_dir() and any(path.glob("*.py"))}
    assert {name.partition("/")[0] for name in EDITED if "/" in name} - {".."} == rooms


def test_code_versions_and_upstream_artifacts_count(compose_config: Composer, monkeypatch: pytest.MonkeyPatch) -> None:
    config = compose_config()
    before = stage_key("reference", config, {"teacher": "a"})
    assert stage_key("reference", config, {"teacher": "b"}) != before
    monkeypatch.setattr(stage_keys, "source_digest", lambda entry, drawing: "other")
    assert stage_key("reference", config, {"teacher": "a"}) != before
    monkeypatch.undo()
    versions = stage_keys.computing_versions()
    assert set(versions) == {"python", "romgrl", "torch", "numpy", "mujoco"}
    for name in versions:
        monkeypatch.setattr(stage_keys, "computing_versions", lambda name=name: versions | {name: "0.0"})
        assert stage_key("reference", config, {"teacher": "a"}) != before
    monkeypatch.undo()
    assert stage_key("reference", config, {"teacher": "a"}) == before
