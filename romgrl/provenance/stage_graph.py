"""What stages there are: one record for each, read by the pipeline, the keys, the help and the store of MLflow."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from romgrl.config.schema import Config
from romgrl.runtime.functions import load_function

KNOBS = {"speed": "v", "eta": "eta", "noise": "noise", "seed": "s"}
WALKING_KNOBS = {"speed": "v", "seed": "s"}
TEACHING_KNOBS = {"teacher.speed": "v", "seed": "s"}


@dataclass(frozen=True)
class Stage:
    """A stage: what it is, how it is made and what others make of it.

    `doc`: a line of the help. `function`: module:function that makes its artifact. `upstream`: the stages it reads.
    `depends`: keys and groups of the configuration that change what it makes. `knobs`: keys in the title of its run, by
    their labels. `tables`: its CSV files that MLflow shows, with the columns that name a row. `metrics`, `printed`:
    module:function from its directory to numbers of a run, and to what ends a job on the terminal. `briefly`: to the
    line that stands there where another stage was asked for. `beside`: what ships trained and is compared with.
    `drawn`: it makes pictures. `optional`: it is made only where it is asked for by name, or read. `fetched`: it may
    come from a tracking server, which no code is taken from. `conditioned`: the stages that it reads in place of
    `upstream` where the student is conditioned; None: it knows of no such student. `foresees`: by a stage that it
    reads, module:function of configuration and directory that raises ConfigurationError where that is finished and says
    that this one will refuse what it is asked for. `commanded`, `asked_of`: what makes
    it and what it depends on there, in place of `function` and `depends`, where these differ; `asks`: what it depends
    on beside that.
    """

    doc: str
    function: str
    upstream: tuple[str, ...]
    depends: tuple[str, ...]
    knobs: Mapping[str, str] = field(default_factory=lambda: KNOBS)
    tables: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    metrics: str | None = None
    printed: str | None = None
    briefly: str | None = None
    beside: tuple[str, ...] = ()
    drawn: bool = False
    optional: bool = False
    fetched: bool = True
    conditioned: tuple[str, ...] | None = None
    commanded: str | None = None
    asked_of: tuple[str, ...] | None = None
    asks: tuple[str, ...] = ()
    foresees: Mapping[str, str] = field(default_factory=dict)

    def made_by(self, *, conditioned: bool) -> str:
        """The module:function that makes it, with a student that is conditioned or not."""
        return self.commanded if conditioned and self.commanded is not None else self.function

    def depends_on(self, *, conditioned: bool) -> tuple[str, ...]:
        """Keys and groups that change what it makes, with a student that is conditioned or not."""
        return self.asked_of if conditioned and self.asked_of is not None else self.depends

    def reads(self, *, conditioned: bool) -> tuple[str, ...]:
        """The stages that it reads, with a student that is conditioned or not."""
        return self.conditioned if conditioned and self.conditioned is not None else self.upstream

    def numbers(self, directory: Path) -> dict[str, float]:
        """The numbers of a run whose artifact lies in a directory."""
        return {} if self.metrics is None else load_function(self.metrics)(directory)

    def foresee(self, upstream: str, config: Config, directory: Path) -> None:
        """Raise ConfigurationError where this stage will refuse what it is asked for, by a finished upstream one."""
        if upstream in self.foresees:
            load_function(self.foresees[upstream])(config, directory)

    def shown(self, directory: Path, *, asked: bool) -> list[Any]:
        """What ends a job on the terminal, for rich to print, and lines; asked: for this stage by name."""
        if self.briefly is not None and not asked:
            return [load_function(self.briefly)(directory)]
        return [] if self.printed is None else load_function(self.printed)(directory)


BODY = ("humanoid.xml", "humanoid.skeleton", "humanoid.height", "humanoid.mass", "humanoid.control_frequency")
STAGES: dict[str, Stage] = {
    "teacher": Stage(
        "PPO or CMA-ES finds a gait on the reduced-order model",
        "romgrl.stages.teacher:run",
        (),
        ("rom", "teacher", *BODY, "seed", "device"),
        knobs=TEACHING_KNOBS,
        tables={"gait.csv": ("walker",)},
    ),
    "reference": Stage(
        "the paths of its feet and body",
        "romgrl.stages.reference:run",
        ("teacher",),
        ("rom", "teacher", *BODY, "reference", "seed"),
        knobs=TEACHING_KNOBS,
    ),
    "student": Stage(
        "SAC and the discriminator on the humanoid",
        "romgrl.stages.student:run",
        ("reference",),
        ("student", "discriminator", "humanoid", "teacher.speed", "speed", "eta", "noise", "seed", "device"),
        conditioned=("library",),
    ),
    "baseline": Stage(
        "SAC alone",
        "romgrl.stages.student:run",
        (),
        ("student", "humanoid", "speed", "seed", "device"),
        knobs=WALKING_KNOBS,
        conditioned=("library",),
    ),
    "evaluation": Stage(
        "student and baseline scored against the reference",
        "romgrl.stages.evaluation:run",
        ("reference", "student", "baseline"),
        ("evaluation", "humanoid", "student.alpha", "rom", "teacher", "reference", "speed", "seed"),
        tables={
            "mse.csv": ("channel", "alignment"),
            "distances.csv": ("distance", "channel"),
            "gait.csv": ("walker",),
            "null_models.csv": ("measure", "channel", "walker"),
            "grid.csv": ("gait", "speed_m_per_s", "walker"),
            "confusion.csv": ("walker", "asked"),
            "transitions.csv": ("transition", "walker"),
            "ramp.csv": ("direction", "asked_m_per_s", "walker"),
        },
        metrics="romgrl.report.grid_tables:evaluation_metrics",
        printed="romgrl.report.grid_tables:evaluation_tables",
        beside=("teacher",),
        conditioned=("library", "student", "baseline"),
        commanded="romgrl.stages.grid_evaluation:run",
        asked_of=(
            *("evaluation", "humanoid", "reference", "seed"),
            *("student.kind", "student.alpha", "student.taught_step", "student.standing_share"),
        ),
    ),
    "report": Stage(
        "page, tables, figures and films",
        "romgrl.stages.report:run",
        ("teacher", "reference", "student", "baseline", "evaluation"),
        ("rom", "teacher", "evaluation", "humanoid", "student.alpha", "speed", "eta", "noise", "seed"),
        drawn=True,
        conditioned=("library", "student", "baseline", "evaluation"),
        commanded="romgrl.stages.grid_report:run",
        asked_of=("evaluation", "humanoid", "reference", "student.kind", "student.taught_step", "seed"),
    ),
    "robustness": Stage(
        "fall rates under pushes, noise, other masses and grounds",
        "romgrl.stages.robustness:run",
        ("teacher", "student", "baseline"),
        ("robustness", "rom", "teacher", "humanoid", "student.alpha", "speed", "seed"),
        tables={"robustness.csv": (), "floquet.csv": ()},
        metrics="romgrl.report.terminal_tables:robustness_metrics",
        drawn=True,
        optional=True,
    ),
    "library": Stage(
        "references of a teacher over its speeds and stiffnesses",
        "romgrl.stages.library:run",
        ("teacher",),
        ("library", "rom", "teacher", *BODY, "reference", "seed"),
        knobs={"seed": "s"},
        tables={"library.csv": ()},
        metrics="romgrl.report.library_table:library_metrics",
        printed="romgrl.report.library_table:library_tables",
        briefly="romgrl.report.library_table:library_line",
        drawn=True,
        optional=True,
    ),
    "export": Stage(
        "the student as files that run without romgrl",
        "romgrl.stages.export:run",
        ("student",),
        ("humanoid", "student.alpha", "speed", "seed"),
        knobs=WALKING_KNOBS,
        optional=True,
        fetched=False,
        conditioned=("student", "library"),
        asks=("speed", "teacher.gait", "student.taught_step", "student.standing_share", "reference.steps"),
        foresees={"library": "romgrl.stages.conditioned.asked_at_first:require_first_command"},
    ),
}
ACTIONS = {
    "watch": "see a walker, trained or in training",
    "sync": "bring MLflow what earlier jobs could not",
    "verify": "compare what is finished with the paper",
}  # other values of `stage`, which make no artifact


def wanted(stage: str, *, conditioned: bool = False) -> list[str]:
    """The stages that a value of `stage` asks for; all that know of a student that is conditioned where it is."""
    if stage != "all":
        return [stage]
    return [n for n, each in STAGES.items() if not each.optional and (each.conditioned is not None or not conditioned)]


def plan(targets: Iterable[str], present: Callable[[str], bool], *, conditioned: bool = False) -> list[str]:
    """The targets and, for each that is not there, what it needs; upstream first."""
    found: list[str] = []

    def add(stage: str) -> None:
        if stage not in found:
            for name in () if present(stage) else STAGES[stage].reads(conditioned=conditioned):
                add(name)
            found.append(stage)

    for stage in targets:
        add(stage)
    return found


def share_threads(stages: Collection[str], threads: int, *, conditioned: bool = False) -> dict[str, int]:
    """Threads of each stage that is to be made: half of all where another does not need it, nor it the other.

    Decided before the first stage starts, so that no result depends on how long another stage takes.
    """
    ahead = {stage: upstream_of(stage, conditioned=conditioned) for stage in stages}

    def beside(stage: str) -> bool:
        return any(one != stage and one not in ahead[stage] and stage not in ahead[one] for one in stages)

    return {stage: max(1, threads // 2) if beside(stage) else threads for stage in stages}


def upstream_of(stage: str, *, conditioned: bool = False) -> set[str]:
    """Every stage that a stage needs, directly or through others."""
    direct = STAGES[stage].reads(conditioned=conditioned)
    return set(direct).union(*(upstream_of(name, conditioned=conditioned) for name in direct))
