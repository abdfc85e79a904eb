"""The student that follows commands ships with what taught it, small and as a whole, and runs without a training."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from romgrl.artifacts import open_artifact, read_manifest, write_manifest
from romgrl.cli.consistency import misfits
from romgrl.config.schema import Config
from romgrl.config.values import show
from romgrl.errors import ArtifactError, ConfigurationError
from romgrl.pipeline import run as pipeline
from romgrl.pretrained import conditioned
from romgrl.pretrained.__main__ import main
from romgrl.provenance import kept_check, stage_graph
from romgrl.provenance import shipped as what_ships
from romgrl.provenance.stage_keys import stage_settings
from romgrl.runtime.stage_log import SilentLog
from romgrl.stages import watch
from tests.conftest import Composer
from tests.helpers import untrained
from tests.helpers.commanded import shipped_follower, small_library
from tests.helpers.configurations import with_value

PRESET = "student=pretrained_conditioned"
SMALL = ("reference.steps=240", "reference.episodes=2", "evaluation.window=100", "threads=1", "tracking=none")
CHECKS = [(800, 2.0, 9.0), (800, 3.0, 1.0), (1600, 2.0, 4.0), (1600, 3.0, 5.5), (2400, 2.0, 0.5), (2400, 3.0, 7.25)]


@pytest.fixture(scope="module")
def made(compose_config: Composer, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A teacher, its library and the student of that, none of which has learned to follow."""
    place = tmp_path_factory.mktemp("made")
    config = compose_config(PRESET, "student.pretrained=false", "stage=student", *SMALL)
    artifacts, facts = place / "artifacts", {"versions": {}, "revision": "f" * 40, "dirty": False, "seed": 0}
    teacher = artifacts / "teacher" / ("2" * 16)
    teacher.mkdir(parents=True)
    untrained.teacher(config, {}, teacher, SilentLog())
    settings = {stage: json.loads(json.dumps(stage_settings(stage, config))) for stage in ("teacher", "library")}
    write_manifest(
        teacher, stage="teacher", key="2" * 16, config=settings["teacher"], inputs={}, wall_time=9.0, **facts
    )
    library = small_library(artifacts / "library" / "fedcba9876543210")
    found = replace(read_manifest(library), config=settings["library"], seed=0)
    untrained.rewrite(library, replace(found, inputs={"teacher": read_manifest(teacher).digest}))
    student = shipped_follower(artifacts / "student" / ("1" * 16), config)
    table = pd.DataFrame(CHECKS, columns=["step", "speed_m_per_s", "shortfall"])
    table.to_csv(student / "checks.csv", index=False)
    untrained.rewrite(student, replace(read_manifest(student), inputs={"library": read_manifest(library).digest}))
    return place


@pytest.fixture(scope="module")
def packed(made: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the command put in the place of the package's files."""
    place = tmp_path_factory.mktemp("package")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(what_ships, "PLACE", place)
        assert main([str(made), PRESET, *SMALL]) == 0
    return place


@pytest.fixture
def ships(packed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copytree(packed, tmp_path / "package")
    monkeypatch.setattr(what_ships, "PLACE", tmp_path / "package")
    return tmp_path / "package"


@pytest.fixture
def no_training() -> Iterator[None]:
    saved = dict(stage_graph.STAGES)
    untrained.replace_trainings("never")
    yield
    stage_graph.STAGES.update(saved)


def test_it_is_small_and_only_the_library_is_cut(made: Path, packed: Path) -> None:
    place = packed / "conditioned"
    for stage in ("teacher", "student"):
        (source,) = (made / "artifacts" / stage).iterdir()
        assert open_artifact(place / stage, stage=stage).files == read_manifest(source).files
    manifest = open_artifact(place / "library", stage="library")
    assert manifest.inputs["library"] == read_manifest(made / "artifacts" / "library" / "fedcba9876543210").digest
    table = pd.read_csv(place / "library" / "library.csv")
    assert (len(table), table.stiffness_share.unique().tolist()) == (5, [1.0])
    assert {path.name for path in packed.iterdir()} == {"conditioned"}
    size = sum(path.stat().st_size for path in packed.rglob("*") if path.is_file())
    print(f"{size:,} bytes ship")
    assert size < conditioned.LARGEST_SHIPPED


def test_the_card_has_the_numbers_of_the_policy_that_was_kept(packed: Path) -> None:
    """The worst cell of step 1600 is better than those of the others."""
    card = (packed / "conditioned" / "MODEL_CARD.md").read_text(encoding="utf-8")
    rows = [line for line in card.splitlines() if line.startswith("| ")]
    assert [row for row in rows if "5.5" in row]
    assert not [row for row in rows if "7.25" in row or " 9 |" in row]
    assert "run 2 to 4 m/s, walk 1 to 2 m/s" in card
    assert read_manifest(packed / "conditioned" / "student").digest in card
    assert "Not evaluated yet" in card


def test_card_and_training_keep_by_the_same_rule(made: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By the mean of all cells it is another check that is the best."""
    found = {"student": conditioned.artifacts_of(made, "student")[0]}
    assert "5.5" in conditioned.scores(found)
    monkeypatch.setattr(kept_check, "WORST", 1.0)
    assert "7.25" in conditioned.scores(found)


def test_tables_of_an_evaluation_take_their_place(made: Path, tmp_path: Path) -> None:
    outputs = Path(shutil.copytree(made, tmp_path / "outputs"))
    place = outputs / "artifacts" / "evaluation" / ("3" * 16)
    place.mkdir(parents=True)
    pd.DataFrame({"walker": ["student"], "stride_frequency_hz": [1.23]}).to_csv(place / "gait.csv", index=False)
    student = read_manifest(outputs / "artifacts" / "student" / ("1" * 16))
    facts = {"versions": {}, "revision": None, "dirty": None, "seed": 0, "wall_time": 1.0, "config": {}}
    write_manifest(place, stage="evaluation", key="3" * 16, inputs={"student": student.digest}, **facts)
    found = {each.manifest.stage: each for stage in ("student", "evaluation") for each in
             conditioned.artifacts_of(outputs, stage)}  # fmt: skip
    text = conditioned.scores(found)
    assert "1.23" in text
    assert "Not evaluated yet" not in text


def test_it_runs_without_a_training(
    compose_config: Composer, ships: Path, tmp_path: Path, no_training: None, capsys: pytest.CaptureFixture[str]
) -> None:
    config = compose_config(PRESET, "stage=export", "speed=2.3", f"paths.outputs={tmp_path}/outputs", *SMALL)
    found = pipeline.run(config)
    assert [*found] == ["teacher", "library", "student", "export"]
    told = capsys.readouterr().out
    assert told.count("pretrained, not trained here") == 2
    assert "pretrained, not made here" in told
    begins = json.loads((found["export"] / "policy.json").read_text(encoding="utf-8"))["command"]["begin"]
    assert begins == {"speed": 2.3, "gait": "run", "style": 1.0}


def test_it_is_watched_as_it_lies_there(
    compose_config: Composer, ships: Path, tmp_path: Path, no_training: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[np.ndarray] = []
    monkeypatch.setattr(watch, "no_viewer", lambda: watch.NO_DISPLAY)
    monkeypatch.setattr(watch, "film", lambda env, *_: (env.reset(seed=0), seen.append(env.command()[0, -4:])))
    pipeline.run(compose_config(PRESET, "stage=watch", "speed=1.5", f"paths.outputs={tmp_path}/outputs", *SMALL))
    assert seen[0].tolist() == [1.5, 0.0, 1.0, 1.0]
    assert not (tmp_path / "outputs" / "artifacts").exists()


REFUSED = {
    "speed": (9.0, "allowed: 0 (to stand), run 2 to 4 m/s, walk 1 to 2 m/s"),
    "humanoid.mass": (80.0, "allowed: 71.8, as the pretrained"),
    "student.standing_share": (0.0, "allowed: 0.05, as the pretrained student was trained"),
    "library.others": (["/elsewhere"], "allowed: null with student.pretrained=true: its library ships"),
    "student.taught_step": (2.0, "allowed: null, as the pretrained student was trained"),
}


@pytest.mark.parametrize("key", REFUSED)
def test_what_it_was_not_made_for_is_refused_before_any_work(
    compose_config: Composer, ships: Path, tmp_path: Path, key: str
) -> None:
    value, told = REFUSED[key]
    config = compose_config(PRESET, "stage=watch", "speed=2", f"paths.outputs={tmp_path}/outputs", *SMALL)
    assert not [*misfits(config)]
    with pytest.raises(ConfigurationError) as error:
        pipeline.run(with_value(config, key, value))
    assert str(error.value).startswith(f"{key}: {show(value)} is not allowed; ")
    assert told in str(error.value)
    assert "\n" not in str(error.value)
    assert not (tmp_path / "outputs").exists()


@pytest.mark.parametrize("damage", ["nothing ships", "no student", "another library"])
def test_what_does_not_ship_is_said_in_one_line(
    compose_config: Composer, ships: Path, tmp_path: Path, damage: str
) -> None:
    place = ships / "conditioned"
    if damage == "another library":
        (place / "library" / "library.csv").write_text("gait\n", encoding="utf-8")
    else:
        shutil.rmtree(place if damage == "nothing ships" else place / "student")
    for stage in ("watch", "export", "student"):
        config = compose_config(PRESET, f"stage={stage}", f"paths.outputs={tmp_path}/outputs", *SMALL)
        with pytest.raises(ArtifactError, match=r"`make pretrained_conditioned` trains and packs it") as error:
            pipeline.run(config)
        assert str(place) in str(error.value)
        assert "\n" not in str(error.value)
    assert not (tmp_path / "outputs").exists()


def test_why_nothing_is_packed(made: Path, ships: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = {path: path.read_bytes() for path in ships.rglob("*") if path.is_file()}
    assert main([str(made), PRESET, *SMALL, "student.gamma=0.5"]) == 3
    assert "instead of 0.5" in capsys.readouterr().err
    assert main([str(made / "none"), PRESET, *SMALL]) == 3
    assert capsys.readouterr().err == f"{made / 'none'}: no such directory\n"
    assert main([str(made / "artifacts"), PRESET, *SMALL]) == 3
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith("no student with the settings of student=pretrained_conditioned")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(conditioned, "LARGEST_SHIPPED", 1000)
        assert main([str(made), PRESET, *SMALL]) == 3
    assert "bytes would ship; at most 1000 may" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in ships.rglob("*") if path.is_file()} == before


def test_the_preset_is_the_training_that_every_speed_makes(compose_config: Composer) -> None:
    def settings(*overrides: str) -> tuple[Config, dict[str, object]]:
        config = compose_config(*overrides, "stage=student")
        return config, stage_settings("student", config)

    assert settings(PRESET, "student.pretrained=false")[1] == settings("experiment=every_speed", "seed=5")[1]


def test_what_ships_is_whole_and_what_the_preset_asks_for(compose_config: Composer) -> None:
    config = compose_config("student=pretrained_conditioned", "speed=2.3")
    what_ships.require_shipped(config)
    assert not [*misfits(config)]
    library = what_ships.shipped_directory("library", conditioned=True) / "library.csv"
    assert pd.read_csv(library).fit.all()
