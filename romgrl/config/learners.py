"""Keys of those that learn: teacher, student and discriminator."""

from __future__ import annotations

from dataclasses import dataclass

from romgrl.config.fields import key

LONG_RUN = 1_000  # control steps over which a teacher is watched: 33 s, after which runs are steady
LABELLED, CRITICS = ("bce", "least_squares"), ("wasserstein",)  # losses; only a penalty bounds a critic


@dataclass
class Teacher:
    """PPO on the reduced-order model (paper section 3.2)."""

    name: str = key("what it is called; not given: as its preset")
    speed: float = key("target speed of the teacher", unit="m/s", low=0, high=10)
    speeds: list[float] | None = key(
        "range of the speeds that worlds are asked for in a training, each episode another, for a teacher of any of "
        "them; null: speed alone",
        unit="m/s",
        low=0,
        high=10,
        span=True,
        before=None,
    )
    stiffness_share: float = key(
        "stiffness of the legs that is asked for, share of rom.stiffness", low=0.1, high=10, before=1.0
    )
    stiffness_shares: list[float] | None = key(
        "range of it that worlds have in a training, each episode another; null: stiffness_share alone",
        low=0.1,
        high=10,
        span=True,
        before=None,
    )
    command_steps: int = key(
        "control steps after which a world is asked for another speed and stiffness; 0: not within an episode",
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
    check_steps: int = key(
        "environment steps between two checks of the speed that the policy comes to in the long run, over the second "
        "half of a training; the last one that holds it within 3 % is kept, else the nearest; 0: none, the last "
        "one is kept",
        low=0,
        high=10**12,
    )
    pretrained: bool = key("true: nothing is trained; the teacher that ships with the package is taken")


@dataclass
class Student:
    """SAC on the humanoid (paper section 3.3); the baseline is the same with eta = 1 and no discriminator."""

    name: str = key("what it is called; not given: as its preset")
    alpha: float | None = key(
        "sensitivity of the velocity reward; null: 4 over the target speed, so that a relative error counts the same "
        "at all speeds (1 at 4 m/s, the paper's)",
        unit="s/m",
        low=1e-9,
        high=1e6,
    )
    total_steps: int = key("environment steps (at most, with minutes)", low=1, high=10**12)
    minutes: float | None = key(
        "wall time of training after which student and baseline each stop, or at total_steps where that is sooner; "
        "learning rates follow the nearer end; not reproducible bit by bit; null: no limit",
        unit="min",
        above=0,
        high=1e6,
    )
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
    initial_log_std: float | None = key(
        "log standard deviation of the first policy, before the tanh; null: as its network begins, about -1.5",
        low=-4.9,
        high=1.9,
    )
    target_entropy_scale: float = key("target entropy = - this x number of actions", above=0, high=1000)
    final_entropy_scale: float | None = key(
        "target_entropy_scale moves to this over the middle half of a training, so that what is learned at the end "
        "holds for the mean action, which is kept; null: it stays",
        above=0,
        high=1000,
    )
    learning_rate_decay: bool = key("true: all learning rates fall linearly to zero over the second half")
    gamma: float = key("discount factor", above=0, high=1)
    n_steps: int = key(
        "steps whose rewards a critic's target sums up before the value of the state that follows", low=1, high=32
    )
    tau: float = key("share of the critics copied into their targets at each update", above=0, high=1)
    policy_delay: int = key("critic updates from one time that the policy is due to the next", low=1, high=10**6)
    policy_updates: int = key(
        "policy and temperature updates in a row when they are due; more than 1: simultaneous=false", low=1, high=1000
    )
    simultaneous: bool = key(
        "true: policy and critics take their gradients at the same point, on two threads; false: critics first"
    )
    critic_target: str = key("how the twin target critics are joined", choices=("minimum", "mean"))
    mirror: bool = key("true: half of each batch is left-right mirrored")
    normalize_observation: bool = key("true: observations are standardised by their running mean and deviation")
    check_steps: int = key(
        "environment steps between two checks of the gait, the best policy of which is kept; 0: none, the last one is "
        "kept",
        low=0,
        high=10**12,
    )
    end_early: bool = key(
        "true: the second half of a training, over which learning rates fall, begins once the gait has passed two "
        "checks in a row"
    )
    adapt_eta: bool = key(
        "true: from a third of the steps on eta follows the checks of a student that stays upright: up where it is too "
        "slow, or speed and cadence are off together; down where the cadence or a speed that is too high is off alone; "
        "not below a value that rises to 0.5"
    )
    second_try: bool = key(
        "true: a student that has passed no check, and from 0.6 of its steps on falls in most episodes, or has another "
        "stride or none and is no nearer to the reference than a statue, makes the steps from 0.32 on again, once; not "
        "where minutes are set"
    )
    kept_policy: str = key(
        "which check's policy is kept, reference: the one nearest to the reference at the right speed; task_reward: "
        "that of the largest reward for its speed; last: the last one",
        choices=("reference", "task_reward", "last"),
    )
    posture_weight: float = key(
        "share of the task reward that is for an upright trunk and a high pelvis instead of the speed", low=0, high=1
    )
    reference_resets: float = key("share of a student's episodes that start in a pose of the reference", low=0, high=1)
    policy_average: float = key("policies are running averages with this decay; 0: as they are", low=0, high=0.99999)
    pretrained: bool = key("true: nothing is trained; student and baseline that ship with the package are taken")


@dataclass
class Discriminator:
    """Adversarial discriminator of the gait (paper section 3.3)."""

    name: str = key("what it is called; not given: as its preset")
    enabled: bool = key("false: no imitation; the student is the baseline, whatever eta and noise are")
    features: str = key(
        "what a frame holds, paper: the five; trunk: the trunk inclination as well; trunk_soles: also the heights of "
        "both soles; velocities: the five and their velocities; trunk_velocities: the five, the trunk and velocities",
        choices=("paper", "trunk", "trunk_soles", "velocities", "trunk_velocities"),
    )
    imitated: str = key(
        "what is imitated, teacher: its paths; sinusoid: cosines of their mean, cadence and amplitudes in their place",
        choices=("teacher", "sinusoid"),
    )
    window: int = key("frames seen together", low=1, high=32)
    stride: int = key("control steps from one frame of a window to the next", low=1, high=32)
    sole_weight: float = key(
        "what the discriminator sees of the heights of the soles, times this; the noise stays: below 1 they count less",
        low=0,
        high=100,
    )
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
    trunk_time: float | None = key(
        "time after which that inclination's correlation is 1/e; null: one inclination for all of a window",
        unit="s",
        above=0,
        high=1000,
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
    accuracy: float | None = key(
        "the noise follows so that this share of both streams is told apart; null: it stays as it is", above=0.5, high=1
    )
    held_out: float = key("share of the reference held out for the validation loss", above=0, high=0.9)
    patience: int | None = key(
        "updates in a row without progress on the held-out windows before training stops; null: never",
        low=1,
        high=10**9,
    )
    early_stop: str = key(
        "what makes progress, held_out: a new lowest loss of held-out windows (the paper's words); gap: that loss "
        "stays near the one of the windows that are learned from",
        choices=("held_out", "gap"),
    )
