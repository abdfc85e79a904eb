"""Student and baseline: SAC on the planar humanoid, with or without the discriminator (paper section 3.3)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import torch
from torch import Tensor

from romgrl.algorithms.divergence import check_physics, require_finite
from romgrl.algorithms.rom_grl import RomGrl
from romgrl.algorithms.sac import Metrics, Mirrors, save_sac_policy
from romgrl.algorithms.second_thread import second_lane, submit_or_run
from romgrl.artifacts.checkpoint import State
from romgrl.config.schema import Config
from romgrl.gait.discriminator_windows import FrameWindows, WindowLayout
from romgrl.humanoid.model import identity
from romgrl.humanoid.reference_states import ReferenceStates
from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv
from romgrl.runtime.stage_log import StageLog
from romgrl.stages.training.budget import Budget
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


def run(config: Config, inputs: Mapping[str, Path], output: Path, log: StageLog) -> None:
    """Train a student (inputs: reference) or, with eta = 1 and no discriminator, a baseline; write its policy.

    With two threads or more, physics runs beside the updates; where critics and policy take their gradients
    simultaneously, physics and policy have one half of the threads and the critics the other.
    """
    beside = config.threads > 1
    each = config.threads // 2 if beside and config.student.simultaneous else config.threads
    torch.set_num_threads(each)
    env = humanoid_env(
        replace(config, threads=each),
        num_envs=config.student.num_envs,
        posture_weight=config.student.posture_weight,
        compact=config.student.compact_observation,
    )
    columns = torch.from_numpy(env.columns)
    windows = FrameWindows(num_envs=env.num_envs, layout=window_layout(config))
    humanoid = identity(env.model)
    if "reference" in inputs and config.student.reference_resets > 0:
        start_from_reference(config, env, inputs["reference"])
    with second_lane(beside) as lane:
        learner = build_student_learner(config, env, windows.layout, inputs.get("reference"), lane)

        mirrors = (
            Mirrors(env.mirror_observation.tensors(), env.mirror_action.tensors()) if config.student.mirror else None
        )
        checks = GaitChecks.of(config, inputs.get("reference"), columns, mirrors, output, log)

        def save(moments: tuple[Tensor, Tensor] | None = None) -> None:
            mean_and_scale = moments or learner.normalizer.mean_and_scale()
            path = output / "policy.safetensors"
            save_sac_policy(path, learner.sac, columns, *mean_and_scale, humanoid, env.observation_names, mirrors)

        train_student(config, env, windows, learner, checks, log, output, save)
        save(checks.keep_best(learner))


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
    config: Config,
    env: PlanarHumanoidVectorEnv,
    windows: FrameWindows,
    learner: RomGrl,
    checks: GaitChecks,
    log: StageLog,
    output: Path,
    save: Callable[[], None],
) -> None:
    """Act, step and learn: the physics of a step runs beside the updates, which use what was stored before it."""
    student, device = config.student, config.device
    frame = windows.layout.frame
    tally = StudentTally(env.num_envs, config.humanoid.control_frequency)
    observation, info = env.reset(seed=config.seed)
    windows.restart(frame(info))
    loop = StudentLoop(torch.from_numpy(observation).to(device))
    health = HealthWatch(config, output, log)
    budget = Budget(student.total_steps, student.minutes)
    parts: dict[str, Stateful] = {"env": env, "windows": windows, "learner": learner, "checks": checks}
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
                learner.sac.scale_target_entropy(entropy_scale(config, budget.share(step)))
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
            loop.observation = following
            loop.metrics |= updated()
            step += env.num_envs
            budget.tick()
            if step % LOG_INTERVAL < env.num_envs or budget.reached(step):
                tell(log, loop, tally, learner, health, step, budget)
            if learner.just_stopped():
                log.message(f"the discriminator stopped at step {step:,}: no better on held-out windows")
            checks.check_if_due(step, learner, budget)
            checkpoints.save_if_due(step)


def entropy_scale(config: Config, share: float) -> float:
    """Target entropy over - number of actions at a share of the training: straight over its middle half."""
    student = config.student
    first, last = student.target_entropy_scale, student.final_entropy_scale
    return first if last is None else first + (last - first) * min(1.0, max(0.0, 2 * share - 0.5))


def tell(
    log: StageLog,
    loop: StudentLoop,
    tally: StudentTally,
    learner: RomGrl,
    health: HealthWatch,
    step: int,
    budget: Budget,
) -> None:
    """Write a row of the learning curve, and say what is wrong with the discriminator; at the end, what was used."""
    values = loop.numbers() | tally.take() | learner.counts() | learner.measures(LOG_INTERVAL)
    log.metrics(values, step)
    log.progress(step, budget.expected_steps(step), speed=values["speed"], episode=values["episode_seconds"])
    health.add(values, step)
    if budget.minutes is not None and budget.reached(step):
        log.message(budget.summary(step))


def explore(learner: RomGrl, current: Tensor, env: PlanarHumanoidVectorEnv, *, random: bool) -> Tensor:
    """Actions (N, A) of the exploring policy, uniform ones before learning starts."""
    if random:
        return 2 * torch.rand((env.num_envs, env.model.nu), generator=learner.sac.generator, device=current.device) - 1
    return learner.sac.act(learner.normalizer.apply_(current.clone()))
