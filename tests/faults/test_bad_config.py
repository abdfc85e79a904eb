"""A bad configuration is told in one line per fault, with exit code 2, before anything is made; a good one is taken."""

from __future__ import annotations

import itertools
import os
import random
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest

from romgrl import __main__ as program
from romgrl.cli.arguments import faults, read_options
from romgrl.cli.compose import register_schema, to_config
from romgrl.cli.consistency import CHECKS, validate
from romgrl.cli.hydra_loader import Loader
from romgrl.cli.teacher_ranges import OF_MOTORS
from romgrl.config.schema import Config
from romgrl.config.values import keys_of, kind_key, kind_of, schema_keys, value_of
from romgrl.humanoid.own_body import human_spec
from romgrl.rom import _core
from romgrl.rom.parameters import VariableLegParameters, core_parameters
from tests.conftest import Composer
from tests.faults.bad_configs import (
    ALLOWED,
    FILES,
    HEAD,
    MISFITS,
    OF_HYDRA,
    SPECIAL,
    TAUGHT,
    Case,
    case,
    from_schema,
    typos,
)
from tests.helpers.jobs import ROOT
from tests.helpers.limits import PATIENCE

SEED, TYPOS, PROCESSES, GOOD = 4, 30, 14, 50
LONGEST_LINE = 400  # characters, whatever the value was
Outcome = tuple[int, str, str]
Program = Callable[[list[str]], Outcome]


def bad_cases() -> list[Case]:
    """Every key of the schema, misspelt keys, special forms, files, and what does not fit together."""
    misfits = [case(*text.split(), says=(f"{key}: ", ALLOWED)) for key, text in MISFITS]
    return [*from_schema(SEED), *typos(SEED, TYPOS), *SPECIAL, *OF_HYDRA, *FILES, *misfits]


def arguments_of(one: Case, number: int, files: Path) -> list[str]:
    """The command line of a case, once its files are written to a directory of their own."""
    if not one.files:
        return list(one.arguments)
    directory = files / str(number)
    for name, content in one.files.items():
        path = directory / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return [f"--config-dir={directory}", *one.arguments]


def shortcoming(one: Case, outcome: Outcome) -> str | None:
    """What a refusal lacks; None where it has all."""
    code, out, err = outcome
    lines = err.splitlines()
    if code != 2 or out or "Traceback" in err or len(lines) != len(one.says):
        return f"{one.arguments}: exit code {code}, {len(lines)} lines for {len(one.says)} faults: {out}{err}"
    missing = [word for line, words in zip(lines, one.says, strict=True) for word in words if word not in line]
    missing += [line for line in lines if len(line) > LONGEST_LINE]
    return f"{one.arguments}: {missing} not in {err}" if missing else None


@pytest.fixture
def in_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Program:
    """Run the command line in this process, in an empty directory that has to stay so."""
    here = tmp_path / "here"
    here.mkdir()
    monkeypatch.chdir(here)
    monkeypatch.setenv("HYDRA_FULL_ERROR", "1")

    def run(arguments: list[str]) -> Outcome:
        monkeypatch.setattr(sys, "argv", ["romgrl", *arguments])
        with pytest.raises(SystemExit) as end:
            program.main()
        assert not list(here.iterdir()), f"{arguments} made {list(here.iterdir())}"
        return (int(end.value.code or 0), *capsys.readouterr())

    return run


def test_settings_of_hydra_are_told(in_process: Program, tmp_path: Path) -> None:
    cases = [*OF_HYDRA, *FILES[-2:]]
    outcomes = [in_process(arguments_of(one, number, tmp_path)) for number, one in enumerate(cases)]
    short = map(shortcoming, cases, outcomes)
    assert not [text for text in short if text]


@pytest.mark.slow
def test_bad_configurations_are_told(in_process: Program, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cases = bad_cases()
    named = {words[0].partition(":")[0] for one in cases for words in one.says}
    assert set(schema_keys()) <= named
    found = [shortcoming(one, in_process(arguments_of(one, number, tmp_path))) for number, one in enumerate(cases)]
    wrong = [text for text in found if text]
    with capsys.disabled():
        print(f"\n{len(cases) - len(wrong)} of {len(cases)} bad configurations told in one line per fault")
    assert not wrong, "\n".join(wrong)
    assert len(cases) >= 200


def test_a_process_says_the_same_and_makes_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    draw = random.Random(SEED)
    cases = [*draw.sample(bad_cases(), PROCESSES - 4), *draw.sample(SPECIAL, 2), *draw.sample(FILES, 2)]
    here = tmp_path / "here"
    here.mkdir()

    def run(number: int) -> str | None:
        command = [sys.executable, "-m", "romgrl", *arguments_of(cases[number], number, tmp_path)]
        environment = os.environ | {"PYTHONPATH": str(ROOT)}
        ended = subprocess.run(
            command, cwd=here, env=environment, capture_output=True, text=True, encoding="utf-8", timeout=PATIENCE
        )
        return shortcoming(cases[number], (ended.returncode, ended.stdout, ended.stderr))

    with ThreadPoolExecutor(2) as pool:
        wrong = [text for text in pool.map(run, range(PROCESSES)) if text]
    with capsys.disabled():
        print(f"\n{PROCESSES - len(wrong)} of {PROCESSES} processes refused a bad configuration")
    assert not wrong, "\n".join(wrong)
    assert not list(here.iterdir())


GOOD_FORMS = (
    ["seed=1_000"], ["seed=4294967295"], ["speed=-0.0"], ["speed=4"], ["++speed=2"], ["speed=.5", "teacher.speed=0.5"],
    ["teacher.speed=${speed}"], ["rom.mass=null"], ["rom.mass=80"], ["student.hidden_sizes=[64,64,64]"],
    ["tracking.experiment='d\u00e9j\u00e0 vu'"], ["tracking.experiment=2026"], ["tracking=none", "tracking.uri=x"],
    ["tracking.uri=http://127.0.0.1:5000"], ["tracking.uri=postgresql+psycopg2://me@host/runs"],
    ["tracking.uri=sqlite:///runs.db"], ["experiment=paper"], ["experiment=smoke"],
    ["rom=free_trunk", "teacher=ppo_paper"], ["discriminator=none", "discriminator.window=32"], ["hydra.run.dir=."],
    ["threads=4", "stage=teacher"], ["-m", "speed=1,4", "eta=0.3,0.5"], ["-m", "rom=glob(*)"],
    ["speed=range(1,4)", "-m"], [f"--config-dir={ROOT}/sweeps", "--config-name=paper"],
    [f"--config-dir={ROOT}/sweeps", "--config-name=eta"],
)  # fmt: skip


def good_values(config: Config, seed: int) -> Iterator[list[str]]:
    """Keys turned round, at another choice, or a little smaller, one at a time."""
    draw = random.Random(seed)
    keys = keys_of(config)
    for key in draw.sample(list(keys), len(keys)):
        entry = keys[key]
        kind, value = kind_of(entry), value_of(config, key)
        if key.endswith(".pretrained"):
            yield [key.replace(".", "=")]  # the preset: it needs more than this key
        elif key == "student.kind":
            yield ["student=conditioned", *TAUGHT]  # of which there is no report
        elif any(key == kind_key(group) for group in fields(Config)):
            yield [f"{key.partition('.')[0]}={draw.choice(list(entry.metadata['choices']))}"]  # likewise
        elif kind.item == "bool":
            yield [f"{key}={str(not value).lower()}"]
        elif entry.metadata["choices"] and key != "device":
            alone = [choice for choice in entry.metadata["choices"] if choice != "jump"]  # a jump needs more
            yield [f"{key}={draw.choice(alone)}"]
        elif kind.item == "float" and isinstance(value, float) and value > 0:
            yield [*(["rom=variable_leg"] if key in OF_MOTORS else []), f"{key}={0.995 * value:.6g}"]


def test_good_configurations_are_taken(
    in_process: Program, compose_config: Composer, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "robot.xml").write_text(human_spec(height=1.7, mass=70).to_xml(), encoding="utf-8")
    (tmp_path / "mine.yaml").write_text(HEAD + "speed: 3\nteacher: {speed: '${speed}'}\n", encoding="utf-8")
    forms = [*GOOD_FORMS, ["humanoid=humenv", f"humanoid.xml={tmp_path}/robot.xml"]]
    forms += [[f"--config-dir={tmp_path}", "--config-name=mine", "eta=1"]]
    forms += itertools.islice(good_values(compose_config(), SEED), GOOD - len(forms))
    told = [f"{form}: {lines}" for form in forms if (lines := faults(form))]
    with capsys.disabled():
        print(f"\n{len(forms) - len(told)} of {len(forms)} good configurations taken")
    assert not told
    assert len(forms) == GOOD


@pytest.mark.parametrize("form", GOOD_FORMS[:20:4])
def test_a_good_configuration_is_shown(in_process: Program, form: list[str]) -> None:
    code, out, err = in_process([*form, "--cfg=job"])
    assert (code, err) == (0, "")
    assert out.startswith("stage: all\nspeed: ")


def test_every_check_has_a_configuration_that_it_refuses() -> None:
    """Without any one of the checks, one of MISFITS would go through; two need a machine without CUDA or onnx."""
    configs = [configuration(*text.split()) for _, text in MISFITS]
    silent = [keys for keys, check in CHECKS if not any([*check(config)] for config in configs)]
    assert silent == [("device",), ("stage",)]


def configuration(*overrides: str) -> Config:
    """What a command line gives, misfits and all."""
    register_schema()
    options, _ = read_options(overrides)
    assert options is not None
    composed, lines = Loader(options).compose(overrides)
    assert composed is not None, lines
    return to_config(composed)


@pytest.mark.parametrize(("bound", "fewest"), [("low", 15), ("high", 18)])
def test_the_core_takes_what_the_schema_allows(bound: str, fewest: int) -> None:
    """At its bounds, no parameter of the reduced-order model is out of the range of the core."""
    tried = 0
    for key, entry in schema_keys().items():
        group, _, name = key.partition(".")
        limit = entry.metadata[bound]
        if group == "rom" and name in _core.PARAMETERS and limit is not None:
            value = int(limit) if kind_of(entry).item == "int" else float(limit)
            around = {"leg_length": 2.0, "foot_radius": 1.0} if name == "roll_over_radius" else {}  # bounds, too
            assert "is not between" not in complaint(**{name: value} | around), key
            tried += 1
    assert tried >= fewest


def complaint(**values: Any) -> str:
    """What the core says to these parameters of the reduced-order model."""
    parameters = VariableLegParameters(reset_hip_angle=(0.0, 0.0), **values)
    task: dict[str, Any] = {"speed": 1.0, "control_frequency": 30.0, "episode_steps": 1, "alpha": 1.0}
    try:
        _core.Batch(core_parameters(parameters, reward="exponential", **task), 1, 1)
    except ValueError as error:
        return str(error)
    return ""


def test_seeds_fit_the_generators_of_a_stage(compose_config: Composer) -> None:
    import numpy as np
    import torch

    largest = int(schema_keys()["seed"].metadata["high"])
    validate(compose_config(f"seed={largest}"))
    np.random.seed(largest)  # noqa: NPY002 - the generator that a stage seeds
    torch.manual_seed(largest)
    with pytest.raises(ValueError, match="between 0 and"):
        np.random.seed(largest + 1)  # noqa: NPY002 - the same
