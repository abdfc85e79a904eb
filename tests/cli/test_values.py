"""Values come out as they went in: text as it was typed, whole numbers, paths and addresses with any sign in them."""

from __future__ import annotations

import os
import shlex
from collections.abc import Sequence
from pathlib import Path

import pytest
from omegaconf import OmegaConf
from sqlalchemy.engine import make_url

from romgrl.cli.arguments import faults, flags_first
from romgrl.cli.compose import compose_config
from romgrl.cli.hydra_loader import stored_sweep
from romgrl.cli.typed_text import is_text, quoted
from romgrl.config.addresses import (
    absolute_address,
    as_typed,
    in_quotes,
    sqlite_address,
    sqlite_path,
    without_quotes,
)
from romgrl.config.values import RENAMED, kind_of, schema_keys, value_of
from romgrl.pipeline.run_names import job_title
from romgrl.results.sweep_record import settings
from romgrl.tracking.recorder import default_uri, ui_command
from tests.cli.loading import HEAD, composed
from tests.conftest import Composer

WORDS = (
    "2026_10_05", "1.10", "1e3", "0x10", "012", "1_000", "+5", "-0", ".5", "5.", "inf", "NaN", "2026-10-05", "1:30",
    "yes", "on", "n", "true", "False", "None", "1.10.2", "7e", "a1",
)  # fmt: skip

NAMES = (
    "lr=0.1", "größe", "李明", "a,b", "run (1)", "#3", "R&D", "o'brien", "a b", "[x]", "{x}", "a:b", "50%", "@home",
    "!x", "run%41", "a?b", "~/out", "x\\", "a\\'b", "both'\"$", "`x`", ";", "*",
)  # fmt: skip

FREE = ("paths.outputs", "tracking.experiment", "rom.name", "teacher.name", "student.name", "humanoid.name")


def words_for_keys() -> list[dict[str, str]]:
    """Every word for some key that takes any text."""
    return [dict(zip(FREE, words, strict=False)) for words in batched((*WORDS, "Null", "NULL"), len(FREE))]


def batched(words: Sequence[str], size: int) -> list[Sequence[str]]:
    """A sequence in pieces."""
    return [words[start : start + size] for start in range(0, len(words), size)]


def test_text_is_what_was_typed(compose_config: Composer) -> None:
    for words in words_for_keys():
        config = compose_config(*(f"++{key}={word}" for key, word in words.items()))
        words["paths.outputs"] = f"{os.getcwd()}/{words['paths.outputs']}"
        assert {key: value_of(config, key) for key in words} == words
    assert faults([f"{key}={word}" for key, word in words_for_keys()[0].items()]) == []
    assert [settings([quoted(f"rom.name={word}")]) for word in WORDS] == [{"rom.name": word} for word in WORDS]


def test_all_keys_of_text_have_it() -> None:
    text = [key for key, entry in schema_keys().items() if kind_of(entry).item == "str" and not kind_of(entry).many]
    assert {key: quoted(f"{key}=1.10") for key in text} == {key: f"{key}='1.10'" for key in text}
    for key in ("experiment", "rom", "hydra/launcher", "hydra.sweep.dir", "hydra.run.dir", "hydra.launcher.partition"):
        assert is_text(key)
    for override in ("seed=1_000", "student.hidden_sizes=[1_0]", "student.mirror=true", "hydra.launcher.n_jobs=1_0"):
        assert quoted(override) == override


def test_null_is_a_value_of_its_own(compose_config: Composer) -> None:
    assert compose_config("tracking.uri=null").tracking.uri is None
    assert compose_config("tracking.uri='null'").tracking.uri == "null"
    assert faults(["paths.outputs=null"]) == ["paths.outputs: null is not allowed; allowed: printable text"]


@pytest.mark.parametrize(
    ("written", "values"),
    [
        ("1.10,2.20", ["1.10", "2.20"]),
        ("a, 1_000 ,'b,c'", ["a", "1_000", "b,c"]),
        ("choice(1.10,yes)", ["1.10", "yes"]),
        ("range(1,3)", ["1", "2"]),
    ],
)
@pytest.mark.parametrize("stored", [False, True])
def test_a_sweep_has_the_text_of_each_value(tmp_path: Path, written: str, values: list[str], stored: bool) -> None:
    key = "tracking.experiment"
    arguments = ["-m", f"{key}={written}"]
    if stored:
        parameters = f'hydra: {{mode: MULTIRUN, sweeper: {{params: {{{key}: "{written}"}}}}}}\n'
        (tmp_path / "mine.yaml").write_text(HEAD + parameters, encoding="utf-8")
        arguments = [f"--config-dir={tmp_path}", "--config-name=mine"]
    assert faults(arguments) == []
    loader = composed(*arguments)
    whole, lines = loader.compose([])
    assert whole is not None, lines
    found = []
    for job in loader.jobs(stored_sweep(whole) if stored else [quoted(arguments[-1])]):
        config, lines = loader.compose(job)
        assert config is not None, lines
        found.append(config.tracking.experiment)
    assert found == values


def test_files_keep_their_text(tmp_path: Path) -> None:
    for number, words in enumerate(batched(WORDS, len(FREE))):
        text = "".join(f"{key.replace('.', ': {')}: {word}}}\n" for key, word in zip(FREE, words, strict=False))
        (tmp_path / f"mine_{number}.yaml").write_text(HEAD + text, encoding="utf-8")
        config, lines = composed(f"--config-dir={tmp_path}", f"--config-name=mine_{number}").compose([])
        assert config is not None, lines
        found = [OmegaConf.select(config, key).removeprefix(f"{os.getcwd()}/") for key in FREE[: len(words)]]
        assert found == list(words)


def test_merged_mappings_keep_their_text(tmp_path: Path) -> None:
    """With `<<`, what a mapping says itself goes before what it takes from another."""
    text = "common: &common {experiment: 1.10, uri: 1_0}\nmore: &more {enabled: false, experiment: 2.20}\n"
    text += "tracking:\n  <<: [*common, *more]\n  uri: 'sqlite:///x.db'\n"
    (tmp_path / "mine.yaml").write_text(HEAD + text, encoding="utf-8")
    config, lines = composed(f"--config-dir={tmp_path}", "--config-name=mine").compose([])
    assert config is not None, lines
    assert (config.tracking.experiment, config.tracking.enabled) == ("1.10", False)
    assert config.tracking.uri == f"sqlite:///{os.getcwd()}/x.db"


@pytest.mark.parametrize("word", ["2026_10_05", "yes"])
def test_all_kinds_of_files_keep_their_text(tmp_path: Path, word: str) -> None:
    """A configuration, a preset of all groups, a choice of one group, and a sweep of one value."""
    (tmp_path / "experiment").mkdir()
    (tmp_path / "tracking").mkdir()
    parameters = f"hydra: {{sweeper: {{params: {{humanoid.name: {word}}}}}}}\n"
    (tmp_path / "mine.yaml").write_text(HEAD + f"paths: {{outputs: {word}}}\nseed: 1_0\n{parameters}", encoding="utf-8")
    preset = f"# @package _global_\nexperiment: mine\nrom:\n  name: {word}\n"
    (tmp_path / "experiment" / "mine.yaml").write_text(preset, encoding="utf-8")
    (tmp_path / "tracking" / "mine.yaml").write_text(
        f"defaults: [sqlite, _self_]\nexperiment: {word} # a remark\n", encoding="utf-8"
    )
    arguments = [f"--config-dir={tmp_path}", "--config-name=mine", "experiment=mine", "tracking=mine"]
    assert faults(arguments) == []
    config, lines = composed(*arguments).compose(arguments[2:])
    assert config is not None, lines
    assert (config.paths.outputs, config.rom.name) == (f"{os.getcwd()}/{word}", word)
    assert (config.tracking.experiment, config.seed) == (word, 10)
    assert settings(stored_sweep(config)) == {"humanoid.name": word}


def test_whole_floats_are_whole_numbers(compose_config: Composer, tmp_path: Path) -> None:
    config = compose_config("student.total_steps=1e6", "seed=4.0", "student.hidden_sizes=[64.0,32]")
    assert (config.student.total_steps, config.seed, config.student.hidden_sizes) == (1_000_000, 4, [64, 32])
    assert {type(value) for value in (config.student.total_steps, config.seed, *config.student.hidden_sizes)} == {int}
    (tmp_path / "mine.yaml").write_text(HEAD + "teacher: {total_steps: 1e5}\n", encoding="utf-8")
    assert faults([f"--config-dir={tmp_path}", "--config-name=mine"]) == []
    for value in ("1.5", "1e-3", "1e400", "nan"):
        assert faults([f"student.total_steps={value}"])[0].startswith("student.total_steps: ")


def test_any_name_can_be_pasted_as_it_is_told(compose_config: Composer) -> None:
    """What Hydra cannot read as it is, it can as the line says; so it can what a name is written as for a command."""
    told = 0
    for names in batched(NAMES, len(FREE)):
        wanted = {key: name if name.startswith("~") else f"/tmp/{name}" for key, name in zip(FREE, names, strict=False)}
        for line in faults([f"{key}={name}" for key, name in wanted.items()]):
            key = line.partition("=")[0]
            assert line.endswith(f"put it in quotes, for the shell too: {as_typed(key, wanted[key])}")
            told += 1
        overrides = [shlex.split(as_typed(key, name))[0] for key, name in wanted.items()]
        config = compose_config(*overrides)
        wanted["paths.outputs"] = os.path.expanduser(wanted["paths.outputs"])
        assert {key: value_of(config, key) for key in wanted} == wanted
        assert [without_quotes(in_quotes(name)) for name in names] == list(names)
    assert told == 16
    assert faults(["paths.outputs=[x]"])[0].endswith("\"paths.outputs='[x]'\"")


def test_names_in_quotes_have_no_faults() -> None:
    for names in batched(NAMES, len(FREE)):
        keys = [key for key in FREE if key != "paths.outputs"]
        pairs = zip(keys, names, strict=False)
        assert faults([shlex.split(as_typed(key, name))[0] for key, name in pairs]) == []


def test_a_comma_is_told_both_ways() -> None:
    assert faults(["paths.outputs=/a,b"]) == [
        "paths.outputs=/a,b: is a sweep over several values; put -m before the keys, or where it is one value, "
        "put it in quotes, for the shell too: \"paths.outputs='/a,b'\""
    ]
    assert faults(["rom.engine=box2d,native"]) == [
        "rom.engine=box2d,native: is a sweep over several values; put -m before the keys"
    ]


@pytest.mark.parametrize("name", NAMES)
def test_addresses_lead_to_the_file(name: str) -> None:
    path = Path("/somewhere") / name / "mlflow.db"
    address = default_uri(path.parent)
    assert make_url(address).database == str(path)
    assert sqlite_path(address) == path
    assert absolute_address(address) == address
    words = shlex.split(ui_command(address))
    assert make_url(words[words.index("--backend-store-uri") + 1]).database == str(path)


def test_addresses_of_files_are_whole(
    compose_config: Composer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", "/home/some body")
    assert compose_config("tracking.uri=sqlite:///x.db").tracking.uri == sqlite_address(tmp_path / "x.db")
    home = compose_config("tracking.uri='sqlite:///~/x.db?timeout=9'").tracking.uri
    assert home == "sqlite:////home/some body/x.db?timeout=9"
    for address in ("http://host:5000", "postgresql://me@host/runs"):
        assert compose_config(f"tracking.uri={address}").tracking.uri == address
        assert sqlite_path(address) is None


def test_titles_keep_blanks_together(compose_config: Composer) -> None:
    overrides = ["rom.name='my model, the 2nd'", "seed=3"]
    config = compose_config(*overrides)
    assert job_title("job", config, overrides) == "job v=4 eta=0.3 noise=0.05 s=3 rom.name=my model, the 2nd"


def test_options_keep_what_they_name(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    directory = tmp_path / "lr=0.1"
    directory.mkdir()
    (directory / "mine.yaml").write_text(HEAD + "speed: 3\n", encoding="utf-8")
    monkeypatch.setenv("HOME", str(tmp_path))
    for arguments in (["--config-dir", str(directory)], ["-cd", "~/lr=0.1"], ["--config-dir=~/lr=0.1"]):
        assert flags_first(["speed=2", *arguments])[0] == f"--config-dir={directory}"
        assert faults(["eta=1", *arguments, "--config-name", "mine"]) == []
    assert faults(["--config-name"]) != []


def test_an_old_name_of_a_key_goes_on_working() -> None:
    assert RENAMED.keys().isdisjoint(schema_keys())
    for old, new in RENAMED.items():
        assert faults([f"{old}=3"]) == []
        assert value_of(compose_config(f"{old}=3"), new) == 3
