"""The student stage: same seed, same weights; what it logs; what it refuses."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from romgrl.algorithms.networks.running_normalizer import RunningNormalizer
from romgrl.algorithms.replay_buffer import ReplayBuffer
from romgrl.algorithms.rom_grl import RomGrl
from romgrl.algorithms.sac import load_sac_policy
from romgrl.artifacts import load_tensors, save_arrays
from romgrl.config.schema import Config
from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv
from romgrl.runtime.stage_log import SilentLog
from romgrl.stages import student
from romgrl.stages.training.student_statistics import StudentTally
from romgrl.stages.wiring import student_learner
from tests.conftest import Composer

SMALL = (
    "student.hidden_sizes=[32,32]",
    "student.num_envs=8",
    "student.learning_starts=500",
    "student.batch_size=32",
    "student.updates_per_step=0.05",
    "student.check_steps=3000",
    "discriminator.batch_size=64",
)
JUDGED_OFTEN = ("student.updates_per_step=0.3", "discriminator.update_interval=1")


@pytest.fixture
def configuration(compose_config: Composer) -> Composer:
    """Networks and batches that take seconds."""
    return lambda *overrides: compose_config("threads=1", *SMALL, *overrides)


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Feet that swing in antiphase under a bouncing body."""
    directory = tmp_path_factory.mktemp("reference")
    phase = 2 * np.pi * 1.6 * np.arange(600) / 30
    left, right = np.sin(phase), np.sin(phase + np.pi)
    features = np.stack(
        (0.95 + 0.04 * np.cos(2 * phase), 0.4 * left, -0.85 + 0.05 * left, 0.4 * right, -0.85 + 0.05 * right), axis=-1
    )
    save_arrays(
        directory / "reference.npz",
        {
            "features": features.astype(np.float32),
            "episode": np.repeat(np.arange(3), 200).astype(np.int32),
            "dt": 1 / 30,
            "speed": 4.0,
        },
    )
    return directory


def weights(config: Config, inputs: dict[str, Path], output: Path) -> dict[str, torch.Tensor]:
    output.mkdir()
    student.run(config, inputs, output, SilentLog())
    return load_tensors(output / "policy.safetensors")[0]


@pytest.mark.slow
def test_same_seed_gives_the_same_weights_after_5000_steps(
    configuration: Composer, reference: Path, tmp_path: Path
) -> None:
    torch.set_num_threads(1)
    config = configuration("student.total_steps=5000", "threads=1")
    first, second = (weights(config, {"reference": reference}, tmp_path / name) for name in ("a", "b"))
    assert all(torch.equal(first[name], second[name]) for name in first)
    config.threads = 2
    beside = weights(config, {"reference": reference}, tmp_path / "two-threads")
    assert all(torch.equal(first[name], beside[name]) for name in first)
    config.threads, config.seed = 1, 1
    other = weights(config, {"reference": reference}, tmp_path / "c")
    assert not torch.equal(first["policy.weight_0"], other["policy.weight_0"])


def test_what_is_logged(configuration: Composer, reference: Path, tmp_path: Path) -> None:
    log = SilentLog()
    student.run(configuration("student.total_steps=4096"), {"reference": reference}, tmp_path, log)
    (step, values), *_ = log.rows
    assert step == 4096
    assert values["updates"] == pytest.approx((4096 - 500) * 0.05, abs=8)
    assert 0 < values["imitation_share"] < 1
    for name in ("accuracy_teacher", "accuracy_student", "validation_loss", "gradient_norm", "loss"):
        assert np.isfinite(values[f"discriminator_{name}"])
    assert 0 <= values["fall_share"] <= 1


def test_the_baseline_knows_no_discriminator(configuration: Composer, tmp_path: Path) -> None:
    log = SilentLog()
    student.run(configuration("student.total_steps=4096", "discriminator=none", "eta=1"), {}, tmp_path, log)
    assert not [name for name in log.rows[-1][1] if name.startswith(("discriminator", "imitation"))]
    policy = load_sac_policy(tmp_path / "policy.safetensors")
    env = PlanarHumanoidVectorEnv(compact=True)
    assert policy.names == list(env.observation_names)
    np.testing.assert_array_equal(policy.columns, env.columns)
    action = policy(np.zeros((3, 358), dtype=np.float32))
    assert action.shape == (3, 21)
    assert np.abs(action).max() <= 1


def test_an_interrupted_training_leaves_its_policy(
    configuration: Composer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, interrupt: Callable[..., None]
) -> None:
    monkeypatch.setattr(SilentLog, "progress", interrupt)
    with pytest.raises(KeyboardInterrupt):
        student.run(configuration("student.total_steps=9000", "discriminator=none", "eta=1"), {}, tmp_path, SilentLog())
    load_sac_policy(tmp_path / "policy.safetensors")


def test_running_normalizer_equals_the_moments_of_all_it_saw() -> None:
    values: NDArray[np.float64] = np.random.default_rng(0).normal(3, 5, (90, 4))
    normalizer = RunningNormalizer(4)
    for part in np.split(values, [10, 11, 50]):
        normalizer.update(torch.from_numpy(part).float())
    mean, scale = normalizer.mean_and_scale()
    np.testing.assert_allclose(mean, values.mean(0), rtol=1e-5)
    np.testing.assert_allclose(scale, 1 / values.std(0), rtol=1e-5)
    standardised = normalizer.apply_(torch.from_numpy(values).float())
    np.testing.assert_allclose(standardised.std(0, correction=0), 1, rtol=1e-4)


@pytest.mark.slow
def test_the_moment_the_discriminator_stops_is_logged(configuration: Composer, reference: Path, tmp_path: Path) -> None:
    log = SilentLog()
    still = ["discriminator.patience=2", "discriminator.early_stop=held_out", "discriminator.learning_rate=1e-30"]
    still += ["student.updates_per_step=0.3"]
    student.run(configuration("student.total_steps=4096", *still), {"reference": reference}, tmp_path, log)
    values = log.rows[-1][1]
    assert values["discriminator_stopped"] == 1.0
    assert values["discriminator_updates"] < values["updates"] / 5
    assert [text for text in log.messages if "the discriminator stopped at step" in text]


def test_learning_rates_fall_to_zero_over_the_second_half(
    configuration: Composer, reference: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    learners: list[RomGrl] = []
    scales: list[float] = []
    build, scale = student.build_student_learner, RomGrl.scale_learning_rates

    def remember(learner: RomGrl, value: float) -> None:
        scales.append(value)
        scale(learner, value)

    monkeypatch.setattr(student, "build_student_learner", lambda *a: learners.append(build(*a)) or learners[-1])
    monkeypatch.setattr(RomGrl, "scale_learning_rates", remember)
    config = configuration("student.total_steps=2000", "student.learning_rate_decay=true")
    student.run(config, {"reference": reference}, tmp_path, SilentLog())
    assert scales[0] == 1.0
    np.testing.assert_allclose(scales[-1], 2 * 8 / 2000)
    (learner,) = learners
    assert learner.discriminator is not None
    for optimizer, rate in (
        (learner.sac.policy_optimizer, config.student.policy_learning_rate),
        (learner.sac.critic_optimizer, config.student.critic_learning_rate),
        (learner.discriminator.optimizer, config.discriminator.learning_rate),
    ):
        assert optimizer.param_groups[0]["lr"] == pytest.approx(rate * scales[-1])


def test_target_entropy_moves_over_the_middle_half(
    configuration: Composer, reference: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    targets: list[float] = []
    update = RomGrl.update

    def remember(learner: RomGrl, count: int) -> dict[str, torch.Tensor]:
        targets.append(learner.sac.target_entropy)
        return update(learner, count)

    monkeypatch.setattr(RomGrl, "update", remember)
    overrides = ("student.target_entropy_scale=0.5", "student.final_entropy_scale=1.5", "student.total_steps=2000")
    config = configuration(*overrides)
    student.run(config, {"reference": reference}, tmp_path, SilentLog())
    assert (targets[0], targets[-1]) == pytest.approx((-0.5 * 21, -1.5 * 21), abs=0.5)


@pytest.mark.parametrize(("preset", "updates"), [("sac", 6), ("fast_sac", 2)])
def test_how_often_the_policy_is_updated(
    preset: str, updates: int, configuration: Composer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Five updates of the critics: `student=sac` makes two of policy and temperature where they are due, as CleanRL."""
    learners: list[RomGrl] = []
    build = student.build_student_learner
    monkeypatch.setattr(student, "build_student_learner", lambda *a: learners.append(build(*a)) or learners[-1])
    keys = (f"student={preset}", "student.total_steps=604", "student.check_steps=0", "discriminator=none", "eta=1")
    student.run(configuration(*keys), {}, tmp_path, SilentLog())
    sac = learners[0].sac
    made = [int(each["step"]) for each in sac.policy_optimizer.state.values()]
    assert (sac.updates, made) == (5, [updates, updates])


@pytest.mark.parametrize(("time", "moves"), [("null", False), ("0.1", True)])
def test_the_real_stream_leans_as_configured(time: str, moves: bool, configuration: Composer, reference: Path) -> None:
    config = configuration(f"discriminator.trunk_time={time}")
    layout = student.window_layout(config)
    discriminator = student_learner.build_discriminator(config, layout, reference)
    assert discriminator is not None
    lean = discriminator.real.reshape(-1, layout.window, layout.columns)[..., 5]
    assert bool((lean.diff() != 0).any()) == moves
    assert float(lean.std()) == pytest.approx(config.discriminator.trunk_std, rel=0.1)


def test_tally_of_episodes() -> None:
    tally = StudentTally(num_envs=2, control_frequency=30.0)
    info = {"forward_velocity": np.array([1.0, 3.0]), "trunk_lean": np.zeros(2), "diverged": np.zeros(2)}
    nothing, first = np.array([False, False]), np.array([True, False])
    for step in range(60):
        tally.add(info, nothing, first if step == 59 else nothing)
    values = tally.take()
    assert values["speed"] == pytest.approx(2.0)
    assert values["episode_seconds"] == pytest.approx(2.0)
    assert values["fall_share"] == 0.0
    tally.add(info, nothing, nothing)
    assert tally.take()["episode_seconds"] == pytest.approx(2.0)
    tally.add(info, first, first)
    assert tally.take()["fall_share"] == 1.0


@pytest.fixture(scope="module")
def stored_on_one_thread() -> dict[str, torch.Tensor]:
    """The weights that one thread gave, for two to give again."""
    return {}


@pytest.mark.slow
@pytest.mark.parametrize("threads", [1, 2])
def test_a_stored_reward_is_what_the_discriminator_said_when_the_step_was_taken(
    threads: int,
    stored_on_one_thread: dict[str, torch.Tensor],
    configuration: Composer,
    reference: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Asked again at every step; the same bits on one thread and on two."""
    said: list[torch.Tensor] = []
    learners: list[RomGrl] = []
    add, build = ReplayBuffer.add, student.build_student_learner

    def adding(buffer: ReplayBuffer, *step: Any) -> None:
        discriminator = learners[0].discriminator
        assert discriminator is not None
        said.append(discriminator.reward(step[6]))
        add(buffer, *step)

    monkeypatch.setattr(student, "build_student_learner", lambda *a: learners.append(build(*a)) or learners[-1])
    monkeypatch.setattr(ReplayBuffer, "add", adding)
    config = configuration("student.total_steps=1200", "discriminator.reward=stored", *JUDGED_OFTEN)
    config.threads = threads
    found = weights(config, {"reference": reference}, tmp_path / "student")
    buffer = learners[0].buffer
    assert torch.equal(buffer.imitation_reward[: buffer.added], torch.stack(said))
    assert len({float(rewards[0]) for rewards in said}) > 80  # the discriminator learned between them
    drawn = buffer.sample(64)
    reward, metrics = learners[0]._reward(drawn)
    torch.testing.assert_close(reward, (0.5 * drawn.task_reward + 0.5 * drawn.imitation_reward)[:, 0])
    assert float(metrics["imitation_reward"]) == pytest.approx(float(drawn.imitation_reward.mean()))
    stored_on_one_thread |= found if threads == 1 else {}
    assert all(torch.equal(stored_on_one_thread[name], found[name]) for name in stored_on_one_thread)


VARIANTS = (
    ("discriminator.loss=least_squares", "discriminator.penalty_on=reference"),
    ("discriminator.loss=wasserstein", "discriminator.features=velocities"),
    ("discriminator.features=trunk_velocities", "discriminator.window=4", "discriminator.stride=4"),
    ("discriminator.penalty_on=both", "discriminator.window=4", "discriminator.stride=3"),
)


@pytest.mark.slow
@pytest.mark.parametrize("variant", VARIANTS, ids=lambda variant: variant[0].removeprefix("discriminator."))
def test_every_variant_trains(
    variant: tuple[str, ...], configuration: Composer, reference: Path, tmp_path: Path
) -> None:
    log = SilentLog()
    config = configuration("student.total_steps=1024", *JUDGED_OFTEN, *variant)
    student.run(config, {"reference": reference}, tmp_path, log)
    values = log.rows[-1][1]
    assert values["discriminator_updates"] > 20
    assert np.isfinite(list(values.values())).all()
    assert 0 <= values["imitation_reward"] <= (3.0 if config.discriminator.loss == "bce" else 1.0)
