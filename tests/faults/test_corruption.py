"""Damage is found and named, the damaged artifact is never used and is kept, and the same command makes it anew."""

from __future__ import annotations

import io
import random
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from romgrl.artifacts import open_artifact, setting_aside
from romgrl.config.schema import Config
from romgrl.errors import ArtifactError
from romgrl.pipeline import run as pipeline
from romgrl.provenance import stage_graph
from tests.conftest import Composer
from tests.helpers import fake_stages
from tests.helpers.jobs import trainings

Damage = Callable[[Path, random.Random], Path]  # spoils the artifact, returns the file to be named


@pytest.fixture(scope="module")
def pristine(compose_config: Composer, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """A real teacher and reference, and a fake artifact of every other stage."""
    outputs = tmp_path_factory.mktemp("pristine")
    config = compose_config("experiment=smoke", "threads=1", "tracking=none", f"paths.outputs={outputs}/real")
    real = pipeline.run(replace(config, stage="reference"), console=Console(file=io.StringIO()))
    saved = dict(stage_graph.STAGES)
    fake_stages.install()
    fake = compose_config("experiment=smoke", "threads=1", "tracking=none", f"paths.outputs={outputs}/fake")
    faked = pipeline.run(fake, console=Console(file=io.StringIO()))
    stage_graph.STAGES.update(saved)
    return [*real.values(), *faked.values()]


def files(directory: Path) -> list[Path]:
    return sorted(path for path in directory.rglob("*") if path.is_file())


def truncate(directory: Path, draw: random.Random) -> Path:
    path = draw.choice(files(directory))
    path.write_bytes(path.read_bytes()[: draw.randrange(path.stat().st_size)])
    return path


def flip(directory: Path, draw: random.Random) -> Path:
    path = draw.choice(files(directory))
    content = bytearray(path.read_bytes())
    content[draw.randrange(len(content))] ^= 1 << draw.randrange(8)
    path.write_bytes(content)
    return path


def remove(directory: Path, draw: random.Random) -> Path:
    path = draw.choice(files(directory))
    path.unlink()
    return path


def add(directory: Path, draw: random.Random) -> Path:
    path = directory / draw.choice(["more.csv", "policy2.safetensors", "a/b.npz", "copy.pt"])
    path.parent.mkdir(exist_ok=True)
    shutil.copy(draw.choice(files(directory)), path)
    return path


def swap(directory: Path, draw: random.Random) -> Path:
    payload = [path for path in files(directory) if path.name != "manifest.json"]
    one, other = sorted(draw.sample(payload, 2)) if len(payload) > 1 else (payload[0], directory / "manifest.json")
    content = one.read_bytes()
    shutil.copy(other, one)
    other.write_bytes(content)
    return other if other.name == "manifest.json" else one


KINDS: dict[str, tuple[int, Damage]] = {
    "truncated": (100, truncate),
    "one bit flipped": (100, flip),
    "missing": (6, remove),
    "extra": (6, add),
    "swapped": (4, swap),
}


def copy_of(artifact: Path, directory: Path) -> Path:
    """The same artifact under another output directory."""
    place = directory / artifact.parent.name / artifact.name
    shutil.copytree(artifact, place)
    return place


def test_all_damage_is_found_named_and_set_aside(pristine: list[Path], tmp_path: Path) -> None:
    draw, found, total = random.Random(0), 0, 0
    for kind, (rounds, spoil) in KINDS.items():
        for number in range(rounds):
            place = copy_of(pristine[number % len(pristine)], tmp_path / kind / str(number))
            stage, key = place.parent.name, place.name
            open_artifact(place, stage=stage, key=key)
            path = spoil(place, draw)
            spoiled = {file.relative_to(place): file.read_bytes() for file in files(place)}
            with pytest.raises(ArtifactError) as caught, setting_aside(place):
                open_artifact(place, stage=stage, key=key)
            assert str(caught.value).startswith(f"{path}: "), f"{kind} {number}"
            (aside,) = place.parent.iterdir()
            assert aside.name in str(caught.value)
            assert {file.relative_to(aside): file.read_bytes() for file in files(aside)} == spoiled
            found += 1
            total += 1
    for number in range(4):  # whole directories in one another's place
        one, other = (
            copy_of(artifact, tmp_path / "exchanged" / str(number)) for artifact in pristine[number : number + 2]
        )
        shutil.rmtree(one)
        other.rename(one)
        with pytest.raises(ArtifactError, match=r"manifest\.json: made by") as caught, setting_aside(one):
            open_artifact(one, stage=one.parent.name, key=one.name)
        found += str(caught.value).startswith(str(one / "manifest.json")) and not one.exists()
        total += 1
    assert found == total == 220
    print(f"{found} of {total} damaged artifacts found, named and set aside")


@pytest.mark.usefixtures("fakes")
def test_a_job_stops_and_the_same_command_makes_it_anew(smoke_config: Config) -> None:
    """Of every stage in turn; nothing that reads the damaged artifact runs before."""
    config = replace(smoke_config, tracking=replace(smoke_config.tracking, enabled=False))
    outputs, draw, ended = Path(config.paths.outputs), random.Random(1), 0
    finished = pipeline.run(config, console=Console(file=io.StringIO()))
    for stage, place in finished.items():
        for spoil in (flip, remove):
            before = len(trainings(outputs))
            path = spoil(place, draw)
            with pytest.raises(ArtifactError, match="the same command makes it anew") as caught:
                pipeline.run(config, console=Console(file=io.StringIO()))
            assert str(caught.value).startswith(str(path))
            assert len(str(caught.value).splitlines()) == 1
            assert (caught.value.exit_code, len(trainings(outputs))) == (3, before)
            assert pipeline.run(config, console=Console(file=io.StringIO())) == finished
            open_artifact(place, stage=stage, key=place.name)
            assert len(trainings(outputs)) == before + 1
            assert len(list(place.parent.glob(f"{place.name}.damaged-*"))) in (1, 2)
            ended += 1
    assert ended == 12
    print(f"{ended} of 12 jobs ended with exit code 3 and succeeded when repeated")
