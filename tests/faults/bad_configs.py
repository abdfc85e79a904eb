"""Bad and good command lines: from the schema, every key at least once, and the special forms."""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from typing import Any

from romgrl.config.schema import Config
from romgrl.config.values import first_kind, foreign_keys, kind_key, kind_of, schema_keys

HEAD = "defaults:\n  - config\n  - _self_\n"
EVERY_SPEED = "experiment=every_speed stage=evaluation"
TAUGHT = ("stage=student", "teacher=variable_running")  # what a conditioned student needs


@dataclass(frozen=True)
class Case:
    """A command line, the files of its --config-dir, and what each line of its refusal has to say."""

    arguments: tuple[str, ...]
    says: tuple[tuple[str, ...], ...]
    files: dict[str, str | bytes] = field(default_factory=dict)


def case(*arguments: str, says: str | tuple[str, ...], more: tuple[tuple[str, ...], ...] = ()) -> Case:
    """A command line and the words of its one line, or of several."""
    return Case(arguments, ((says,) if isinstance(says, str) else says, *more))


def file(text: str | bytes, *arguments: str, says: tuple[tuple[str, ...], ...]) -> Case:
    """The configuration mine.yaml of a user."""
    return Case(("--config-name=mine", *arguments), says, {"mine.yaml": text})


def from_schema(seed: int) -> Iterator[Case]:
    """A bad value for every key, its form drawn from those that the key cannot take."""
    draw = random.Random(seed)
    for key, entry in schema_keys().items():
        if key == "experiment":
            continue  # a group: see SPECIAL
        yield case(*preset_of(key), f"{key}={draw.choice(bad_forms(entry))}", says=(f"{key}: ", ALLOWED))


def preset_of(key: str) -> list[str]:
    """What chooses a preset that has the key, where the default configuration lacks it."""
    if key not in foreign_keys(first_kind):
        return []
    group = next(entry for entry in fields(Config) if key.startswith(f"{entry.name}."))
    kinds = (kind for kind in group.metadata["kinds"] if key not in foreign_keys({kind_key(group): kind}.get))
    return [f"{group.name}={next(kinds)}", *(TAUGHT if group.name == "student" else [])]


def bad_forms(entry: Any) -> list[str]:
    """The forms of a value that a key cannot take."""
    kind = kind_of(entry)
    forms = ["{a: 1}", "''", *([] if kind.optional else ["null"])]
    if kind.many and kind.item == "str":
        return [*forms, "4", "/place", "[]", "[true]", "[' ']", "[null]", "[[1]]"]
    if kind.many:
        return [*forms, "4", "[]", "[a]", "[true]", "[nan]", "[1e400]", "[-999]", "[[1]]"]
    forms += ["[1, 2]"]
    if entry.metadata["choices"]:
        return [*forms, "nothing", "4", "true"]
    numbers = ["nan", "inf", "-inf", "1e400", "-1e400", "true", "false", "abc", "'4'", '"1.5"', "-1e30"]
    numbers += ["1e30"] if entry.metadata["high"] is not None else []
    numbers += ["1.5", str(2**70)] if kind.item == "int" else []
    numbers += ["-1"] if entry.metadata["low"] == 0 or entry.metadata["above"] == 0 else []
    return forms + {"bool": ["1", "0", "yes", "4.0", "'true'"], "str": ["[true]", '"\t"', "' '"]}.get(
        kind.item, numbers
    )


def typos(seed: int, count: int) -> Iterator[Case]:
    """Keys with a letter lost, doubled or exchanged for the next one."""
    draw = random.Random(seed)
    long = [key for key in schema_keys() if len(key.rpartition(".")[2]) >= 5]
    for key in draw.sample(long, count):
        group, dot, leaf = key.rpartition(".")
        place = draw.randrange(1, len(leaf) - 2)
        ends = (leaf[:place] + leaf[place + 1 :], leaf[:place] + leaf[place - 1 :], swapped(leaf, place))
        wrong = draw.choice([end for end in ends if end != leaf])
        prefix = draw.choice(["", "+", "++"])
        says = (f"{group}{dot}{wrong}: unknown key", f"mean {key}?")
        yield case(*preset_of(key), f"{prefix}{group}{dot}{wrong}=1", says=says)


def swapped(text: str, place: int) -> str:
    """Text with two neighbours exchanged."""
    return text[:place] + text[place + 1] + text[place] + text[place + 2 :]


ALLOWED = "is not allowed; allowed: "
SPEED = ("speed: ", ALLOWED, ">= 0 and <= 10 m/s")
SPECIAL = (
    case("spede=4", "eta=7", "seed=x", "teacher.learning_rat=1", "student.buffer_size=100",
         says=("spede: unknown key; did you mean speed?",),
         more=(("teacher.learning_rat: unknown key; did you mean teacher.learning_rate?",),
               ("eta: 7",), ("seed: x",), ("student.batch_size: 256", "student.buffer_size = 100"),
               ("student.buffer_size: 100", "4 x student.num_envs"))),
    case("tracking.uri=oracle://me:secret@host/runs", says=("tracking.uri: oracle://me:***@host", ALLOWED)),
    case("tracking.uri=postgresql://me:se@cret@host/runs", says=("tracking.uri: postgresql://me:***@host", "%40")),
    case("speed=", says=SPEED), case("speed=nan", says=SPEED), case("speed={a:", says=("speed={a:", "cannot be read")),
    case("seed=4294967296", says=("seed: 4294967296", ALLOWED, "<= 4294967295")),
    case("rom.trunk_moment_limit=inf", says=("rom.trunk_moment_limit: inf", ALLOWED)),
    case("student.hidden_sizes=[]", says=("student.hidden_sizes: []", ALLOWED, "at least one")),
    case("rom.reset_speed=[2,1]", says=("rom.reset_speed: [2, 1]", ALLOWED, "two numbers, the lower one first")),
    case("humanoid.reset_speed=[0,1,2]", says=("humanoid.reset_speed: [0, 1, 2]", ALLOWED, "two numbers")),
    case("student=sac", "student.simultaneous=true", says=("student.policy_updates: 2", "student.simultaneous=true")),
    case("student.mirror=1", says=("student.mirror: 1", ALLOWED, "true or false")),
    case("speed='x", says=("speed=", "cannot be read", "<= 10 m/s")),
    case("speed=[1", says=("speed=[1", "cannot be read", "<= 10 m/s")),
    case("speed=" + "9" * 5000, says=("speed=999", "...", "cannot be read", "<= 10 m/s")),
    case("speed=" + "a" * 5000, says=("speed: aaa", "...", "<= 10 m/s")),
    case("spéed=1", says=("spéed", "did you mean speed?")), case("Speed=1", says="did you mean speed?"),
    case("speed", says="write key=value"), case("=4", says="write key=value"),
    case("speed=1", "speed=2", says=("speed: ", "has 2 values, 1 and 2")),
    case("rom=spring_leg", "rom=free_trunk", says=("rom: ", "has 2 values")),
    case("speed=1,2", says=("speed=1,2: ", "put -m before the keys")),
    case("speed=???", says=("speed: has no value", "<= 10 m/s")),
    case("speed=${nothing}", says=("speed: ${nothing} cannot be resolved", "<= 10 m/s")),
    case("teacher.speed=${sped}", says=("teacher.speed: ${sped} cannot be resolved", "did you mean speed?")),
    case("speed=${teacher.speed}", "teacher.speed=${speed}", says=("speed: ", "Recursive"),
         more=(("teacher.speed: ", "Recursive"),)),
    case("speed=${oc.env:ROMGRL_NO_SUCH_NAME}", says=("speed: ", "ROMGRL_NO_SUCH_NAME")),
    case("~speed", says="speed: has no value"),
    case("~teacher.speed", says="teacher.speed: has no value"),
    case("~rom", says=("rom: has no value", "spring_leg")),
    case("~nothing", says="nothing: unknown key"),
    case("+newkey=1", says="newkey: unknown key"),
    case("+speed=1", says=("+speed=1: ", "write speed=1")),
    case("++speed=abc", says=SPEED),
    case("++teacher.new.key=1", says="teacher.new.key: unknown key"),
    case("student.hidden_sizes.0=5", says=("student.hidden_sizes.0: unknown key", "student.hidden_sizes?")),
    case("rom=ppo", says=("rom: ppo", ALLOWED, "spring_leg")),
    case("teacher=spring_leg", says=("teacher: spring_leg", ALLOWED, "ppo")),
    case("rom=null", says=("rom: null", ALLOWED)),
    case("rom=[free_trunk]", says=("rom: [free_trunk]", ALLOWED)),
    case("rom@student=spring_leg", says=("rom@student", "write rom=")),
    case("rom=sprung_leg", says=("rom: sprung_leg", "did you mean spring_leg?")),
    case("experiment=smok", says=("experiment: smok", "did you mean smoke?")),
    case("experiment=null", says=("experiment: null", ALLOWED)),
    case("hydra/launcher=basik", says=("hydra/launcher: basik", "did you mean basic?")),
    case("hydra.mode=FAST", says=("hydra.mode: ", "FAST", "RUN, MULTIRUN")),
    case("hydra.nothing=1", says="hydra.nothing"),
    case("--foo", says="--foo: unknown option"),
    case("--multirum", says=("--multirum: unknown option", "--multirun?")),
    case("--config-name=nothing", says=("--config-name: nothing", ALLOWED)),
    case("--config-name", says="--config-name"),
    case("--config-dir=/no/such/place", says=("--config-dir: /no/such/place", ALLOWED)),
    case("--config-path=conf", says=("--config-path: conf", ALLOWED)),
    case("--cfg=all", "-m", says=("--cfg --multirun: only one",)),
    case("--resolve", says="--resolve: goes with --cfg"),
    case("--package=rom", says="--package: goes with --cfg"),
    case("--cfg=job", "--package=studnt", says=("--package: studnt", ALLOWED, "rom, teacher", "did you mean student?")),
    case("--cfg=job", "--package=hydra.job", says=("--package: hydra.job", ALLOWED)),
    case("--cfg=hydra", "--package=student", says=("--package: student", ALLOWED, "_global_, hydra, or a key")),
    case("--cfg=all", "--package=humanoid.xml", says=("--package: humanoid.xml", ALLOWED, "that has a value")),
    case("--experimental-rerun=job.pickle", says="--experimental-rerun: is not available"),
    case("-m", "speed=1,99", says=("speed: 99", ALLOWED)),
    case("-m", "eta=a,0.5", "seed=0,1.5", says=("eta: a", ALLOWED), more=(("seed: 1.5", ALLOWED),)),
    case("-m", "rom=spring_leg,sprung_leg", says=("rom: sprung_leg", "did you mean spring_leg?")),
    case("-m", "spede=1,2", says=("spede: unknown key; did you mean speed?",)),
    case("-m", "speed=interval(0,1)", says=("speed=interval(0,1): has no end", "<= 10 m/s")),
    case("-m", "speed=glob(*)", says=("speed=glob(*): names no value", "<= 10 m/s")),
    case("-m", "speed=1,,2", says=("speed=1,,2: cannot be read", "<= 10 m/s")),
)  # fmt: skip

JOBLIB = ("-m", "speed=1,2", "hydra/launcher=joblib")
OF_HYDRA = (
    case("-m", "hydra.mode=RUN", says=("hydra.mode: RUN", ALLOWED, "-m")),
    case("hydra.run.dir=/dev/null/x", says=("hydra.run.dir: /dev/null/x", ALLOWED)),
    case("-m", "hydra.sweep.dir=null", says=("hydra.sweep.dir: null", ALLOWED)),
    case("-m", "hydra.sweep.dir=' '", says=("hydra.sweep.dir: ", ALLOWED)),
    case("hydra.job.env_copy=[ROMGRL_NO_SUCH_NAME]", says=("hydra.job.env_copy: ROMGRL_NO_SUCH_NAME",)),
    case("-m", "hydra.sweeper.max_batch_size=0", says=("hydra.sweeper.max_batch_size: 0", ALLOWED)),
    case(*JOBLIB, "hydra.launcher.n_jobs=0", says=("hydra.launcher.n_jobs: 0", ALLOWED)),
    case(*JOBLIB, "hydra.launcher.n_jobs=null", says=("hydra.launcher.n_jobs: null", ALLOWED)),
    case(*JOBLIB, "hydra.launcher.batch_size=0", says=("hydra.launcher.batch_size: 0", ALLOWED)),
    case(*JOBLIB, "hydra.launcher.batch_size=abc", says=("hydra.launcher.batch_size: abc", ALLOWED)),
    case(*JOBLIB, "hydra.launcher.pre_dispatch=0", says=("hydra.launcher.pre_dispatch: 0", ALLOWED)),
    case(*JOBLIB, "hydra.launcher.pre_dispatch=xx", says=("hydra.launcher.pre_dispatch: xx", ALLOWED)),
    case(*JOBLIB, "hydra.launcher.timeout=1", says=("hydra.launcher.timeout: 1", ALLOWED)),
    case(*JOBLIB, "hydra.launcher.require=sharedmem", says=("hydra.launcher.require: sharedmem", ALLOWED)),
)  # fmt: skip

FILES = (
    file(HEAD + "speed: [1\n", says=(("mine.yaml:5: is not YAML",),)),
    file(HEAD + "speed: 1\nspeed: 2\n", "eta=7", says=(("eta: 7",), ("mine.yaml:5: ", "duplicate key speed"))),
    file(HEAD + "speed: !!python/object/apply:os.mkdir [ran]\n", says=(("mine.yaml:4: ", "python"),)),
    file(HEAD.encode() + b"speed: \xe9\n", says=(("mine.yaml: is not UTF-8",),)),
    file("speed: 4\n", says=(("mine: has no schema",),)),
    file("- speed\n", says=(("mine.yaml: is a list; a configuration has keys",),)),
    file("defaults: 5\n", says=(("mine.yaml: defaults: 5 is not allowed; allowed: a list",),)),
    file("defaults:\n  - config\n  - nothing\n", says=(("defaults: nothing", ALLOWED),)),
    file("defaults:\n  - config\n  - mine\n", says=(("mine.yaml: its defaults come back to it: mine -> mine",),)),
    file("defaults:\n  - config\n  - override /teacher: pppo\n", says=(("teacher: pppo", "did you mean ppo?"),)),
    file(HEAD + "spede: 1\nteacher: {lerning_rate: 1, alpha: x}\nrom: 5\n",
         says=(("teacher.lerning_rate in ", "mine.yaml: unknown key", "teacher.learning_rate?"),
               ("spede in ", "mine.yaml: unknown key; did you mean speed?"),
               ("rom: 5", ALLOWED), ("teacher.alpha: x", ALLOWED))),
    file(HEAD + "teacher: null\n", says=(("teacher: null", ALLOWED),)),
    file(HEAD + "teacher: [1, 2]\n", says=(("mine", "Cannot merge DictConfig with ListConfig"),)),
    file(HEAD + "speed: .nan\neta: .inf\nnoise: '1'\n",
         says=(("speed: nan", ALLOWED), ("eta: inf", ALLOWED), ("noise: '1'", ALLOWED))),
    file(HEAD + "seed: 0x" + "f" * 5000 + "\n", says=(("seed: a whole number of 20000 bits", ALLOWED),)),
    file(HEAD + "paths: {outputs: \"a\\0b\"}\n", says=(("paths.outputs: a\\x00b", ALLOWED),)),
    file(HEAD + "tracking: {experiment: \"a\\e[2Jb\"}\n", says=(("tracking.experiment: a\\x1b[2Jb", ALLOWED),)),
    file(HEAD + "speed: ${nothing}\n", says=(("speed: ${nothing} cannot be resolved",),)),
    file(HEAD + "speed: ${spe\n", says=(("speed: ",),)),
    file(HEAD + "hydra: {mode: FAST}\n", says=(("mine", "FAST", "RUN, MULTIRUN"),)),
    file(HEAD + "hydra: {searchpath: ['file:///no/such/place']}\n", says=(("/no/such/place is not available",),)),
    file(HEAD + "hydra: {mode: MULTIRUN, sweeper: {params: {eta: '0.5,9'}}}\n", says=(("eta: 9", ALLOWED),)),
    file(HEAD + "hydra: {sweeper: {params: {spede: '1,2', eta: '1,,2'}}}\n", "-m",
         says=(("spede: unknown key",), ("eta=1,,2: cannot be read",))),
    Case(("teacher=mine", "eta=7"), (("eta: 7", ALLOWED), ("mine.yaml:1: is not",)), {"teacher/mine.yaml": "x: ]"}),
    Case(("teacher=mine",), (("teacher/mine.yaml: is empty",),), {"teacher/mine.yaml": "# nothing\n"}),
    Case(("experiment=mine",), (("experiment/mine.yaml: is empty",),), {"experiment/mine.yaml": ""}),
    Case(("experiment=mine",), (("experiment/mine.yaml: is a list",),), {"experiment/mine.yaml": "- speed\n"}),
    Case(("experiment=mine",), (("experiment/mine.yaml: defaults: a mapping is not allowed",),),
         {"experiment/mine.yaml": "defaults: {a: b}\n"}),
    Case(("experiment=mine",), (("experiment/a.yaml: its defaults come back", "experiment/a -> experiment/b -> exp"),),
         {"experiment/mine.yaml": "defaults: [a]\n", "experiment/a.yaml": "defaults: [b]\n",
          "experiment/b.yaml": "defaults: [a, c]\n", "experiment/c.yaml": "# @package _global_\nspeed: 3\n"}),
    Case(("experiment=mine",), (("/experiment/mine.yaml:1: is not YAML",),),
         {"experiment/mine.yaml": "speed: ]\n", "experiment/other.yaml": "speed: [\n", "rom/other.yaml": "- a\n"}),
    Case(("experiment=mine",), (("hello: unknown key",),), {"experiment/mine.yaml": "# @package _global_\nhello\n",
         "experiment/tab.yaml": "a:\n\tb: 3\n", "experiment/folder.yaml/x.txt": ""}),
    Case(("teacher=mine", "experiment=mine"),
         (("rom.stifness in ", "/experiment/mine.yaml: unknown"), ("teacher.gama in ", "/teacher/mine.yaml: unknown")),
         {"teacher/mine.yaml": "defaults: [running, _self_]\ngama: 1\n",
          "experiment/mine.yaml": "# @package _global_\nrom: {stifness: 1}\n"}),
)  # fmt: skip

OF_SEARCHES = ("reward=forward_velocity", "degree=2", "pretrained=true", "rollouts=9000")
MISFITS = (
    ("evaluation.window", "evaluation.window=400"),
    ("evaluation.window", "reference.episodes=25"),
    ("evaluation.window", "evaluation.window=120 evaluation.steps=110"),
    ("robustness.mass", "robustness.mass=[1,0.9]"),
    ("robustness.push_impulse", "robustness.push_impulse=[0.1,0.1]"),
    ("robustness.push_duration", "robustness.push_duration=6"),
    ("student.batch_size", "student.batch_size=9999999"),
    ("student.policy_updates", "student.policy_updates=2"),
    ("teacher.segment_steps", "teacher.segment_steps=64"),
    ("teacher.speed", "teacher.speeds=[1,3]"),
    ("teacher.stiffness_share", "rom=variable_leg teacher.stiffness_shares=[0.5,0.9]"),
    ("teacher.stiffness_shares", "teacher.stiffness_shares=[0.7,1.4]"),
    ("teacher.stiffness_share", "teacher.stiffness_share=0.8"),
    ("teacher.stiffness_shares", "rom=variable_leg rom.stiffness=100000 teacher.stiffness_shares=[1,10]"),
    ("teacher.speeds", "teacher=pretrained teacher.speeds=[2,5]"),
    ("teacher.command_steps", "teacher.command_steps=60"),
    ("teacher.algorithm", "teacher=cmaes rom=running"),
    ("teacher.cycles", "teacher.cycles=/no/such/place teacher.cycle_resets=0.5"),
    ("teacher.cycle_resets", "teacher.cycle_resets=0.5"),
    ("library.stiffness_shares", "stage=library teacher=variable_running library.stiffness_shares=[0.5,1]"),
    ("library.others", "stage=library library.others=[/no/such/library]"),
    ("teacher.apex", "teacher=hopping teacher.apex=0.3"),
    ("teacher.apex", "stage=teacher teacher=jumping teacher.apex=0.6"),
    ("teacher.gait", "teacher=jumping"),
    ("teacher.speed", "stage=teacher teacher=jumping teacher.speed=1"),
    ("teacher.speeds", "stage=library teacher=jumping teacher.speeds=[0,1]"),
    ("library.apex_step", "stage=library teacher=jumping library.apex_step=1e-5"),
    ("library.speed_step", "stage=library teacher=hopping library.speed_step=1e-5"),
    ("teacher.apex", "stage=teacher teacher=jumping teacher.apexes=null teacher.apex=0"),
    ("teacher.apexes", "stage=teacher teacher=jumping teacher.apexes=[0,0.5]"),
    ("teacher.gait", "stage=teacher rom=variable_leg teacher.gait=jump teacher.apex=0.3"),
    ("teacher.command_steps", "teacher=cmaes teacher.speeds=[2,4] teacher.command_steps=30"),
    *((f"teacher.{text.partition('=')[0]}", f"teacher=cmaes teacher.{text}") for text in OF_SEARCHES),
    ("eta", "comparison=same_resets eta=0.5"),
    ("comparison", "comparison=upright stage=verify"),
    ("comparison", "comparison=sinusoid discriminator=none"),
    ("comparison", "comparison=no_resets eta=1"),
    *(("student.learning_starts", f"student.learning_starts={steps}") for steps in (0, 230001)),
    ("student.buffer_size", "student.buffer_size=100 student.batch_size=64 student.learning_starts=64"),
    ("reference.warmup_steps", "reference.warmup_steps=1001"),
    ("reference.episodes", "reference.episodes=2001"),
    ("teacher.minibatch_size", "teacher.minibatch_size=99999"),
    ("teacher.pretrained", "student.pretrained=true"),
    ("teacher.rollout_steps", "teacher.num_envs=1 teacher.rollout_steps=1 teacher.minibatch_size=1"),
    ("discriminator.window", "discriminator.window=32 reference.episodes=100 evaluation.window=20"),
    ("discriminator.window", "discriminator.stride=32 discriminator.window=20"),
    ("discriminator.gradient_penalty", "discriminator.loss=wasserstein discriminator.gradient_penalty=0"),
    ("discriminator.held_out", "discriminator.held_out=0.00001"),
    ("stage", "student=conditioned stage=robustness"),
    ("teacher.speeds", "student=conditioned stage=student"),
    ("evaluation.specialists", f"{EVERY_SPEED} evaluation.specialists=[/no/such/place]"),
    ("evaluation.window", f"{EVERY_SPEED} evaluation=thorough evaluation.window=400 reference.episodes=4"),
    ("speed", "student=conditioned stage=watch speed=1 teacher=variable_running"),
    ("rom.reset_hip_angle", "rom.hip_angle_limit=0.2"),
    ("rom.roll_over_radius", "rom.roll_over_radius=0.05"),
    ("rom.stiffness", "rom.substeps=1"),
    ("rom.mass", "rom.foot_mass=40"),
    ("rom.compression_limit", "rom.compression_limit=1 rom.extension_limit=1"),
    ("humanoid.xml", "humanoid.xml=/no/such/file.xml"),
    ("tracking.uri", "tracking.uri=./mlruns"),
    ("tracking.experiment", "tracking.experiment=" + "x" * 300),
    ("paths.outputs", "paths.outputs=" + "x" * 300),
)
