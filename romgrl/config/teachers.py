"""Keys of the teachers, which learn to walk on the reduced-order model."""

from __future__ import annotations

from dataclasses import dataclass

from romgrl.config.fields import key

TOP_SPEED = 10  # m/s, which nobody is asked for more than
TOP_STIFFNESS_SHARE = 10
GAITS = ("run", "walk", "hop", "skip", "jump")  # of romgrl.gait.footfall
LONG_RUN = 1_000  # control steps over which a teacher is watched: 33 s, after which runs are steady

TEACHERS: dict[str, type[Teacher]] = {}
"""The keys of each algorithm that a teacher can have; romgrl.stages.training.teachers has the algorithms."""


@dataclass
class Teacher:
    """What every teacher is asked for and paid by."""

    name: str = key("what it is called; not given: as its preset")
    algorithm: str = key("how it learns; not given: ppo", choices=TEACHERS.keys(), before="ppo")
    gait: str = key(
        "what it is to learn: its reference is checked for it, and algorithm=cmaes searches for it",
        choices=GAITS,
        before=("run", "walk"),
    )
    speed: float = key("target speed of the teacher", unit="m/s", low=0, high=TOP_SPEED)
    speeds: list[float] | None = key(
        "range of the speeds that worlds are asked for in a training, each episode another, for a teacher of any of "
        "them; null: speed alone",
        unit="m/s",
        low=0,
        high=TOP_SPEED,
        span=True,
        before=None,
    )
    stiffness_share: float = key(
        "stiffness of the legs that is asked for, share of rom.stiffness",
        low=0.1,
        high=TOP_STIFFNESS_SHARE,
        before=1.0,
    )
    stiffness_shares: list[float] | None = key(
        "range of it that worlds have in a training, each episode another; null: stiffness_share alone",
        low=0.1,
        high=TOP_STIFFNESS_SHARE,
        span=True,
        before=None,
    )
    apex: float = key(
        "how far the body rises over its standing height in each jump; 0: where it does not jump",
        unit="m",
        low=0,
        high=2,
        before=0.0,
    )
    apexes: list[float] | None = key(
        "range of it that worlds have in a training, each episode another; null: apex alone",
        unit="m",
        low=0,
        high=2,
        span=True,
        before=None,
    )
    command_steps: int = key(
        "control steps after which a world is asked for something else; 0: not within an episode",
        low=0,
        high=10**9,
        before=0,
    )
    work_cost: float = key(
        "what the reward loses by positive power of all actuators of body weight times sqrt(g leg_length)",
        low=0,
        high=1000,
        before=0.0,
    )
    reward: str = key(
        "exponential: exp(-alpha |v - speed|); forward_velocity: v", choices=("exponential", "forward_velocity")
    )
    alpha: float = key("sensitivity of the exponential reward", unit="s/m", low=1e-9, high=1e6)
    pretrained: bool = key("true: nothing is trained; the teacher that ships with the package is taken")


COMMANDS = {"speed": "speeds", "stiffness_share": "stiffness_shares", "apex": "apexes"}
"""What a teacher is asked for, and the keys of the ranges that it can learn of it."""


def has_range(teacher: Teacher) -> bool:
    """Whether it learns to follow more than one command."""
    return any(getattr(teacher, of) is not None for of in COMMANDS.values())


@dataclass
class PPOTeacher(Teacher):
    """PPO on the reduced-order model (paper section 3.2)."""

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
    hidden_gain: float = key("gain of the orthogonal weights that hidden layers begin with", above=0, high=100)
    policy_gain: float = key(
        "gain of those that the policy's last layer begins with (the value network's: 1)", above=0, high=100
    )
    adam_epsilon: float = key("what Adam adds to the root of its second moment", low=1e-12, high=1)
    value_clip: float | None = key(
        "how far an update may move a value, in the unit of the value network, before its loss ends; null: no limit",
        above=0,
        high=1e6,
    )
    normalize_observation: bool = key(
        "true: observations are standardised by their running mean and deviation, and cut off at 5 of them"
    )
    normalize_return: bool = key(
        "true: the value network gives returns standardised by their running mean and deviation, cut off at 5 of them"
    )
    bootstrap_truncated: bool = key(
        "true: where time is up the value of the last observation stands for what would follow; false: nothing follows"
    )
    segment_steps: int | None = key(
        "steps over which advantages are summed up before a value stands for the rest; null: the whole rollout",
        low=1,
        high=1_000_000,
    )
    mirror: bool = key("true: half of each minibatch is left-right mirrored")
    cycles: str | None = key(
        "directory of a finished teacher by algorithm=cmaes, of the same rom and gait, on whose cycles episodes of the "
        "training begin, asked for what the cycle was; null: none",
        before=None,
    )
    cycle_resets: float = key("share of the episodes that begin there; the rest as ever", low=0, high=1, before=0.0)
    check_steps: int = key(
        "environment steps between two checks of the speed that the policy comes to in the long run, over the second "
        "half of a training; the last one that holds it within 3 % is kept, else the nearest; 0: none, the last "
        "one is kept",
        low=0,
        high=10**12,
    )


TEACHERS["ppo"] = PPOTeacher


def ppo_keys(teacher: Teacher) -> PPOTeacher:
    """The keys of a teacher that learns by PPO, as those that are asked for them do."""
    assert isinstance(teacher, PPOTeacher)
    return teacher


@dataclass
class CMAESTeacher(Teacher):
    """CMA-ES over a controller with a clock: cycles of a gait in seconds, without a gradient."""

    generations: int = key("generations of the search", low=1, high=1_000_000)
    scouts: int = key(
        "searches that begin: after the generations of short tries the best of them goes on", low=1, high=1000
    )
    population: int = key("controllers of a generation", low=4, high=10_000)
    rollouts: int = key(
        "worlds that each controller is tried in, at each speed, apex and stiffness that the search looks at",
        low=1,
        high=10_000,
    )
    search_steps: int = key(
        "control steps of a try; the first generations have a quarter and a half of them", low=40, high=10**6
    )
    apex_alpha: float = key(
        "sensitivity of what a jump earns to the distance of its apex from the one asked for",
        unit="1/m",
        above=0,
        high=1000,
        before=10.0,
    )
    drift_alpha: float = key(
        "sensitivity of what is earned to how far the mean speed of the second half of a try is from that of all of it",
        unit="s/m",
        low=0,
        high=1000,
        before=0.0,
    )
    limp_cost: float = key(
        "share of the reward that is lost by the deviation of the times between touchdowns, share of their mean",
        low=0,
        high=1000,
    )
    flight_cost: float = key(
        "share of the reward that is lost by the share of the time that the feet are off the ground too long, or not "
        "long enough, for the gait",
        low=0,
        high=1000,
    )
    degree: int = key(
        "degree of the polynomials of speed or apex that the parameters of a controller are, where one has a range; of "
        "stiffness they are linear",
        low=1,
        high=4,
        before=1,
    )
    spread: float = key("initial standard deviation of the search, share of that of each parameter", above=0, high=100)


TEACHERS["cmaes"] = CMAESTeacher
