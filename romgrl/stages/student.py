"""Student and baseline: SAC on the planar humanoid, with or without the discriminator (paper section 3.3)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from romgrl.algorithms.discriminator import Discriminator
from romgrl.algorithms.rom_grl import RomGrl
from romgrl.algorithms.sac import SAC, Metrics, save_policy
from romgrl.buffers import Mirror, ReplayBuffer
from romgrl.checkpoint import State
from romgrl.config import Config
from romgrl.gait.windows import FrameWindows, WindowLayout, reference_windows
from romgrl.humanoid.imitation import reference_bank
from romgrl.humanoid.model import fingerprint
from romgrl.humanoid.observation import OBSERVATION_SIZE
from romgrl.humanoid.reset import BANK_SIZE
from romgrl.humanoid.skeleton import HINGES
from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv
from romgrl.lanes import second_lane, start
from romgrl.limits import check, check_physics
from romgrl.normalizer import RunningNormalizer
from romgrl.progress import StageLog
from romgrl.stages.health import HealthWatch
from romgrl.stages.inputs import read_reference
from romgrl.stages.keeper import Keeper
from romgrl.stages.tally import EpisodeTally
from romgrl.stages.walkers import humanoid_env

ArrayMirror = tuple[NDArray[np.int64], NDArray[np.float32]]

ACTION_SIZE = len(HINGES)
LOG_INTERVAL = 4096


@dataclass
class Loop:
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
    compact = config.student.compact_observation
    env = humanoid_env(replace(config, threads=each), num_envs=config.student.num_envs, compact=compact)
    columns = torch.from_numpy(env.compact_columns if compact else np.arange(OBSERVATION_SIZE))
    windows = FrameWindows(num_envs=env.num_envs, layout=window_layout(config))
    humanoid = fingerprint(env.model)
    if "reference" in inputs and config.student.reference_resets > 0:
        start_from_reference(config, env, inputs["reference"])
    with second_lane(beside) as lane:
        learner = build_learner(config, env, columns, windows.layout, inputs.get("reference"), lane)

        def save() -> None:
            moments = learner.normalizer.mean_and_scale()
            save_policy(output / "policy.safetensors", learner.sac, columns, *moments, humanoid)

        train(config, env, windows, learner, log, output, save)
        save()


def start_from_reference(config: Config, env: PlanarHumanoidVectorEnv, reference: Path) -> None:
    """Let a share of the episodes begin in poses of the reference."""
    arrays, share = read_reference(reference, config, steps=3), config.student.reference_resets
    bank = reference_bank(
        env.model, arrays["features"], arrays["episode"], dt=env.control_step, size=BANK_SIZE, seed=config.seed
    )
    env.start_from(bank, share)


def window_layout(config: Config) -> WindowLayout:
    """What the discriminator sees."""
    judge = config.discriminator
    return WindowLayout(judge.features, judge.window, judge.stride, 1 / config.humanoid.control_frequency)


def build_learner(
    config: Config,
    env: PlanarHumanoidVectorEnv,
    columns: Tensor,
    layout: WindowLayout,
    reference: Path | None,
    lane: Executor | None = None,
) -> RomGrl:
    """Wire agent, discriminator and replay buffer from the configuration; `lane` is a second thread for the agent."""
    student, judge = config.student, config.discriminator
    mirrors: dict[str, Mirror | None] = {"observation": None, "action": None, "frames": None}
    if student.mirror:
        mirrors["observation"] = on_device(compact_mirror(env.mirror_observation, columns), config.device)
        mirrors["action"] = on_device(env.mirror_action, config.device)
        mirrors["frames"] = on_device(layout.mirror(), config.device)
    buffer = ReplayBuffer(
        capacity=student.buffer_size,
        num_envs=env.num_envs,
        observation_size=len(columns),
        action_size=ACTION_SIZE,
        frame_size=layout.size,
        seed=config.seed,
        device=config.device,
        **{f"mirror_{name}": mirror for name, mirror in mirrors.items()},
    )
    sac = SAC(
        observation_size=len(columns),
        action_size=ACTION_SIZE,
        hidden_sizes=list(student.hidden_sizes),
        layer_norm=student.layer_norm,
        policy_learning_rate=student.policy_learning_rate,
        critic_learning_rate=student.critic_learning_rate,
        temperature_learning_rate=student.temperature_learning_rate,
        initial_temperature=student.initial_temperature,
        target_entropy_scale=student.target_entropy_scale,
        gamma=student.gamma,
        tau=student.tau,
        policy_delay=student.policy_delay,
        critic_target=student.critic_target,
        policy_average=student.policy_average,
        simultaneous=student.simultaneous,
        lane=lane,
        seed=config.seed,
        device=config.device,
    )
    return RomGrl(
        sac=sac,
        discriminator=build_discriminator(config, layout, reference),
        buffer=buffer,
        normalizer=RunningNormalizer(len(columns), enabled=student.normalize_observation, device=config.device),
        eta=config.eta,
        batch_size=student.batch_size,
        discriminator_interval=judge.update_interval,
        discriminator_batch=judge.batch_size,
        discriminator_recent=judge.recent_steps,
        stored_reward=judge.reward == "stored",
    )


def build_discriminator(config: Config, layout: WindowLayout, reference: Path | None) -> Discriminator | None:
    """The judge, with the windows of the reference; None for the baseline."""
    judge = config.discriminator
    if judge.name == "none" or reference is None:
        return None
    arrays = read_reference(reference, config, steps=layout.span)
    real = reference_windows(
        arrays["features"],
        arrays["episode"],
        layout=layout,
        trunk_std=judge.trunk_std,
        mirror=config.student.mirror,
        seed=config.seed,
    )
    return Discriminator(
        reference=torch.from_numpy(real),
        hidden_sizes=list(judge.hidden_sizes),
        dropout=judge.dropout,
        learning_rate=judge.learning_rate,
        penalty_weight=judge.gradient_penalty,
        label_smoothing=judge.label_smoothing,
        noise=config.noise,
        reward_limit=judge.reward_limit,
        held_out=judge.held_out,
        patience=judge.patience,
        standardize=judge.standardize,
        loss=judge.loss,
        penalty_on=judge.penalty_on,
        seed=config.seed,
        device=config.device,
    )


def train(
    config: Config,
    env: PlanarHumanoidVectorEnv,
    windows: FrameWindows,
    learner: RomGrl,
    log: StageLog,
    output: Path,
    save: Callable[[], None],
) -> None:
    """Act, step and learn: the physics of a step runs beside the updates, which use what was stored before it."""
    student, device = config.student, config.device
    trunk = windows.layout.trunk
    tally = EpisodeTally(env.num_envs, config.humanoid.control_frequency)
    observation, info = env.reset(seed=config.seed)
    windows.restart(frame(info, trunk, ""))
    loop = Loop(torch.from_numpy(observation).to(device))
    health = HealthWatch(config, output, log)
    keeper = Keeper(
        output,
        {"loop": loop, "env": env, "windows": windows, "learner": learner, "tally": tally, "health": health},
        ring=learner.buffer,
        save_policy=save,
        seconds=config.checkpoint_seconds,
        total=student.total_steps,
        log=log,
    )
    first = keeper.go_on()
    with keeper.watch("student"):
        for step in range(first, student.total_steps, env.num_envs):
            action = explore(learner, loop.observation, env, random=step < student.learning_starts)
            stepped = start(learner.sac.lane, env.step, action.cpu().numpy())
            if step >= student.learning_starts:
                loop.due += student.updates_per_step * env.num_envs
                if student.learning_rate_decay:
                    learner.scale_learning_rates(min(1.0, 2 * (1 - step / student.total_steps)))
                loop.metrics |= learner.update(int(loop.due)) if loop.due >= 1 else {}
                loop.due -= int(loop.due)
            judged = learner.start_discriminator()
            observation, reward, terminated, truncated, info = stepped()
            check_physics(info["diverged"])
            check(observation=observation, reward=reward)
            following = torch.from_numpy(observation).to(device)
            frames = torch.from_numpy(windows.push(frame(info, trunk, "")))
            learner.buffer.add(
                loop.observation,
                action,
                following,
                torch.from_numpy(reward),
                torch.from_numpy(terminated),
                torch.from_numpy(truncated),
                frames,
                learner.collected_reward(frames, judged),
            )
            learner.normalizer.update(following)
            finished = terminated | truncated
            windows.restart(frame(info, trunk, "reset_"), finished)
            tally.add(info, terminated, finished)
            loop.observation = following
            loop.metrics |= judged()
            done = step + env.num_envs
            if done % LOG_INTERVAL < env.num_envs or done >= student.total_steps:
                tell(log, loop, tally, learner, health, done, student.total_steps)
            if learner.just_stopped():
                log.message(f"the discriminator stopped at step {done:,}: no better on held-out windows")
            keeper.keep(done)


def tell(
    log: StageLog, loop: Loop, tally: EpisodeTally, learner: RomGrl, health: HealthWatch, step: int, total: int
) -> None:
    """Write a row of the learning curve, and say what is wrong with the discriminator."""
    values = loop.numbers() | tally.take() | learner.counts() | learner.measures(LOG_INTERVAL)
    log.metrics(values, step)
    log.progress(step, total, speed=values["speed"], episode=values["episode_seconds"])
    health.add(values, step)


def frame(info: dict[str, NDArray[np.float32]], trunk: bool, prefix: str) -> NDArray[np.float32]:
    """Gait frame (N, 5), or (N, 6) with the trunk inclination; prefix "reset_" for the one after a reset."""
    features = info[f"{prefix}features"]
    return np.column_stack((features, info[f"{prefix}trunk_lean"])) if trunk else features


def explore(learner: RomGrl, current: Tensor, env: PlanarHumanoidVectorEnv, *, random: bool) -> Tensor:
    """Actions (N, A) of the exploring policy, uniform ones before learning starts."""
    if random:
        shape = (env.num_envs, ACTION_SIZE)
        return 2 * torch.rand(shape, generator=learner.sac.generator, device=current.device) - 1
    return learner.sac.act(learner.normalizer.apply_(current.clone()))


def compact_mirror(mirror: ArrayMirror, columns: Tensor) -> ArrayMirror:
    """Mirror of the kept columns only; they mirror among themselves, or ValueError."""
    permutation, sign = mirror
    place = {int(column): i for i, column in enumerate(columns)}
    try:
        kept = [place[int(permutation[column])] for column in place]
    except KeyError as missing:
        raise ValueError(f"observation column {missing} is dropped, but its mirror image is kept") from missing
    return np.array(kept), sign[columns.numpy()]


def on_device(mirror: ArrayMirror, device: str) -> Mirror:
    """A mirror as tensors."""
    return torch.from_numpy(mirror[0]).to(device), torch.from_numpy(mirror[1]).to(device)
