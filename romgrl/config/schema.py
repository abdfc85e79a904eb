"""Typed schema of every configuration key, with its meaning, unit and range.

The values live in conf/*.yaml; this file says what is allowed. romgrl.config.values checks a composed configuration,
and docs/configuration.md is generated from the same metadata.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

MISSING: Any = "???"


def key(
    doc: str,
    *,
    unit: str = "",
    low: float | None = None,
    high: float | None = None,
    above: float | None = None,
    choices: tuple[str, ...] = (),
) -> Any:
    """Describe one key: low <= value <= high, value > above, or value in choices. The value comes from YAML."""
    metadata = {"doc": doc, "unit": unit, "low": low, "high": high, "above": above, "choices": choices}
    return field(default=MISSING, metadata=metadata)


STAGES = ("teacher", "reference", "student", "baseline", "evaluation", "report")
OPTIONAL_STAGES = ("robustness",)  # made only when asked for by name; no stage reads them


@dataclass
class Rom:
    """Reduced-order model: a trunk on two spring legs (paper section 3.2). None = taken from the humanoid."""

    name: str = key("what it is called; not given: as its preset")
    mass: float | None = key("total mass, feet included; null: the humanoid's", unit="kg", low=0.01, high=1e6)
    leg_length: float | None = key(
        "rest length from hip to foot centre; null: the humanoid's pelvis to ankle", unit="m", low=0.05, high=2
    )
    foot_radius: float | None = key(
        "radius of the foot circle; null: the humanoid's ankle height", unit="m", low=0.001, high=1
    )
    foot_mass: float = key("mass of each foot", unit="kg", low=1e-4, high=1e5)
    stiffness: float = key("leg spring", unit="N/m", low=0.001, high=1e9)
    stance_damping: float = key("leg damping while loaded", unit="N s/m", low=0, high=1e7)
    swing_damping: float = key("leg damping while unloaded", unit="N s/m", low=0, high=1e7)
    hip_torque: float = key("hip torque at action 1", unit="N m", above=0, high=1e5)
    torque_lag: float = key("time constant of the hip motors; 0: none", unit="s", low=0, high=100)
    trunk_moment_limit: float | None = key("largest net hip moment of the trunk; null: no limit", unit="N m", above=0)
    retraction: float = key("shortening of a leg in early swing, share of leg_length; 0: none", low=0, high=0.4)
    retraction_time: float = key("duration of retraction and extension", unit="s", low=1e-6, high=100)
    hip_angle_limit: float = key("hip stops at +- this angle", unit="rad", low=0.01, high=1.57)
    compression_limit: float = key("shortest leg, share of leg_length", low=0.05, high=1)
    extension_limit: float = key("longest leg, share of leg_length", low=1, high=1.5)
    friction: float = key("ground friction coefficient", low=0, high=100)
    trunk_locked: bool = key("true: the trunk cannot rotate (4 degrees of freedom)")
    trunk_inertia: float = key("moment of inertia of a free trunk", unit="kg m^2", low=1e-4, high=1e6)
    trunk_pitch_limit: float = key("a free trunk falls beyond this pitch", unit="rad", low=0.01, high=10)
    fall_height: float = key("an episode ends below this body height, share of leg_length", above=0, high=1)
    substeps: int = key("physics steps per control step", low=1, high=10_000)
    engine: str = key("box2d: the library; native: the same equations for many worlds", choices=("box2d", "native"))
    velocity_iterations: int = key("velocity iterations of the solver", low=1, high=1000)
    position_iterations: int = key("position iterations of the solver", low=1, high=1000)
    reset_hip_angle: list[float] = key("range of the anti-phase hip angle at reset", unit="rad", low=0, high=1.57)
    reset_speed: list[float] = key("range of the forward speed at reset, share of the target speed", low=-10, high=10)
    observation: str = key("full: 20 entries; paper: the 13 that the paper lists", choices=("full", "paper"))


@dataclass
class Teacher:
    """PPO on the reduced-order model (paper section 3.2)."""

    name: str = key("what it is called; not given: as its preset")
    speed: float = key("target speed of the teacher", unit="m/s", low=0, high=10)
    reward: str = key(
        "exponential: exp(-alpha |v - speed|); forward_velocity: v", choices=("exponential", "forward_velocity")
    )
    alpha: float = key("sensitivity of the exponential reward", unit="s/m", low=1e-9, high=1e6)
    total_steps: int = key("environment steps at most (whole rollouts, at least one)", low=1, high=10**12)
    num_envs: int = key("worlds stepped together", low=1, high=100_000)
    rollout_steps: int = key("steps per world between updates", low=1, high=1_000_000)
    episode_steps: int = key("an episode is truncated after this many control steps", low=1, high=10**9)
    epochs: int = key("passes over each rollout", low=1, high=1000)
    minibatch_size: int = key("samples per gradient step", low=1, high=10**9)
    hidden_sizes: list[int] = key("hidden layers of policy and value network", low=1, high=65_536)
    activation: str = key("activation of both networks", choices=("tanh", "relu", "elu"))
    learning_rate: float = key("Adam learning rate", above=0, high=1)
    learning_rate_decay: bool = key("true: the learning rate falls linearly to zero")
    gamma: float = key("discount factor", above=0, high=1)
    gae_lambda: float = key("lambda of generalised advantage estimation", low=0, high=1)
    clip_ratio: float = key("PPO clip range", above=0, high=10)
    value_coefficient: float = key("weight of the value loss", low=0, high=1e6)
    entropy_coefficient: float = key("weight of the entropy bonus", low=0, high=1e6)
    max_gradient_norm: float = key("gradients are clipped to this norm", above=0, high=1e9)
    initial_log_std: float = key("log standard deviation of the first policy", low=-20, high=5)
    mirror: bool = key("true: half of each minibatch is left-right mirrored")
    pretrained: bool = key("true: nothing is trained; the teacher that ships with the package is taken")


@dataclass
class Reference:
    """Rollout of the trained teacher (paper section 3.2)."""

    steps: int = key("steps kept, all episodes together", low=50, high=10**8)
    episodes: int = key("episodes from different resets", low=1, high=100_000)
    warmup_steps: int = key("first steps of each episode, left out as not steady", low=0, high=10**8)
    check: bool = key("true: refuse a reference that falls, hops, slides or drifts; false: only say so")


@dataclass
class Humanoid:
    """Planar humanoid in MuJoCo (paper section 4.1.2)."""

    name: str = key("what it is called; not given: as its preset")
    xml: str | None = key("MuJoCo file to hold in the sagittal plane; null: the project's own humanoid")
    actuation: str = key("servo: position servos; torque: joint torques", choices=("servo", "torque"))
    height: float = key("body height of the project's own humanoid", unit="m", low=1.2, high=2.2)
    mass: float = key("body mass of the project's own humanoid", unit="kg", low=30, high=150)
    control_frequency: float = key("control steps per second", unit="Hz", low=1, high=10_000)
    substeps: int = key("physics steps per control step", low=1, high=10_000)
    episode_steps: int = key("an episode is truncated after this many control steps", low=2, high=10**9)
    reset_speed: list[float] = key("range of the forward speed at reset, share of the target speed", low=0, high=10)
    fall_pelvis_height: float = key(
        "it falls when the pelvis is below this share of its standing height", low=0, high=1
    )
    fall_head_height: float = key("it falls when the head is below this share of its standing height", low=0, high=1)
    fall_trunk_lean: float = key("it falls beyond this lean of the pelvis-neck line", unit="rad", above=0, high=10)


@dataclass
class Student:
    """SAC on the humanoid (paper section 3.3); the baseline is the same with eta = 1 and no discriminator."""

    name: str = key("what it is called; not given: as its preset")
    alpha: float = key("sensitivity of the velocity reward", unit="s/m", low=1e-9, high=1e6)
    total_steps: int = key("environment steps", low=1, high=10**12)
    num_envs: int = key("humanoids stepped together", low=1, high=100_000)
    updates_per_step: float = key("critic updates per environment step", above=0, high=1000)
    learning_starts: int = key("environment steps before the first update", low=0, high=10**12)
    batch_size: int = key("transitions per update", low=1, high=10**7)
    buffer_size: int = key("transitions kept", low=1, high=10**9)
    hidden_sizes: list[int] = key("hidden layers of policy and critics", low=1, high=65_536)
    layer_norm: bool = key("true: layer normalisation in policy and critics")
    compact_observation: bool = key("true: the networks drop columns that are constant in the plane")
    policy_learning_rate: float = key("Adam learning rate of the policy", above=0, high=1)
    critic_learning_rate: float = key("Adam learning rate of the critics", above=0, high=1)
    temperature_learning_rate: float = key("Adam learning rate of the temperature", above=0, high=1)
    initial_temperature: float = key("first weight of the entropy", above=0, high=1e6)
    target_entropy_scale: float = key("target entropy = - this x number of actions", above=0, high=1000)
    learning_rate_decay: bool = key("true: all learning rates fall linearly to zero over the second half")
    gamma: float = key("discount factor", above=0, high=1)
    tau: float = key("share of the critics copied into their targets at each update", above=0, high=1)
    policy_delay: int = key("critic updates per policy update", low=1, high=10**6)
    simultaneous: bool = key(
        "true: policy and critics take their gradients at the same point, on two threads; false: critics first"
    )
    critic_target: str = key("how the twin target critics are joined", choices=("minimum", "mean"))
    mirror: bool = key("true: half of each batch is left-right mirrored")
    normalize_observation: bool = key("true: observations are standardised by their running mean and deviation")
    candidates: int = key("policies of the second half, the best of which is kept; 0: the last", low=0, high=1000)
    reference_resets: float = key("share of a student's episodes that start in a pose of the reference", low=0, high=1)
    policy_average: float = key("policies are running averages with this decay; 0: as they are", low=0, high=0.99999)
    pretrained: bool = key("true: nothing is trained; student and baseline that ship with the package are taken")


LABELLED, CRITICS = ("bce", "least_squares"), ("wasserstein",)  # losses; only a penalty bounds a critic


@dataclass
class Discriminator:
    """Adversarial judge of the gait (paper section 3.3)."""

    name: str = key("what it is called; not given: as its preset")
    enabled: bool = key("false: no imitation; the student is the baseline, whatever eta and noise are")
    features: str = key(
        "what a frame holds, paper: the five; trunk: the trunk inclination as well; velocities: the five and their "
        "velocities; trunk_velocities: all of these",
        choices=("paper", "trunk", "velocities", "trunk_velocities"),
    )
    window: int = key("frames judged together", low=1, high=32)
    stride: int = key("control steps from one frame of a window to the next", low=1, high=32)
    loss: str = key(
        "bce: cross-entropy; least_squares: as AMP; wasserstein: a critic as WGAN-GP; each with its own reward",
        choices=(*LABELLED, *CRITICS),
    )
    reward: str = key(
        "recomputed: by the current discriminator whenever a transition is drawn; stored: by the one of its time",
        choices=("recomputed", "stored"),
    )
    trunk_std: float = key(
        "spread of the trunk inclination in the reference stream (0 for the ROM)", unit="rad", low=0, high=10
    )
    hidden_sizes: list[int] = key("hidden layers", low=1, high=65_536)
    dropout: float = key("dropout after each hidden layer", low=0, high=0.9)
    learning_rate: float = key("Adam learning rate", above=0, high=1)
    gradient_penalty: float = key("weight of the gradient penalty", low=0, high=1e6)
    penalty_on: str = key(
        "where the gradient penalty is taken, interpolates: of both streams, aim 1; with aim 0 on the reference "
        "(as AMP) or on both streams",
        choices=("interpolates", "reference", "both"),
    )
    label_smoothing: float = key("labels of bce are 1 - this and this", low=0, high=0.49)
    update_interval: int = key("critic updates per discriminator update", low=1, high=10**6)
    batch_size: int = key("windows of each stream per update", low=1, high=10**7)
    recent_steps: int | None = key(
        "the student's windows are drawn from this many last steps; null: from all", low=1, high=10**9
    )
    standardize: bool = key("true: features are standardised by the reference's mean and deviation")
    reward_limit: float | None = key("largest imitation reward; null: no limit", above=0, high=1e6)
    held_out: float = key("share of the reference held out for the validation loss", above=0, high=0.9)
    patience: int | None = key(
        "updates without a better validation loss before training stops; null: never", low=1, high=10**9
    )


@dataclass
class Evaluation:
    """Deterministic rollouts of student and baseline against the reference (paper section 4.2)."""

    episodes: int = key("episodes per policy", low=1, high=10_000)
    steps: int = key("control steps per episode", low=100, high=10**6)
    window: int = key("last steps of each episode that are scored", low=10, high=10**6)
    video: bool = key("true: render a film of each gait")


@dataclass
class Robustness:
    """Fall rate of student and baseline under disturbances (`stage=robustness`), the teacher's orbital stability."""

    trials: int = key("trials of each walker at each level", low=1, high=100_000)
    watch: float = key("a fall counts until this long after the disturbance began", unit="s", low=0.1, high=1000)
    push_impulse: list[float] = key(
        "horizontal impulses on the chest per body mass, each forward and backward", unit="N s/kg", low=0, high=10
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
    speed: float = key("target speed of student and baseline", unit="m/s", low=0, high=10)
    eta: float = key("weight of the task reward; 1 - eta weighs imitation", low=0, high=1)
    noise: float = key("standard deviation of the Gaussian noise on both streams of the discriminator", low=0, high=10)
    seed: int = key("seed of every random number", low=0, high=2**32 - 1)
    device: str = key("where the networks are trained", choices=("cpu", "cuda"))
    threads: int = key("threads of physics and networks; 0: all cores", low=0, high=1024)
    parallel_stages: bool = key(
        "true: with two threads or more, stages that do not need each other run side by side, with half of them each"
    )
    checkpoint_seconds: float = key("work between two checkpoints of a training", unit="s", above=0, high=1e6)
    experiment: str = key("name of the preset")
    rom: Rom = field(default_factory=Rom)
    teacher: Teacher = field(default_factory=Teacher)
    reference: Reference = field(default_factory=Reference)
    humanoid: Humanoid = field(default_factory=Humanoid)
    student: Student = field(default_factory=Student)
    discriminator: Discriminator = field(default_factory=Discriminator)
    evaluation: Evaluation = field(default_factory=Evaluation)
    robustness: Robustness = field(default_factory=Robustness)
    watch: Watch = field(default_factory=Watch)
    tracking: Tracking = field(default_factory=Tracking)
    paths: Paths = field(default_factory=Paths)
