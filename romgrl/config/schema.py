"""Typed schema of every configuration key, with its meaning, unit and range.

The values live in conf/*.yaml; this file says what is allowed. romgrl.config.values checks a composed configuration,
and docs/configuration.md is generated from the same metadata.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from romgrl.config.commanded import STUDENTS
from romgrl.config.fields import key, one_of
from romgrl.config.learners import Discriminator, Student
from romgrl.config.teachers import TEACHERS, TOP_SPEED, Teacher
from romgrl.config.worlds import ROMS, Humanoid, Rom

PRESETS = ("experiment", "comparison")  # groups whose files change keys of others
STAGES = ("teacher", "reference", "student", "baseline", "evaluation", "report")
OPTIONAL_STAGES = (
    "robustness",
    "library",
    "export",
)  # made only when asked for by name, or read


@dataclass
class Reference:
    """Rollout of the trained teacher (paper section 3.2)."""

    steps: int = key("steps kept, all episodes together", low=50, high=10**8)
    episodes: int = key("episodes from different resets", low=1, high=100_000)
    warmup_steps: int = key("first steps of each episode, left out as not steady", low=0, high=10**8)
    check: bool = key("true: refuse a reference that falls, hops, slides or drifts; false: only say so")


@dataclass
class Evaluation:
    """Deterministic rollouts of student and baseline against the reference (paper section 4.2)."""

    episodes: int = key(
        "episodes per policy; with student.kind=conditioned at each cell of the library, and of each transition",
        low=1,
        high=10_000,
    )
    steps: int = key(
        "control steps per episode; with student.kind=conditioned all episodes of a cell last 10 s", low=100, high=10**6
    )
    window: int = key("last steps of each episode that are scored", low=10, high=10**6)
    video: bool = key("true: render a film of each gait")
    specialists: list[str] | None = key(
        "with student.kind=conditioned: directories of finished evaluations of students of one speed, whose errors its "
        "own are put beside",
        before=None,
    )


@dataclass
class Robustness:
    """Fall rate of student and baseline under disturbances (`stage=robustness`), the teacher's orbital stability."""

    trials: int = key("trials of each walker at each level", low=1, high=100_000)
    horizon: float = key("a fall counts until this long after the disturbance began", unit="s", low=0.1, high=1000)
    push_impulse: list[float] = key(
        "horizontal impulses on the trunk per body mass, each forward and backward", unit="N s/kg", low=0, high=10
    )
    push_duration: float = key(
        "the impulse is spread over this time, rounded to control steps", unit="s", above=0, high=10
    )
    observation_noise: list[float] = key(
        "Gaussian noise on what the policy sees, in standard deviations of each entry in training", low=0, high=100
    )
    mass: list[float] = key("mass and inertia of every segment, share of the humanoid's", low=0.1, high=10)
    friction: list[float] = key("ground friction, share of the humanoid's", low=0.01, high=10)
    orbit_worlds: int = key("models whose strides give the teacher's Floquet multipliers", low=2, high=10_000)


@dataclass
class Library:
    """References of one teacher over all that it learned (`stage=library`), each checked and measured."""

    speed_step: float = key("between two speeds, multiples of it within teacher.speeds", unit="m/s", low=1e-6, high=10)
    apex_step: float = key(
        "between two apexes of jumps, multiples of it within teacher.apexes", unit="m", low=1e-6, high=2, before=0.1
    )
    stiffness_shares: list[float] = key(
        "stiffness of the legs, where the teacher has learned a range of it, shares of rom.stiffness", low=0.1, high=10
    )
    orbit_worlds: int = key("models whose strides give the Floquet multipliers of a cell", low=2, high=10_000)
    others: list[str] | None = key(
        "directories of finished libraries, such as those of other gaits, whose cells are joined with this one's",
        before=None,
    )


@dataclass
class Watch:
    """What `stage=watch` shows: in MuJoCo's viewer, or as a film where there is no display."""

    walker: str = key("whose policy", choices=("student", "baseline"))
    seconds: float = key("length of the film", unit="s", low=0.1, high=600)


@dataclass
class Tracking:
    """MLflow."""

    enabled: bool = key("false: nothing is logged to MLflow")
    uri: str | None = key("tracking server; null: SQLite under paths.outputs")
    experiment: str = key("MLflow experiment")
    system_metrics: bool = key("true: the run of a job gets the load of the machine: processor, memory, disk, GPU")


@dataclass
class Paths:
    """Where results go."""

    outputs: str = key("directory of artifacts, MLflow store and logs")


@dataclass
class Config:
    """Everything a run needs."""

    stage: str = key(
        "last stage to run, with what it needs; watch: see a walker, trained or in training; sync: bring MLflow what "
        "earlier jobs could not; verify: compare what is finished with the paper",
        choices=("all", *STAGES, *OPTIONAL_STAGES, "watch", "sync", "verify"),
    )
    speed: float = key(
        "target speed of student and baseline; with student.kind=conditioned what stage=watch and stage=export begin "
        "with, and nothing else",
        unit="m/s",
        low=0,
        high=TOP_SPEED,
    )
    eta: float = key("weight of the task reward; 1 - eta weighs imitation", low=0, high=1)
    noise: float = key(
        "standard deviation of the Gaussian noise on both streams of the discriminator: in m and rad, or in deviations "
        "of the reference with discriminator.standardize; the first value with discriminator.accuracy",
        low=0,
        high=10,
    )
    seed: int = key("seed of every random number", low=0, high=2**32 - 1)
    device: str = key("where the networks are trained", choices=("cpu", "cuda"))
    threads: int = key("threads of physics and networks; 0: all cores", low=0, high=1024)
    parallel_stages: bool = key(
        "true: with two threads or more, stages that do not need each other run side by side, with half of them each"
    )
    checkpoint_seconds: float = key("work between two checkpoints of a training", unit="s", above=0, high=1e6)
    objective: str = key("number that a search is after (`hydra/sweeper=optuna`), by the name that MLflow shows")
    experiment: str = key("name of the preset")
    comparison: str = key("what stands in the student's place")
    rom: Rom = one_of(ROMS, by="model")
    teacher: Teacher = one_of(TEACHERS, by="algorithm")
    reference: Reference = field(default_factory=Reference)
    humanoid: Humanoid = field(default_factory=Humanoid)
    student: Student = one_of(STUDENTS, by="kind")
    discriminator: Discriminator = field(default_factory=Discriminator)
    evaluation: Evaluation = field(default_factory=Evaluation)
    robustness: Robustness = field(default_factory=Robustness)
    library: Library = field(default_factory=Library)
    watch: Watch = field(default_factory=Watch)
    tracking: Tracking = field(default_factory=Tracking)
    paths: Paths = field(default_factory=Paths)
