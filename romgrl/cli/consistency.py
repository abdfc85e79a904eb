"""What must fit together in a configuration, and on this machine; told before any work.

Every check is a generator of lines beside the keys that it reads: it is left out where one of them is bad already.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

from omegaconf import OmegaConf

from romgrl.cli.conditioned_students import CONDITIONED_CHECKS
from romgrl.cli.config_files import CONF
from romgrl.cli.cycle_resets import CYCLE_CHECKS
from romgrl.cli.locations import is_file, is_readable, outputs_directory, tracking_store
from romgrl.cli.onnx_installed import onnx_installed
from romgrl.cli.other_libraries import OTHER_LIBRARIES_KEYS, other_libraries
from romgrl.cli.reduced_order_models import ROM_KEYS, reduced_order_model
from romgrl.cli.specialists import GRID_CHECKS
from romgrl.cli.teacher_ranges import RANGE_CHECKS
from romgrl.config.learners import CRITICS
from romgrl.config.schema import Config
from romgrl.config.teachers import LONG_RUN, PPOTeacher
from romgrl.config.values import bad_value, fits, keys_of, refusal, schema_keys, show, suggestion, value_of
from romgrl.config.worlds import SKELETONS
from romgrl.errors import ArtifactError, ConfigurationError

PLAIN = "student"  # what `comparison` is called where nothing stands in the student's place
FEWEST_ROWS = 4  # of the replay buffer, which keeps two of them free


def validate(config: Config) -> None:
    """Raise ConfigurationError with one line per bad key; called before any directory, run or training is made."""
    lines = {key: bad_value(key, value_of(config, key)) for key in unfit_keys(config)}
    problems = [*lines.values(), *misfits(config, lines)]
    if problems:
        raise ConfigurationError("\n".join(problems))


def unfit_keys(config: Config) -> list[str]:
    """The keys whose values do not have their type or lie outside their range."""
    return [key for key, entry in keys_of(config).items() if not fits(value_of(config, key), entry)]


def misfits(config: Config, bad: Collection[str] = ()) -> Iterator[str]:
    """Yield a line for each key that does not fit to others or to this machine, among the keys that are not `bad`."""
    told = set(bad)
    for keys, check in CHECKS:
        for line in [] if told & set(keys) else [*check(config)]:
            key = line.partition(":")[0]
            if key not in told:
                yield line
            told.add(key)


def levels(config: Config) -> Iterator[str]:
    """The levels of a disturbance rise, so that each is there once."""
    for key in LEVELS:
        value = value_of(config, key)
        if any(one >= other for one, other in pairwise(value)):
            yield refusal(key, value, "numbers in rising order")


def at_most(key: str, bound: str) -> tuple[tuple[str, str], Callable[[Config], Iterator[str]]]:
    """The check that one key is not larger than another."""

    def check(config: Config) -> Iterator[str]:
        if value_of(config, key) > value_of(config, bound):
            yield refusal(key, value_of(config, key), f"at most {bound} = {value_of(config, bound)}")

    return (key, bound), check


def warmup(config: Config) -> Iterator[str]:
    """A reference begins while the teacher is watched: nobody has seen what it does later."""
    if config.reference.warmup_steps > LONG_RUN:
        yield refusal("reference.warmup_steps", config.reference.warmup_steps, f"at most {LONG_RUN}")


def segment_within_rollout(config: Config) -> Iterator[str]:
    """A segment lies within a rollout."""
    teacher = config.teacher
    if not isinstance(teacher, PPOTeacher):
        return
    if teacher.segment_steps is not None and teacher.segment_steps > teacher.rollout_steps:
        permitted = f"at most teacher.rollout_steps = {teacher.rollout_steps}, or null"
        yield refusal("teacher.segment_steps", teacher.segment_steps, permitted)


def rollout(config: Config) -> Iterator[str]:
    """PPO's rollout has a spread of advantages, and holds a minibatch."""
    teacher = config.teacher
    if not isinstance(teacher, PPOTeacher):
        return
    size = teacher.num_envs * teacher.rollout_steps
    if size < 2:
        yield refusal("teacher.rollout_steps", teacher.rollout_steps, "at least 2 where teacher.num_envs = 1")
    elif teacher.minibatch_size > size:
        permitted = f"at most teacher.num_envs x teacher.rollout_steps = {size}"
        yield refusal("teacher.minibatch_size", teacher.minibatch_size, permitted)


def replay_buffer(config: Config) -> Iterator[str]:
    """The replay buffer holds a few steps of all humanoids, two of them before the first update."""
    student = config.student
    if student.buffer_size < FEWEST_ROWS * student.num_envs:
        permitted = f"at least {FEWEST_ROWS} x student.num_envs = {FEWEST_ROWS * student.num_envs}"
        yield refusal("student.buffer_size", student.buffer_size, permitted)
    first_update = math.ceil(student.learning_starts / student.num_envs)
    first_update += math.ceil(1 / (student.updates_per_step * student.num_envs)) - 1
    if first_update < 2:
        permitted = f"more than student.num_envs = {student.num_envs}, so that there is something to learn from"
        yield refusal("student.learning_starts", student.learning_starts, permitted)


def comparison(config: Config) -> Iterator[str]:
    """What stands in the student's place is what its preset says, and trained: it has the name in every table."""
    name = config.comparison
    if name != PLAIN and config.student.pretrained:
        yield refusal("comparison", name, f"{PLAIN} with student.pretrained=true")
    elif name != PLAIN and config.stage == "verify":
        yield refusal("comparison", name, f"{PLAIN} with stage=verify: the paper claims nothing of others")
    else:
        preset = preset_values(name)
        imitates = config.discriminator.enabled and config.eta < 1
        if name != PLAIN and preset and "eta" not in preset and not imitates:
            yield refusal("comparison", name, f"{PLAIN} without imitation (eta=1 or discriminator=none)")
        for key, value in preset.items():
            if value_of(config, key) != value:
                yield refusal(key, value_of(config, key), f"{show(value)} with comparison={name}")


@cache
def preset_values(name: str) -> dict[str, Any]:
    """The keys that a comparison of ours sets, with their values; none of a user's own."""
    path = CONF / "comparison" / f"{name}.yaml"
    values = OmegaConf.load(path) if Path(name).name == name and path.is_file() else OmegaConf.create()
    return {key: OmegaConf.select(values, key) for key in schema_keys() if OmegaConf.select(values, key) is not None}


def policy_updates(config: Config) -> Iterator[str]:
    """Of several policy updates in a row only one could be taken at the same point as that of the critics."""
    student = config.student
    if student.simultaneous and student.policy_updates > 1:
        yield refusal("student.policy_updates", student.policy_updates, "1 with student.simultaneous=true")


def reference_episodes(config: Config) -> list[int]:
    """Steps of each episode of the reference."""
    longest, left = math.ceil(config.reference.steps / config.reference.episodes), config.reference.steps
    full, rest = divmod(left, longest)
    return [longest] * full + ([rest] if rest else [])


def scored_window(config: Config) -> Iterator[str]:
    """An episode of the reference is as long as what is scored."""
    longest = reference_episodes(config)[0]
    if config.evaluation.window > longest:
        permitted = f"at most reference.steps / reference.episodes = {longest}"
        yield refusal("evaluation.window", config.evaluation.window, permitted)


def discriminator_windows(config: Config) -> Iterator[str]:
    """The reference has windows for the discriminator, some to learn from and one to be held out at least."""
    from romgrl.gait.discriminator_windows import WindowLayout

    discriminator, episodes = config.discriminator, reference_episodes(config)
    if not discriminator.enabled:
        return
    span = WindowLayout(discriminator.features, discriminator.window, discriminator.stride).span
    if span > episodes[0]:
        permitted = f"windows of at most reference.steps / reference.episodes = {episodes[0]} control steps, not {span}"
        yield refusal("discriminator.window", discriminator.window, permitted)
        return
    windows = sum(max(0, steps - span + 1) for steps in episodes) * (2 if config.student.mirror else 1)
    if max(1, round(windows * (1 - discriminator.held_out))) >= windows:
        permitted = f"a share of the reference's {windows} windows that holds at least one"
        yield refusal("discriminator.held_out", discriminator.held_out, permitted)


def critic(config: Config) -> Iterator[str]:
    """Nothing but the penalty keeps a Wasserstein critic from growing without end."""
    discriminator = config.discriminator
    if discriminator.enabled and discriminator.loss in CRITICS and discriminator.gradient_penalty == 0:
        yield refusal("discriminator.gradient_penalty", 0, f"more than 0 with discriminator.loss={discriminator.loss}")


def humanoid_file(config: Config) -> Iterator[str]:
    """The file of the humanoid is one; MuJoCo is imported only where there is one to read."""
    humanoid, name = config.humanoid, config.humanoid.skeleton
    if humanoid.xml is None:
        if name != SKELETONS[0]:
            from romgrl.humanoid.skeleton import without_file

            yield without_file(name)
    elif not is_file(humanoid.xml):
        yield refusal("humanoid.xml", humanoid.xml, "a MuJoCo file that exists")
    elif not is_readable(humanoid.xml):
        yield refusal("humanoid.xml", humanoid.xml, "a file that can be read")
    else:
        from romgrl.humanoid import model, skeleton
        from romgrl.humanoid.process_settings import set_up_mujoco

        set_up_mujoco()
        try:
            model.build(xml=humanoid.xml, actuation=humanoid.actuation, skeleton=skeleton.SKELETONS[name])
        except ConfigurationError as error:
            reason = str(error).removeprefix("humanoid.xml: ")
            yield refusal("humanoid.xml", humanoid.xml, f"a MuJoCo file with the bodies of {name} ({reason})")


def pretrained(config: Config) -> Iterator[str]:
    """What ships with the package is run with the settings of its training; where it is damaged, the job says so."""
    from romgrl.provenance.shipped import follows_shipped, other_settings, shipped_stages

    if config.student.pretrained and not config.teacher.pretrained and not follows_shipped(config):
        yield refusal("teacher.pretrained", False, "true where student.pretrained is true")
    told = set()
    for stage in shipped_stages(config):
        try:
            differing = [*other_settings(stage, config)]
        except ArtifactError:
            return
        for key, value, trained in differing:
            if key not in told:
                yield refusal(key, value, f"{show(trained)}, as the pretrained {stage} was trained")
            told.add(key)


def objective_faults(config: Config, bad: Collection[str] = ()) -> Iterator[str]:
    """What a search is after is a number of its jobs; asked of searches alone, among keys that are not `bad`."""
    if "stage" in bad or "objective" in bad:
        return
    from romgrl.report.objective import SEARCHED, objective_names

    names = objective_names(config.stage, config.student.kind)
    if not names:
        yield refusal("stage", config.stage, f"{', '.join(SEARCHED)}, whose numbers a search can be after")
    elif config.objective not in names:
        near = suggestion(config.objective, names)
        yield refusal("objective", config.objective, f"a number of stage={config.stage}, such as {names[0]}{near}")


def device(config: Config) -> Iterator[str]:
    """A CUDA device is there where one is asked for."""
    if config.device == "cuda" and not cuda_available():
        yield refusal("device", "cuda", "cpu (no CUDA device was found)")


def cuda_available() -> bool:
    """Ask torch for a CUDA device; imported only when one is asked for."""
    import torch

    return torch.cuda.is_available()


LEVELS = ("robustness.push_impulse", "robustness.observation_noise", "robustness.mass", "robustness.friction")
REPLAY = ("student.buffer_size", "student.num_envs", "student.learning_starts", "student.updates_per_step")
REFERENCE = ("reference.steps", "reference.episodes")
DISCRIMINATOR_WINDOW = ("discriminator.features", "discriminator.window", "discriminator.stride")
DISCRIMINATOR = ("discriminator.enabled", *DISCRIMINATOR_WINDOW, "discriminator.held_out", "student.mirror")
COMPARED = ("comparison", "stage", "student.pretrained", "eta", "discriminator.enabled")
CRITIC = ("discriminator.enabled", "discriminator.loss", "discriminator.gradient_penalty")
UNUSED_BY_SHIPPED = ("student.", "discriminator.", "reference.", "evaluation.", "robustness.", "tracking.", "paths.")
PRETRAINED = ("student.pretrained", *(key for key in schema_keys() if not key.startswith(UNUSED_BY_SHIPPED)))
CHECKS: tuple[tuple[tuple[str, ...], Callable[[Config], Iterator[str]]], ...] = (
    (LEVELS, levels),
    at_most("robustness.push_duration", "robustness.horizon"),
    at_most("student.batch_size", "student.buffer_size"),
    at_most("student.learning_starts", "student.total_steps"),
    at_most("evaluation.window", "evaluation.steps"),
    (("reference.warmup_steps",), warmup),
    at_most("reference.episodes", "reference.steps"),
    (("teacher.num_envs", "teacher.rollout_steps", "teacher.minibatch_size"), rollout),
    (("teacher.segment_steps", "teacher.rollout_steps"), segment_within_rollout),
    *RANGE_CHECKS,
    (OTHER_LIBRARIES_KEYS, other_libraries),
    (REPLAY, replay_buffer),
    (("student.policy_updates", "student.simultaneous"), policy_updates),
    (COMPARED, comparison),
    ((*REFERENCE, "evaluation.window"), scored_window),
    ((*REFERENCE, *DISCRIMINATOR), discriminator_windows),
    (CRITIC, critic),
    *CONDITIONED_CHECKS,
    *GRID_CHECKS,
    (ROM_KEYS, reduced_order_model),
    (("humanoid.xml", "humanoid.skeleton", "humanoid.actuation"), humanoid_file),
    *CYCLE_CHECKS,
    (("paths.outputs",), outputs_directory),
    (("tracking.enabled", "tracking.uri", "tracking.experiment", "paths.outputs"), tracking_store),
    (PRETRAINED, pretrained),
    (("device",), device),
    (("stage",), onnx_installed),
)
