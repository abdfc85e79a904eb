"""Which key of the configuration changes the key of which stage."""

from __future__ import annotations

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from romgrl.config.schema import Config
from romgrl.errors import ArtifactError
from romgrl.humanoid.digest import stable
from romgrl.humanoid.own_body import human_spec
from romgrl.provenance import shipped
from romgrl.provenance.stage_graph import STAGES
from romgrl.provenance.stage_keys import (
    body_digests,
    require_same_body,
    require_same_libraries,
    stage_key,
    stage_settings,
)
from tests.conftest import Composer
from tests.helpers.configurations import all_keys
from tests.helpers.synthetic_library import synthetic_library, write_library

ALL = set(STAGES)
STUDENT = {"student", "evaluation", "report", "robustness", "export"}
BOTH = STUDENT | {"baseline"}
TABLE = {
    "speed=3": BOTH,
    "eta=0.4": STUDENT,
    "noise=0.1": STUDENT,
    "discriminator.learning_rate=1e-3": STUDENT,
    "discriminator=paper": STUDENT,
    "discriminator=none": STUDENT,
    "student.gamma=0.97": BOTH,
    "humanoid.fall_trunk_lean=0.7": BOTH,
    "humanoid.substeps=8": BOTH,
    "humanoid.height=1.6": ALL,
    "humanoid.control_frequency=60": ALL,
    "rom.stiffness=20000": ALL - {"baseline"},
    "teacher.speed=3": ALL - {"baseline"},
    "reference.steps=1000": ALL - {"baseline", "teacher"},
    "evaluation.episodes=8": {"evaluation", "report"},
    "robustness.trials=8": {"robustness"},
    "seed=1": ALL,
    "device=cuda": ALL,
    "threads=1": set(),
    "parallel_stages=false": set(),
    "stage=teacher": set(),
    "tracking=none": set(),
    "tracking.experiment=mine": set(),
    "paths.outputs=/elsewhere": set(),
}
MESH = "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.mark.parametrize("override", TABLE)
def test_which_key_changes_what(compose_config: Composer, override: str) -> None:
    before, after = all_keys(compose_config()), all_keys(compose_config(override))
    assert {stage for stage in STAGES if before[stage] != after[stage]} == TABLE[override]


def test_the_teacher_that_ships_counts_where_it_is_compared_with(
    compose_config: Composer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = all_keys(compose_config())
    monkeypatch.setattr(shipped, "PLACE", tmp_path)
    assert shipped.shipped_digest("teacher") is None  # nothing is there: the row is missing, the job is not refused
    after = all_keys(compose_config())
    assert {stage for stage in STAGES if before[stage] != after[stage]} == {"evaluation", "report"}


def different(value: object) -> object:
    """Another value of the same type."""
    if isinstance(value, list):
        return [*value, value[0]]
    if isinstance(value, bool):
        return not value
    if isinstance(value, int | float):
        return value + 1
    return "other" if isinstance(value, str) else 1.0


def test_keys_are_the_same_in_every_process(compose_config: Composer) -> None:
    """Defaults, order of keys and of stages do not enter; two compositions agree."""
    assert all_keys(compose_config("eta=0.3", "seed=0")) == all_keys(compose_config("seed=0", "speed=4"))


def test_no_imitation_makes_noise_and_eta_irrelevant(compose_config: Composer) -> None:
    one = all_keys(compose_config("discriminator=none", "eta=0.2", "noise=0.3"))
    assert one == all_keys(compose_config("discriminator=none"))


def keys_of_body(config: Config, directory: Path, main: str, included: str, mesh: str = MESH) -> dict[str, str]:
    """Keys of all stages with a model in three files."""
    directory.mkdir()
    for name, text in (("robot.xml", main), ("body.xml", included), ("foot.obj", mesh)):
        (directory / name).write_text(text, encoding="utf-8")
    return all_keys(replace(config, humanoid=replace(config.humanoid, xml=str(directory / "robot.xml"))))


@pytest.fixture(scope="module")
def body() -> tuple[str, str]:
    """The project's own humanoid as a file that includes another, which shows a mesh."""
    spec = human_spec(height=1.741, mass=71.8)
    spec.compile()
    head, _, rest = spec.to_xml().partition("<worldbody>")
    world, _, tail = rest.partition("</worldbody>")
    head += '<include file="body.xml"/><asset><mesh name="foot" file="foot.obj"/></asset>'
    shown = world.replace("</body>", '<geom type="mesh" mesh="foot" mass="0" contype="0" conaffinity="0"/></body>', 1)
    return head + tail, f"<mujocoinclude><worldbody>{shown}</worldbody></mujocoinclude>"


def test_a_model_counts_as_what_its_files_describe(
    compose_config: Composer, body: tuple[str, str], tmp_path: Path
) -> None:
    """Included files and meshes count, places and comments do not; the teacher depends on sizes, films on colours."""
    config, (main, included) = compose_config(), body
    before = keys_of_body(config, tmp_path / "before", main, included)
    heavier, softer, redder = (
        re.sub(pattern, rf"\g<1>{value}", included, count=1)
        for pattern, value in ((r'( mass=")\d', "9"), (r'(damping=")\d', "9"), (r'(rgba=")0.\d', "0.9"))
    )
    cases = {
        "place": (set(), main, included, MESH),
        "comment": (set(), f"{main}<!-- as before -->", included, MESH),
        "mass": (ALL, main, heavier, MESH),
        "damping": (BOTH, main, softer, MESH),
        "solver": (BOTH, main.replace("implicitfast", "implicit"), included, MESH),
        "colour": ({"report"}, main, redder, MESH),
        "mesh": (BOTH, main, included, MESH.replace("0.1", "0.2")),
    }
    for name, (changed, *files) in cases.items():
        after = keys_of_body(config, tmp_path / name, *files)
        assert {stage for stage in STAGES if before[stage] != after[stage]} == changed, name


def test_a_model_that_changes_under_a_job_ends_it(
    compose_config: Composer, body: tuple[str, str], tmp_path: Path
) -> None:
    config, (main, included) = compose_config(), body
    keys_of_body(config, tmp_path / "model", main, included)
    path = tmp_path / "model" / "robot.xml"
    config = replace(config, humanoid=replace(config.humanoid, xml=str(path)))
    body_digests.cache_clear()
    stage_key("baseline", config, {})
    require_same_body(config)
    heavier = re.sub(r'( mass=")\d', r"\g<1>9", included, count=1)
    path.with_name("body.xml").write_text(heavier, encoding="utf-8")
    with pytest.raises(ArtifactError, match=f"{path}: the model changed while the job ran"):
        require_same_body(config)


def test_a_joined_library_counts_as_what_it_holds(compose_config: Composer, tmp_path: Path) -> None:
    """Contents and order, not the place; what changes while a job runs ends it."""
    runs, walks = synthetic_library(), synthetic_library(gaits=("walk",))
    places = [write_library(tmp_path / name, *each) for name, each in (("a", runs), ("b", runs), ("walk", walks))]

    def config_with(*others: str) -> Config:
        return compose_config(f"library.others=[{','.join(others)}]")

    alone, run, same, walk, both, turned = (
        all_keys(config)
        for config in (
            compose_config(),
            *map(config_with, places),
            config_with(*places[1:]),
            config_with(*reversed(places[1:])),
        )
    )
    assert run == same
    assert len({keys["library"] for keys in (alone, run, walk, both, turned)}) == 5
    assert {stage for stage in STAGES if alone[stage] != both[stage]} == {"library"}
    config = config_with(places[0])
    settings = stage_settings("library", config)
    (read,) = settings["library.others"]
    assert read.startswith("fedcba9876543210 sha256:")
    require_same_libraries(config, settings)
    require_same_libraries(config, stage_settings("teacher", config))
    shutil.rmtree(places[0])
    write_library(Path(places[0]), *walks)
    with pytest.raises(ArtifactError, match=r"^library\.others: a library changed while the job ran"):
        require_same_libraries(config, settings)


def test_the_last_bits_of_another_processor_do_not_count() -> None:
    values = np.array([71.8, 1.0, -0.25, 1e300, 1e-17, 0.0, np.inf])
    nearly = np.array([71.8 * (1 + 1e-15), 1.0 - 1e-16, np.nextafter(-0.25, 0), 1e300, -3e-17, -0.0, np.inf])
    assert stable(values).tobytes() == stable(nearly).tobytes()
    assert stable(values)[0] != stable(np.array([71.8 * (1 + 1e-8)]))[0]
    assert stable(np.arange(3)).dtype == np.arange(3).dtype
