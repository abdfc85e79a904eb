"""Keys of the student and of the discriminator."""

from __future__ import annotations

from dataclasses import dataclass

from romgrl.config.fields import key

LABELLED, CRITICS = ("bce", "least_squares"), ("wasserstein",)  # losses; only a penalty bounds a critic


@dataclass
class Student:
    """SAC on the humanoid (paper section 3.3); the baseline is the same with eta = 1 and no discriminator."""

    name: str = key("what it is called; not given: as its preset")
    kind: str = key(
        "what it is asked for, one_speed: to hold speed; conditioned: to follow commands over the cells of a library, "
        "which its policy sees",
        choices=("one_speed", "conditioned"),
        before="one_speed",
    )
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
    updates_per_step: float = key("critic updates per environment step", low=1e-6, high=1000)
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
        "not below a value that rises to 0.5; each cell for itself where the student follows commands"
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
    pretrained: bool = key(
        "true: nothing is trained; student and baseline that ship with the package are taken, and with "
        "kind=conditioned the library of the student, too"
    )


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
