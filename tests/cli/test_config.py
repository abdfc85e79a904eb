"""Every choice composes and is in range; bad input is refused in one line per key, before any work."""

from __future__ import annotations

import json
import os
import re
from contextlib import nullcontext
from pathlib import Path

import pytest
from hydra import compose, initialize_config_dir
from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra.core.global_hydra import GlobalHydra
from omegaconf import OmegaConf

from romgrl.cli import consistency, reference_page
from romgrl.cli.arguments import faults
from romgrl.cli.compose import to_config
from romgrl.cli.config_files import CONF
from romgrl.cli.consistency import validate
from romgrl.config.schema import OPTIONAL_STAGES, PRESETS, STAGES
from romgrl.config.values import keys_of, schema_groups, schema_keys
from romgrl.errors import ConfigurationError
from romgrl.humanoid.own_body import human_spec
from romgrl.sweeps.callback import note_sweep
from tests.cli.loading import composed
from tests.conftest import Composer
from tests.helpers.configurations import with_value
from tests.helpers.jobs import REAL_TORCH, ROOT, Command

FILES = sorted(path for folder in ("conf", "sweeps") for path in (ROOT / folder).rglob("*.yaml"))
STORED = sorted(path.stem for path in (ROOT / "sweeps").glob("*.yaml"))
CHOICES = [f"{path.parent.name}={path.stem}" for path in FILES if path.parent.parent == CONF]


@pytest.mark.parametrize("path", FILES, ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_files_are_short(path: Path) -> None:
    """A preset says all of a group, a line for each key below its comment, or what differs from one that does."""
    lines = path.read_text(encoding="utf-8").splitlines()
    whole = sum(key.startswith(f"{path.parent.name}.") for key in schema_keys())
    derived = any(line.startswith("defaults:") for line in lines) or whole == 0
    assert len(lines) <= (60 if path.name == "config.yaml" else 32 if derived else whole + 3)


@pytest.mark.parametrize("choice", CHOICES)
def test_every_choice_composes_and_is_valid(compose_config: Composer, choice: str, tmp_path: Path) -> None:
    extra = []
    if choice == "humanoid=humenv":
        (tmp_path / "robot.xml").write_text(human_spec(height=1.7, mass=70).to_xml(), encoding="utf-8")
        extra = [f"humanoid.xml={tmp_path}/robot.xml"]
    if choice == "teacher=jumping":
        extra = ["stage=library"]  # no student follows an apex
    if choice == "student=pretrained_conditioned":
        extra = ["stage=watch"]
    if choice == "student=conditioned":
        extra = ["stage=evaluation", "teacher=variable_running"]  # of which there is no report
    config = compose_config(choice, *extra)
    validate(config)
    group, name = choice.split("=")
    section = getattr(config, group)
    if hasattr(section, "name"):
        assert section.name == name
    if group in PRESETS:
        assert section == name


@pytest.mark.parametrize("name", STORED)
def test_stored_sweeps_compose(name: str, compose_config: Composer) -> None:
    compose_config()
    with initialize_config_dir(str(CONF), version_base="1.3"):
        sweep = compose("config", overrides=[f"hydra.searchpath=[file://{ROOT}/sweeps]"], return_hydra_config=True)
        assert sweep.hydra.output_subdir is None
    parameters = OmegaConf.load(ROOT / "sweeps" / f"{name}.yaml").hydra.sweeper.params
    assert set(parameters) <= {*schema_keys(), *schema_groups()}


@pytest.mark.parametrize("name", ["paper", "walking"])
@pytest.mark.parametrize("experiment", ["quickstart", "paper"])
def test_the_results_are_scored_thoroughly(compose_config: Composer, name: str, experiment: str) -> None:
    sweep, lines = composed("--config-dir=sweeps", f"--config-name={name}").compose([f"experiment={experiment}"])
    assert sweep is not None, lines
    scored = to_config(sweep).evaluation
    assert (scored.episodes, scored.steps) == (100, 1000)
    assert scored == compose_config("evaluation=thorough").evaluation


def test_the_variants_of_the_discriminator_are_the_default_with_one_change(compose_config: Composer) -> None:
    names = OmegaConf.load(ROOT / "sweeps" / "discriminator.yaml").hydra.sweeper.params.discriminator.split(",")
    stored = {path.stem for path in (ROOT / "sweeps" / "discriminator").glob("*.yaml")}
    assert stored == set(names) - {"tuned", "paper"}
    default = vars(compose_config().discriminator)
    search = f"hydra.searchpath=[file://{ROOT}/sweeps]"
    for name in stored:
        with initialize_config_dir(str(CONF), version_base="1.3"):
            config = to_config(compose("config", overrides=[search, f"discriminator={name}"]))
        validate(config)
        changed = {key for key, value in vars(config.discriminator).items() if value != default[key]} - {"name"}
        assert len(changed) == 1, (name, changed)


def test_the_papers_numbers(compose_config: Composer) -> None:
    config = compose_config("experiment=paper")
    sac, judge, ppo = config.student, config.discriminator, config.teacher
    assert (sac.policy_learning_rate, sac.critic_learning_rate, sac.batch_size) == (3e-4, 1e-3, 256)
    assert (sac.gamma, sac.tau, sac.policy_delay, sac.hidden_sizes) == (0.99, 0.005, 2, [256, 256])
    assert (sac.updates_per_step * sac.num_envs, sac.learning_starts, sac.buffer_size) == (1, 5000, 1_000_000)
    assert (judge.hidden_sizes, judge.dropout, judge.learning_rate, judge.gradient_penalty) == ([64, 32], 0.2, 1e-5, 10)
    assert (judge.label_smoothing, judge.update_interval, judge.held_out, judge.patience) == (0.1, 5, 0.1, 10)
    assert (judge.features, judge.window, config.noise, config.eta) == ("paper", 1, 0.05, 0.5)
    assert (ppo.hidden_sizes, ppo.activation, ppo.learning_rate, ppo.gamma) == ([512, 512], "relu", 1e-4, 0.99)
    assert (ppo.clip_ratio, ppo.num_envs, ppo.total_steps, config.reference.steps) == (0.2, 8, 1_000_000, 2000)
    assert (judge.reward, judge.early_stop, config.humanoid.actuation) == ("stored", "held_out", "torque")
    assert (config.reference.episodes, config.reference.warmup_steps, config.reference.check) == (1, 0, False)
    rom = config.rom
    assert (rom.trunk_moment_limit, rom.retraction, rom.torque_lag, rom.observation) == (None, 0, 0, "paper")


def test_where_the_paper_is_silent_its_teacher_has_the_defaults_of_sample_factory(compose_config: Composer) -> None:
    """2.1.3, sample_factory/cfg/cfg.py; its 0.5 weighs the square of a value's error, ours half of it."""
    ppo = compose_config("teacher=ppo_paper").teacher
    assert (ppo.segment_steps, ppo.minibatch_size, ppo.epochs) == (32, 1024, 1)
    assert (ppo.num_envs * ppo.rollout_steps, ppo.total_steps // ppo.minibatch_size) == (1024, 976)
    assert (ppo.entropy_coefficient, ppo.max_gradient_norm, ppo.value_coefficient / 2) == (0.003, 4.0, 0.5)
    assert (ppo.initial_log_std, ppo.hidden_gain, ppo.policy_gain, ppo.adam_epsilon) == (0.0, 1.0, 1.0, 1e-6)
    assert (ppo.normalize_observation, ppo.normalize_return, ppo.value_clip) == (True, True, 1.0)
    assert (ppo.bootstrap_truncated, ppo.gae_lambda, ppo.learning_rate_decay) == (False, 0.95, False)


def test_every_range_is_enforced(compose_config: Composer) -> None:
    """Just outside every bound that the schema has: refused, and the line names key and bound."""
    config, tried = compose_config(), 0
    for key, entry in keys_of(config).items():
        if str(entry.type).startswith("list"):
            continue
        for bound, step in (("low", -1), ("above", 0), ("high", 1)):
            limit = entry.metadata[bound]
            for value in () if limit is None else (limit + step, float("nan"), float("inf"), -float("inf")):
                with pytest.raises(ConfigurationError, match=f"^{key}: .* is not allowed; allowed: a .*number"):
                    validate(with_value(config, key, value))
                tried += 1
        if entry.metadata["choices"]:
            with pytest.raises(ConfigurationError, match=f"^{key}: other is not allowed; allowed: "):
                validate(with_value(config, key, "other"))
            tried += 1
    assert tried > 300


REFUSED = {
    "spede=4": "spede: unknown key; did you mean speed?",
    "teacher.learning_rat=1": "teacher.learning_rat: unknown key; did you mean teacher.learning_rate?",
    "total_steps=1": "total_steps: unknown key; did you mean teacher.total_steps?",
    "+quiet=1": "quiet: unknown key; --cfg job lists all keys",
    "seed=abc": "seed: abc is not allowed; allowed: a whole number >= 0",
    "seed=1.5": "seed: 1.5 is not allowed; allowed: a whole number >= 0",
    "eta=true": "eta: true is not allowed; allowed: a number >= 0 and <= 1",
    "speed=null": "speed: null is not allowed; allowed: a number >= 0 and <= 10 m/s",
    "student.hidden_sizes=3": "student.hidden_sizes: 3 is not allowed; allowed: a list of at least",
    "student.hidden_sizes=[a]": "student.hidden_sizes: [a] is not allowed; allowed: a list of at least",
    "student.mirror=maybe": "student.mirror: maybe is not allowed; allowed: true or false",
    "rom=spring_lag": "rom: spring_lag is not allowed; allowed: free_trunk, hopping, jumping, paper_spring_leg,",
    "~speed": "speed: has no value; give it as speed=...",
    "speed=1,4": "speed=1,4: is a sweep over several values; put -m before the keys",
    "speed": "speed: cannot be read; write key=value",
    "seed='x": "seed='x: cannot be read; write key=value",
    "rom.reset_speed=[2,1]": "rom.reset_speed: [2, 1] is not allowed; allowed: two numbers, the lower one first",
    "student.hidden_sizes=[0]": "student.hidden_sizes: [0] is not allowed; allowed: a list of at least",
    "student.batch_size=9999999": "student.batch_size: 9999999 is not allowed; allowed: at most student.buffer_size",
    "evaluation.window=400": "evaluation.window: 400 is not allowed; allowed: at most evaluation.steps = ",
    "teacher.minibatch_size=99999": "teacher.minibatch_size: 99999 is not allowed; allowed: at most teacher.num",
    "teacher.segment_steps=64": "teacher.segment_steps: 64 is not allowed; allowed: at most teacher.rollout_steps = 32",
    "humanoid.xml=/none.xml": "humanoid.xml: /none.xml is not allowed; allowed: a MuJoCo file that exists",
    "paths.outputs=/etc/hostname/x": "paths.outputs: /etc/hostname/x is not allowed; allowed: a directory that can be",
    "humanoid=humenv": "humanoid.xml: has no value; give it as humanoid.xml=...",
}


@pytest.mark.parametrize("override", REFUSED)
def test_refusals(override: str) -> None:
    lines = faults([override])
    assert [line[: len(REFUSED[override])] for line in lines] == [REFUSED[override]]


def test_a_humanoid_that_may_not_be_read_is_said_to_be_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "robot.xml"
    path.write_text(human_spec(height=1.7, mass=70).to_xml(), encoding="utf-8")
    monkeypatch.setattr(os, "access", lambda place, mode, access=os.access: place != str(path) and access(place, mode))
    (line,) = faults([f"humanoid.xml={path}"])
    assert line.startswith("humanoid.xml: /")
    assert line.endswith(" is not allowed; allowed: a file that can be read")


@pytest.mark.parametrize("found", [False, True])
def test_cuda_is_refused_where_there_is_none(
    compose_config: Composer, monkeypatch: pytest.MonkeyPatch, found: bool
) -> None:
    monkeypatch.setattr(consistency, "cuda_available", lambda: found)
    line = "device: cuda is not allowed; allowed: cpu (no CUDA device was found)"
    with nullcontext() if found else pytest.raises(ConfigurationError, match=f"^{re.escape(line)}$"):
        validate(compose_config("device=cuda"))


@pytest.mark.skipif(consistency.cuda_available(), reason="there is a CUDA device")
def test_the_command_line_refuses_cuda_before_any_work(command: Command, tmp_path: Path) -> None:
    result = command("device=cuda", **REAL_TORCH)
    assert (result.returncode, result.stdout) == (2, "")
    assert result.stderr == "device: cuda is not allowed; allowed: cpu (no CUDA device was found)\n"
    assert not (tmp_path / "outputs").exists()


@pytest.mark.parametrize(
    ("arguments", "count"),
    [
        (["spede=4"], 1),
        (["eta=7", "seed=x", "teacher.lr=1"], 3),
        (["eta=7", "noise=-1"], 2),
        (["student=sax"], 1),
        (["-m", "speed=1,99", "seed=0"], 1),
        (["-m", "eta=a,0.5"], 1),
        (["seed=0", "-m", "eta=a,0.5"], 1),
        (["--config-name", "nothing"], 1),
    ],
)
def test_command_line_refuses_before_any_work(
    command: Command, tmp_path: Path, arguments: list[str], count: int
) -> None:
    result = command(*arguments)
    assert (result.returncode, result.stdout) == (2, "")
    assert len(result.stderr.splitlines()) == count, result.stderr
    assert "Traceback" not in result.stderr
    assert not (tmp_path / "outputs").exists()


def test_reference_page_is_up_to_date() -> None:
    """`make docs` writes it."""
    assert reference_page.REFERENCE_PAGE.read_text(encoding="utf-8") == reference_page.render()


def test_reference_page_takes_no_arguments_and_needs_docs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "docs" / "configuration.md"
    monkeypatch.setattr(reference_page, "REFERENCE_PAGE", page)
    assert reference_page.main([]) == 5
    assert capsys.readouterr().err == f"{page}: No such file or directory\n"
    page.parent.mkdir()
    for argument, code in (("--help", 0), ("bogus", 2)):
        with pytest.raises(SystemExit) as ended:
            reference_page.main([argument])
        assert ended.value.code == code
    assert not page.exists()
    assert reference_page.main([]) == 0
    assert page.read_text(encoding="utf-8") == reference_page.render()


def test_stages_of_the_schema_are_those_of_the_graph() -> None:
    from romgrl.provenance import stage_graph

    assert tuple(stage_graph.STAGES) == STAGES + OPTIONAL_STAGES
    assert {name for name, stage in stage_graph.STAGES.items() if stage.optional} == set(OPTIONAL_STAGES)
    assert schema_keys()["stage"].metadata["choices"] == ("all", *stage_graph.STAGES, *stage_graph.ACTIONS)
    assert not any(set(stage_graph.STAGES[stage].upstream) & set(OPTIONAL_STAGES) for stage in stage_graph.STAGES)


def test_skeletons_of_the_schema_are_those_of_the_humanoid() -> None:
    from romgrl.humanoid.skeleton import SKELETONS

    assert schema_keys()["humanoid.skeleton"].metadata["choices"] == tuple(SKELETONS)
    assert all(skeleton.name == name for name, skeleton in SKELETONS.items())


@pytest.mark.parametrize("name", STORED)
def test_usual_budgets_are_those_of_the_groups_that_a_sweep_names(name: str, tmp_path: Path) -> None:
    teacher = {"walking": "walking", "variable_running": "variable_running", "experiment_paper": "ppo_paper"}.get(name)
    searched = {"hopping": "hopping", "variable_walking": "variable_walking"}.get(name)
    with initialize_config_dir(str(CONF), version_base="1.3"):
        paths = GlobalHydra.instance().config_loader().get_search_path()
        paths.prepend("stored", f"file://{ROOT}/sweeps")
        note_sweep(tmp_path, name, [], ConfigLoaderImpl(paths))
        student = "sac" if name == "experiment_paper" else "fast_sac"
        chosen = compose("config", [f"teacher={searched or teacher or 'running'}", f"student={student}"])
    usual = json.loads((tmp_path / "sweep.json").read_text(encoding="utf-8"))["usual"]
    budget = "generations" if searched else "total_steps"
    assert usual == {f"teacher.{budget}": chosen.teacher[budget], "student.total_steps": chosen.student.total_steps}
