"""Student and baseline: SAC on the planar humanoid, with or without the discriminator (paper section 3.3)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from pathlib import Path

import torch
from torch import Tensor

from romgrl.algorithms.divergence import check_physics, require_finite
from romgrl.algorithms.rom_grl import RomGrl
from romgrl.algorithms.sac import Metrics, Mirrors, save_sac_policy
from romgrl.algorithms.second_thread import second_lane, submit_or_run
from romgrl.artifacts.checkpoint import State
from romgrl.config.commanded import conditioned_keys, is_conditioned
from romgrl.config.schema import Config
from romgrl.gait.discriminator_windows import FrameWindows, WindowLayout
from romgrl.humanoid.model import identity
from romgrl.humanoid.reference_states import ReferenceStates
from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv
from romgrl.runtime.stage_log import StageLog
from romgrl.stages.conditioned.cells import read_command_cells
from romgrl.stages.conditioned.command_watch import CommandWatch
from romgrl.stages.conditioned.commanded_frames import CommandedFrames
from romgrl.stages.conditioned.conditioned_learner import build_conditioned_learner
from romgrl.stages.conditioned.curriculum import Curriculum
from romgrl.stages.conditioned.grid_check import GridChecks
from romgrl.stages.training.budget import Budget, over_the_middle
from romgrl.stages.training.checkpoints import Stateful, TrainingCheckpoints
from romgrl.stages.training.discriminator_watch import HealthWatch
from romgrl.stages.training.gait_check import GaitChecks
from romgrl.stages.training.student_statistics import StudentTally
from romgrl.stages.wiring.humanoid import humanoid_env
from romgrl.stages.wiring.imitated import read_imitated
from romgrl.stages.wiring.student_learner import build_student_learner

LOG_INTERVAL = 4096


@dataclass
class StudentLoop:
    """What one pass of the training loop hands to the next."""

    observation: Tensor
    due: float = 0.0  # updates, less than one
    metrics: Metrics = field(default_factory=dict)

    def numbers(self) -> dict[str, float]:
        """The metrics, sorted as a checkpoint has them: a resumed training goes on with the same columns."""
        return {name: float(self.metrics[name]) for name in sorted(self.metrics)}

    def state(self) -> State:
        """Everything that `restore` needs."""
        return dict(vars(self))

    def restore(self, state: State) -> None:
        """Go on from a state."""
        vars(self).update(state)


@dataclass
class StudentTraining:
    """What a training works with.

    speed: what its health is judged by, m/s; mirrors: of its policy; follows: what a student does of the commands that
    it is asked for, None: there are none.
    """

    env: PlanarHumanoidVectorEnv
    windows: FrameWindows
    learner: RomGrl
    checks: GaitChecks | GridChecks
    mirrors: Mirrors | None
    speed: float
    follows: CommandWatch | None = None


def run(config: Config, inputs: Mapping[str, Path], output: Path, log: StageLog) -> None:
    """Train a student (inputs: reference) or, with eta = 1 and no discriminator, a baseline; write its policy.

    A conditioned one has a library in the place of the reference, and so has its baseline.

    With two threads or more, physics runs beside the updates; where critics and policy take their gradients
    simultaneously, physics and policy have one half of the threads and the critics the other.
    """
    beside = config.threads > 1
    each = config.threads // 2 if beside and config.student.simultaneous else config.threads
    torch.set_num_threads(each)
    with second_lane(beside) as lane:
        if is_conditioned(config):
            training = conditioned_training(config, inputs["library"], output, log, lane, threads=each)
        else:
            training = one_speed_training(config, inputs.get("reference"), output, log, lane, threads=each)
        env, learner = training.env, training.learner
        columns, humanoid = torch.from_numpy(env.columns), identity(env.model)

        def save(moments: tuple[Tensor, Tensor] | None = None) -> None:
            mean_and_scale = moments or learner.normalizer.mean_and_scale()
            path, names = output / "policy.safetensors", env.observation_names
            save_sac_policy(path, learner.sac, columns, *mean_and_scale, humanoid, names, training.mirrors)

        train_student(config, training, log, output, save)
        save(training.checks.keep_best(learner))


def one_speed_training(
    config: Config, reference: Path | None, output: Path, log: StageLog, lane: Executor | None, *, threads: int
) -> StudentTraining:
    """Of a student that holds a speed; `threads`: of its physics."""
    env = humanoid_env(
        replace(config, threads=threads),
        num_envs=config.student.num_envs,
        posture_weight=config.student.posture_weight,
        compact=config.student.compact_observation,
    )
    windows = FrameWindows(num_envs=env.num_envs, layout=window_layout(config))
    if reference is not None and config.student.reference_resets > 0:
        start_from_reference(config, env, reference)
    learner, mirrors = build_student_learner(config, env, windows.layout, reference, lane), policy_mirrors(config, env)
    checks = GaitChecks.of(config, reference, torch.from_numpy(env.columns), mirrors, output, log)
    return StudentTraining(env, windows, learner, checks, mirrors, config.speed)


def conditioned_training(
    config: Config, library: Path, output: Path, log: StageLog, lane: Executor | None, *, threads: int
) -> StudentTraining:
    """Of a student that follows commands; `threads`: of its physics."""
    layout = window_layout(config)
    cells = read_command_cells(library, config, span=layout.span)
    student = conditioned_keys(config.student)
    curriculum = Curriculum(student, cells, student.alpha, student.num_envs)
    env = humanoid_env(
        replace(config, threads=threads),
        num_envs=student.num_envs,
        posture_weight=student.posture_weight,
        compact=student.compact_observation,
        commands=curriculum.schedule,
    )
    if student.reference_resets > 0:
        env.start_from(cells.states(env.model), student.reference_resets)
    windows = CommandedFrames(num_envs=env.num_envs, layout=layout)
    learner, mirrors = build_conditioned_learner(config, env, layout, cells, lane), policy_mirrors(config, env)
    curriculum.tell(learner.relabelling.ranges)
    checks = GridChecks.of(config, cells, torch.from_numpy(env.columns), mirrors, output, log)
    watch = CommandWatch(config, cells, curriculum, learner, output, log)
    return StudentTraining(env, windows, learner, checks, mirrors, float(cells.ranges.mean()), watch)


def policy_mirrors(config: Config, env: PlanarHumanoidVectorEnv) -> Mirrors | None:
    """Those of a policy that treats left and right alike; None: it may not."""
    if not config.student.mirror:
        return None
    return Mirrors(env.mirror_observation.tensors(), env.mirror_action.tensors())


def start_from_reference(config: Config, env: PlanarHumanoidVectorEnv, reference: Path) -> None:
    """Let a share of the episodes begin in poses of the reference."""
    arrays = read_imitated(reference, config, steps=4)
    states = ReferenceStates(env.model, arrays["features"], arrays["episode"], env.control_step)
    env.start_from(states, config.student.reference_resets)


def window_layout(config: Config) -> WindowLayout:
    """What the discriminator sees."""
    seen, dt = config.discriminator, 1 / config.humanoid.control_frequency
    return WindowLayout(seen.features, seen.window, seen.stride, dt)


def train_student(
    config: Config, training: StudentTraining, log: StageLog, output: Path, save: Callable[[], None]
) -> None:
    """Act, step and learn: the physics of a step runs beside the updates, which use what was stored before it."""
    student, device = config.student, config.device
    env, windows, learner, checks = training.env, training.windows, training.learner, training.checks
    frame, follows = windows.frame, training.follows
    tally = StudentTally(env.num_envs, config.humanoid.control_frequency)
    observation, info = env.reset(seed=config.seed)
    windows.restart(frame(info))
    loop = StudentLoop(torch.from_numpy(observation).to(device))
    health = HealthWatch(replace(config, speed=training.speed), output, log)
    budget = Budget(student.total_steps, student.minutes)
    parts: dict[str, Stateful] = {"env": env, "windows": windows, "learner": learner, "checks": checks}
    parts |= {"follows": follows} if follows is not None else {}
    checkpoints = TrainingCheckpoints(
        output,
        parts | {"loop": loop, "tally": tally, "health": health, "budget": budget},
        ring=learner.buffer,
        save_policy=save,
        seconds=config.checkpoint_seconds,
        total=lambda: budget.end,
        log=log,
    )
    step = checkpoints.resume()
    budget.start()
    with checkpoints.deferring_signals("student"):
        while not budget.reached(step):
            action = explore(learner, loop.observation, env, random=step < student.learning_starts)
            stepped = submit_or_run(learner.sac.lane, env.step, action.cpu().numpy())
            if step >= student.learning_starts:
                loop.due += student.updates_per_step * env.num_envs
                if student.learning_rate_decay:
                    learner.scale_learning_rates(min(1.0, 2 * (1 - budget.share(step))))
                scales = student.target_entropy_scale, student.final_entropy_scale
                learner.sac.scale_target_entropy(over_the_middle(*scales, budget.share(step)))
                loop.metrics |= learner.update(int(loop.due)) if loop.due >= 1 else {}
                loop.due -= int(loop.due)
            updated = learner.start_discriminator()
            observation, reward, terminated, truncated, info = stepped()
            check_physics(info["diverged"])
            require_finite(observation=observation, reward=reward)
            following = torch.from_numpy(observation).to(device)
            seen = torch.from_numpy(windows.push(frame(info)))
            earned, fell, cut = (torch.from_numpy(values) for values in (reward, terminated, truncated))
            imitation = learner.collected_reward(seen, updated)
            learner.buffer.add(loop.observation, action, following, earned, fell, cut, seen, imitation)
            learner.normalizer.update(following)
            finished = terminated | truncated
            windows.restart(frame(info, "reset_"), finished)
            tally.add(info, terminated, finished)
            if follows is not None:
                follows.take(info)
            loop.observation = following
            loop.metrics |= updated()
            step += env.num_envs
            budget.tick()
            if step % LOG_INTERVAL < env.num_envs or budget.reached(step):
                seen_of_commands = {} if follows is None else follows.review(step, budget.share(step))
                tell(log, loop, tally, learner, health, step, budget, seen_of_commands)
            if learner.just_stopped():
                log.message(f"the discriminator stopped at step {step:,}: no better on held-out windows")
            checks.check_if_due(step, learner, budget)
            checkpoints.save_if_due(step)


def tell(
    log: StageLog,
    loop: StudentLoop,
    tally: StudentTally,
    learner: RomGrl,
    health: HealthWatch,
    step: int,
    budget: Budget,
    more: Mapping[str, float],
) -> None:
    """Write a row of the learning curve, with `more`, and say what is wrong with the discriminator; at the end, what
    was used."""
    values = loop.numbers() | tally.take() | learner.counts() | learner.measures(LOG_INTERVAL) | dict(more)
    log.metrics(values, step)
    log.progress(step, budget.expected_steps(step), speed=values["speed"], episode=values["episode_seconds"])
    health.add(values, step, learner.eta)
    if budget.minutes is not None and budget.reached(step):
        log.message(budget.summary(step))


def explore(learner: RomGrl, current: Tensor, env: PlanarHumanoidVectorEnv, *, random: bool) -> Tensor:
    """Actions (N, A) of the exploring policy, uniform ones before learning starts."""
    if random:
        return 2 * torch.rand((env.num_envs, env.model.nu), generator=learner.sac.generator, device=current.device) - 1
    return learner.sac.act(learner.normalizer.apply_(current.clone()))
