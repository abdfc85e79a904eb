"""What ships is run instead of trained, with the settings of its training, and only if it is whole."""

from __future__ import annotations

import os
import platform
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from romgrl.artifacts import open_artifact, read_manifest
from romgrl.cli.consistency import misfits
from romgrl.config.schema import Config
from romgrl.errors import ArtifactError, ConfigurationError
from romgrl.pipeline import run as pipeline
from romgrl.pretrained.__main__ import write_artifact
from romgrl.provenance import shipped as what_ships
from romgrl.provenance import stage_graph
from romgrl.provenance.shipped import GROUPS, require_shipped
from romgrl.provenance.stage_keys import stage_function, stage_settings
from romgrl.report.numbers import measured
from romgrl.report.terminal_tables import read_rows
from romgrl.runtime.stage_log import SilentLog
from romgrl.stages import pretrained as stages
from tests.conftest import Composer
from tests.helpers import untrained
from tests.helpers.configurations import all_keys, with_value
from tests.helpers.walkers import write_walker
from tests.pretrained.conftest import SMALL

PRESET = ("student=pretrained", *SMALL)
PACKAGE = what_ships.PLACE


@pytest.fixture
def no_training() -> Iterator[None]:
    """A training fails the test."""
    saved = dict(stage_graph.STAGES)
    untrained.replace_trainings("never")
    yield
    stage_graph.STAGES.update(saved)


@pytest.fixture
def config(compose_config: Composer, tmp_path: Path) -> Config:
    """The preset, with outputs in the test's directory."""
    return compose_config(*PRESET, f"paths.outputs={tmp_path}/outputs")


def made(outputs: Path, stage: str) -> Path:
    """The only artifact of a stage."""
    (path,) = (outputs / "artifacts" / stage).glob("*/manifest.json")
    return path.parent


def test_what_ships_is_what_was_trained(outputs: Path, place: Path) -> None:
    for stage in GROUPS:
        manifest, source = open_artifact(place / stage, stage=stage), read_manifest(made(outputs, stage))
        assert replace(manifest, run_id=source.run_id) == source


def test_nothing_that_ships_tells_about_a_machine(outputs: Path, place: Path, shipped: Path) -> None:
    manifest = replace(read_manifest(place / "teacher"), run_id="a" * 32)
    shutil.rmtree(shipped / "teacher")
    write_artifact(shipped / "teacher", manifest, made(outputs, "teacher"))
    assert read_manifest(shipped / "teacher").run_id is None
    texts = [path.read_text(encoding="utf-8") for path in shipped.rglob("*") if path.suffix in (".json", ".md", ".csv")]
    for private in ("a" * 32, str(outputs), str(Path.home()), platform.node(), os.sep + "tmp"):
        assert private
        assert not any(private in text for text in texts), private
    assert len(texts) == 5


def test_the_card_has_every_number_of_the_evaluation(outputs: Path, place: Path) -> None:
    card = (place / "MODEL_CARD.md").read_text(encoding="utf-8")
    for stage in GROUPS:
        assert read_manifest(place / stage).digest in card
    shown = {text.strip() for line in card.splitlines() if line.startswith("|") for text in line.split("|")}
    cells = [item for row in read_rows(made(outputs, "evaluation") / "gait.csv") for item in row.items()]
    numbers = [measured(name, float(value or "nan")) for name, value in cells if name != "walker"]
    print(f"{sum(number in shown for number in numbers)} of {len(numbers)} numbers of gait.csv in the card")
    assert len(numbers) >= 45
    assert set(numbers) <= shown
    assert "MIT" in card


def test_nothing_is_trained(
    config: Config, outputs: Path, shipped: Path, no_training: None, capsys: pytest.CaptureFixture[str]
) -> None:
    """All three come out as they ship, the log says so, and the evaluation is that of what was trained."""
    found = pipeline.run(config)
    for stage in GROUPS:
        artifact = read_manifest(found[stage])
        assert artifact.files == read_manifest(shipped / stage).files
        assert artifact.config[f"{GROUPS[stage]}.pretrained"] == f"sha256:{artifact.digest}"
    assert capsys.readouterr().out.count("pretrained, not trained here") == len(GROUPS)
    assert read_manifest(found["evaluation"]).digest == read_manifest(made(outputs, "evaluation")).digest


def test_the_key_follows_what_ships(config: Config, shipped: Path) -> None:
    """Other content is another key; a number of a training that nobody does is not."""
    before = all_keys(config)
    unused = all_keys(with_value(config, "student.gamma", 0.5))
    assert [unused[stage] for stage in GROUPS] == [before[stage] for stage in GROUPS]
    changed = 0
    for stage in GROUPS:
        write_walker(shipped / stage / "policy.safetensors", humanoid="another", seed=5)
        untrained.rewrite(shipped / stage, read_manifest(shipped / stage))
        changed += all_keys(config)[stage] != before[stage]
    print(f"{changed} of {len(GROUPS)} keys follow the content of what ships")
    assert changed == len(GROUPS)


REFUSED = [
    ("speed", 1.0, "speed: 1.0 is not allowed; allowed: 4.0, as the pretrained student was trained"),
    ("eta", 0.4, "eta: 0.4 is not allowed; allowed: 0.3, as the pretrained student was trained"),
    ("seed", 1, "seed: 1 is not allowed; allowed: 0, as the pretrained teacher was trained"),
    ("humanoid.mass", 80.0, "humanoid.mass: 80.0 is not allowed; allowed: 71.8, as the pretrained teacher was trained"),
    ("humanoid.actuation", "torque", "humanoid.actuation: torque is not allowed; allowed: servo, as the pretrained"),
    ("rom.friction", 0.5, "rom.friction: 0.5 is not allowed; allowed: 1.0, as the pretrained teacher was trained"),
    ("teacher.speed", 3.0, "teacher.speed: 3.0 is not allowed; allowed: 4.0, as the pretrained teacher was trained"),
    ("teacher.hidden_sizes", [8], "teacher.hidden_sizes: [8] is not allowed; allowed: [32, 32], as the pretrained"),
    ("teacher.pretrained", False, "teacher.pretrained: false is not allowed; allowed: true where student.pretrained"),
]
ALLOWED = [("student.gamma", 0.5), ("discriminator.window", 1), ("evaluation.episodes", 3), ("reference.episodes", 2)]


def test_settings_of_the_training_are_needed(config: Config, shipped: Path, tmp_path: Path) -> None:
    """One line each, before any work; what matters to nobody who runs it is left alone."""
    for key, value, line in REFUSED:
        with pytest.raises(ConfigurationError) as error:
            pipeline.run(with_value(config, key, value))
        assert str(error.value).startswith(line)
        assert "\n" not in str(error.value)
    assert not (tmp_path / "outputs").exists()
    for key, value in ALLOWED:
        assert not [*misfits(with_value(config, key, value))], key
    print(f"{len(REFUSED)} of {len(REFUSED)} other settings refused, {len(ALLOWED)} allowed")


def flip(path: Path) -> None:
    """Change one bit in the middle of a file."""
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


DAMAGES: dict[str, Callable[[Path], object]] = {
    "no files": shutil.rmtree,
    "no manifest": lambda path: (path / "manifest.json").unlink(),
    "no policy": lambda path: (path / "policy.safetensors").unlink(),
    "another policy": lambda path: flip(path / "policy.safetensors"),
    "another manifest": lambda path: flip(path / "manifest.json"),
    "more files": lambda path: (path / "more.csv").write_text("a\n", encoding="utf-8"),
}


def test_damaged_files_are_named(config: Config, place: Path, shipped: Path, tmp_path: Path) -> None:
    """Exit code 3 and one line with the file, before any work."""
    named = 0
    for damage in DAMAGES.values():
        for stage in GROUPS:
            damage(shipped / stage)
            with pytest.raises(ArtifactError) as error:
                pipeline.run(config)
            named += str(shipped / stage) in str(error.value) and "\n" not in str(error.value)
            assert error.value.exit_code == 3
            shutil.rmtree(shipped / stage, ignore_errors=True)
            shutil.copytree(place / stage, shipped / stage)
    print(f"{named} of {len(DAMAGES) * len(GROUPS)} damaged artifacts named")
    assert named == len(DAMAGES) * len(GROUPS)
    assert not (tmp_path / "outputs").exists()


def test_a_walker_of_another_humanoid_is_refused(config: Config, shipped: Path, tmp_path: Path) -> None:
    """Whole as it is, it does not fit: the humanoid of this version is another."""
    write_walker(shipped / "student" / "policy.safetensors", humanoid="another")
    untrained.rewrite(shipped / "student", read_manifest(shipped / "student"))
    with pytest.raises(ArtifactError, match="humanoid"):
        stages.student(config, {}, tmp_path, SilentLog())


def test_the_teacher_alone(compose_config: Composer, shipped: Path) -> None:
    """A student may be trained on the teacher that ships, at another speed."""
    config = compose_config("teacher=pretrained", *SMALL, "speed=3")
    assert not [*misfits(config)]
    assert stage_function("teacher", config) == "romgrl.stages.pretrained:teacher"
    assert {stage_function(stage, config) for stage in ("student", "baseline")} == {"romgrl.stages.student:run"}
    assert stage_settings("student", config)["speed"] == 3.0


def test_the_package_and_its_preset_fit(compose_config: Composer) -> None:
    """What ships fits the preset, and its card is of it; a package without walkers says so."""
    config = compose_config("student=pretrained", "tracking=none")
    if not (PACKAGE / "MODEL_CARD.md").exists():
        with pytest.raises(ArtifactError, match="a pretrained teacher comes with romgrl"):
            require_shipped(config)
        return
    require_shipped(config)
    assert not [*misfits(config)]
    for stage in GROUPS:
        assert read_manifest(PACKAGE / stage).digest in (PACKAGE / "MODEL_CARD.md").read_text(encoding="utf-8")
