"""A student that follows commands: what is relabelled, taught, opened, checked and kept, and how it goes on."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch

from romgrl.algorithms.commanded_windows import WindowColumns
from romgrl.algorithms.conditioned_rom_grl import CommandedBuffer
from romgrl.algorithms.relabelling import Relabelling
from romgrl.algorithms.sac import load_sac_policy
from romgrl.config.commanded import conditioned_keys
from romgrl.config.values import value_of
from romgrl.errors import ArtifactError
from romgrl.gait.discriminator_windows import WindowLayout
from romgrl.humanoid.command_schedules import CommandTable
from romgrl.humanoid.reference_states import ReferenceStates
from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv
from romgrl.provenance.stage_graph import plan, share_threads
from romgrl.provenance.stage_keys import stage_key, stage_settings
from romgrl.runtime import signals
from romgrl.runtime.stage_log import SilentLog
from romgrl.stages import student
from romgrl.stages.conditioned import grid_check
from romgrl.stages.conditioned.cells import CommandCells, read_command_cells
from romgrl.stages.conditioned.commanded_frames import CommandedFrames, speed_payment
from romgrl.stages.conditioned.curriculum import Curriculum
from romgrl.stages.conditioned.grid_check import grid_commands, shortfall
from tests.conftest import Composer
from tests.helpers.commanded import commanded, small_library
from tests.helpers.configurations import with_value
from tests.helpers.cut_trainings import Recorder, files

NO_FALL = {"fall_pelvis_height": 0.0, "fall_head_height": 0.0, "fall_trunk_lean": 9.0}


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return small_library(tmp_path_factory.mktemp("conditioned") / "library")


@pytest.fixture
def cells(library: Path, compose_config: Composer) -> CommandCells:
    return read_command_cells(library, commanded(compose_config), span=4)


def test_a_relabelled_transition_is_that_of_an_environment_that_had_the_command() -> None:
    """Observation, the one after three steps, and all three rewards, with a share of the reward for the posture."""
    there, wanted = (
        CommandTable.constant(speed, {"run": gait, "walk": 1 - gait}) for speed, gait in ((3, 1), (1.5, 0))
    )
    envs = [
        PlanarHumanoidVectorEnv(
            num_envs=4, commands=table, alpha=None, posture_weight=0.25, episode_steps=99, **NO_FALL
        )
        for table in (there, wanted)
    ]
    layout, columns = WindowLayout("trunk", 2), WindowColumns(12, 2)
    windows = CommandedFrames(num_envs=4, layout=layout)
    buffer = CommandedBuffer(
        columns=columns, slowest=torch.zeros(2), stratify=True, capacity=400, num_envs=4, seed=0, n_steps=3,
        observation_size=362, action_size=21,
    )  # fmt: skip
    observation, info = envs[0].reset(seed=0)
    seen = [envs[1].set_states(envs[0].states())]
    windows.restart(windows.frame(info))
    rewards, generator = [], np.random.default_rng(0)
    for _ in range(20):
        action = generator.uniform(-1, 1, (4, 21)).astype(np.float32)
        following, paid, fell, cut, info = envs[0].step(action)
        stored = (observation, action, following, paid, fell, cut, windows.push(windows.frame(info)))
        buffer.add(*map(torch.from_numpy, stored))
        observation = following
        other, paid, *_ = envs[1].step(action)
        seen.append(other)
        rewards.append(paid)
    relabelling = Relabelling(
        columns, torch.tensor([[1.5, 1.5], [1.5, 1.5]]), speed_payment(None), share=1.0, weight=0.75, seed=0
    )
    batch = buffer.sample(64)
    was = batch.observation[:, :-4].clone()
    relabelling.apply_(batch)
    walks = batch.observation[:, -2] == 1  # a quarter are asked to run at that speed
    assert 10 < int(walks.sum()) < 40
    assert torch.equal(batch.observation[:, :-4], was)
    flat = np.concatenate(seen)
    for row in torch.nonzero(walks).flatten().tolist():
        place = int(np.abs(flat - batch.observation[row].numpy()).max(axis=1).argmin())
        step, world = divmod(place, 4)
        count = int(batch.counts[row].sum())
        assert np.array_equal(flat[place], batch.observation[row].numpy())
        assert np.array_equal(seen[step + count][world], batch.next_observation[row].numpy())
        paid_there = [rewards[step + k][world] for k in range(count)]
        np.testing.assert_allclose(batch.task_reward[row, :count], paid_there, atol=2e-6)
        assert torch.equal(batch.windows[row, :, columns.commands], batch.observation[row, -4:].expand(3, 4))


def test_a_share_is_relabelled_half_of_it_near_what_was_achieved() -> None:
    columns = WindowColumns(1, 1)
    made = Relabelling(columns, torch.tensor([[1.0, 5.0]]), speed_payment(1.0), share=0.5, seed=0)
    rows = torch.tensor([0.0, 4.0, 1.0, 1.0, 2.0]).repeat(20_000, 1)  # asked for 4 m/s, at 2 m/s
    chosen, asked = made._drawn(rows)
    assert float(chosen.float().mean()) == pytest.approx(0.5, abs=0.02)
    assert float(((asked[:, 0] - 2.0).abs() < 0.6).float().mean()) == pytest.approx(0.5 * 0.954 + 0.5 * 0.3, abs=0.02)
    assert (asked[:, 0].min() >= 1.0, asked[:, 0].max() <= 5.0, asked[:, 2].unique().tolist()) == (True, True, [1.0])


def test_fit_cells_of_the_usual_stiffness_are_taught(
    cells: CommandCells, compose_config: Composer, library: Path
) -> None:
    assert cells.gaits == ("run", "walk")
    assert [cells.name(n) for n in range(5)] == [
        *(f"run at {v} m/s" for v in (2, 3, 4)),
        "walk at 1 m/s",
        "walk at 2 m/s",
    ]
    assert cells.ranges.tolist() == [[2.0, 4.0], [1.0, 2.0]]
    left_out = read_command_cells(library, commanded(compose_config, "student.taught_step=2"), span=4)
    assert (left_out.taught.tolist(), left_out.ranges.tolist()) == ([True, False, True, False, True], [[2, 4], [1, 2]])
    with pytest.raises(ArtifactError, match="no cell at multiples of 9 m/s is fit"):
        read_command_cells(library, commanded(compose_config, "student.taught_step=9"), span=4)
    with pytest.raises(ArtifactError, match=r"run at 2 m/s: 120 steps in a row; needed: 999"):
        read_command_cells(library, commanded(compose_config), span=999)


def test_an_episode_begins_in_the_cell_nearest_to_its_command(cells: CommandCells) -> None:
    env = PlanarHumanoidVectorEnv(num_envs=1)
    states = cells.states(env.model)
    commands = np.array([[4.3, 1, 0, 1], [1.2, 0, 1, 1], [2.4, 1, 0, 1], [0.0, 0, 1, 1]], np.float32)
    assert states.nearest(commands).tolist() == [2, 3, 0, 3]
    steps = states.drawn_steps(np.random.default_rng(0), 400, np.repeat(commands, 100, axis=0))
    assert states.cell[steps].tolist() == [2] * 100 + [3] * 100 + [0] * 100 + [3] * 100
    assert (states.episode[steps - 1] == states.episode[steps + 2]).all()
    one = ReferenceStates(env.model, cells.references[1]["features"], cells.references[1]["episode"], cells.dt)
    assert states.draw(np.random.default_rng(0), 4, commands)[0].shape == one.draw(np.random.default_rng(0), 4)[0].shape
    with pytest.raises(ValueError, match="have commands"):
        states.draw(np.random.default_rng(0), 4)


def info(commands: list[list[float]], speeds: list[float]) -> dict[str, Any]:
    return {"command": np.array(commands, np.float32), "forward_velocity": np.array(speeds, np.float32)}


def test_a_neighbour_opens_when_the_edge_is_solved(cells: CommandCells, compose_config: Composer) -> None:
    config = commanded(compose_config)
    made, limits = Curriculum(conditioned_keys(config.student), cells, None, 2), torch.zeros((2, 2))
    made.tell(limits)
    assert limits.tolist() == [[2.5, 3.25], [1.0, 1.75]]
    fast, slow = [3.2, 1.0, 0.0, 1.0], [2.6, 1.0, 0.0, 1.0]
    nothing = np.full(made.paid.shape, np.nan)
    for _ in range(40):
        made.take(info([fast, slow], [3.2, 2.6]))
    assert not made.review(nothing, 0.1, limits)  # judged by too few steps
    for _ in range(300):
        made.take(info([fast, slow], [3.2, 1.6]))
    assert made.review(nothing, 0.1, limits)  # the fast edge alone is solved
    assert limits.tolist() == [[2.5, 3.5], [1.0, 1.75]]
    faster, fast = [3.4, 1.0, 0.0, 1.0], [3.2, 1.0, 0.0, 1.0]
    for _ in range(300):
        made.take(info([faster, fast], [3.4, 3.2]))
    imitation = nothing.copy()
    imitation[0, made.bins(np.array([0, 0]), np.array([3.4, 3.2]))] = 0.4, 0.9
    assert not made.review(imitation, 0.1, limits)  # its imitation is below the median
    state = made.state()
    other = Curriculum(conditioned_keys(config.student), cells, None, 2)
    other.restore(state)
    assert other.ranges.tolist() == made.ranges.tolist()
    assert made.review(nothing, 0.5, limits)
    assert limits.tolist() == cells.ranges.tolist()
    drawn, _ = made.schedule.following(np.random.default_rng(0), np.arange(2000), np.zeros(2000), None)
    assert (drawn[:, 0] == 0).mean() == pytest.approx(0.05, abs=0.02)
    assert drawn[drawn[:, 0] > 0, 0].max() > 3.9
    whole = Curriculum(conditioned_keys(with_value(config, "student.curriculum", False).student), cells, None, 2)
    assert whole.ranges.tolist() == cells.ranges.tolist()


def test_what_a_cell_is_short_of(cells: CommandCells) -> None:
    row = {"falls": 1.0, "speed_error_m_per_s": -0.4, "error_over_variance": 0.5}
    assert shortfall(row, 4.0, imitates=True) == pytest.approx(2.5 + 2.0 + 0.5)
    assert shortfall(row, 1.0, imitates=False) == pytest.approx(2.5 + 4.0)
    lost = {"falls": 4.0, "speed_error_m_per_s": float("nan"), "error_over_variance": float("nan")}
    assert shortfall(lost, 4.0, imitates=True) == 30.0
    table, _ = grid_commands(cells).following(np.random.default_rng(0), np.arange(20), np.zeros(20), None)
    assert table[:, 0].tolist() == np.repeat([2.0, 3.0, 4.0, 1.0, 2.0], 4).tolist()
    assert table[:, 2].tolist() == [0.0] * 12 + [1.0] * 8


def test_a_resumed_training_ends_with_the_same_files(
    compose_config: Composer, library: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder = Recorder(monkeypatch)
    monkeypatch.setattr(grid_check, "STEPS", 20)
    config = commanded(compose_config, "student.adapt_eta=true")
    for name in ("whole", "cut"):
        (tmp_path / name).mkdir()
    log = SilentLog()
    student.run(config, {"library": library}, tmp_path / "whole", log)
    assert {"health.json", "health_by_band.json", "checks.csv", "policy.safetensors"} <= {*files(tmp_path / "whole")}
    table = pd.read_csv(tmp_path / "whole" / "checks.csv")
    assert (len(table), table.step.unique().tolist()) == (10, [800, 1600])
    assert load_sac_policy(tmp_path / "whole" / "policy.safetensors").names[-1] == "command.style"
    assert {"imitation_reward/run_3_4", "discriminator_feature_gap/walk_1_2"} <= {*log.rows[-1][1]}
    assert [message for message in log.messages if message.startswith("weight of the speed from")]
    recorder.again()
    recorder.cut = 1000
    with pytest.raises(signals.Interrupted):
        student.run(config, {"library": library}, tmp_path / "cut", SilentLog())
    recorder.again()
    student.run(config, {"library": library}, tmp_path / "cut", SilentLog())
    assert recorder.steps[0] == 1008
    assert files(tmp_path / "cut") == files(tmp_path / "whole")


def test_the_baseline_is_asked_for_the_same_and_has_no_discriminator(
    compose_config: Composer, library: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(grid_check, "STEPS", 20)
    log = SilentLog()
    config = commanded(compose_config, "discriminator=none", "eta=1", "student.total_steps=600")
    student.run(config, {"library": library}, tmp_path, log)
    assert not [name for name in log.rows[-1][1] if "discriminator" in name or "imitation" in name]
    assert "command.run" in load_sac_policy(tmp_path / "policy.safetensors").names


def test_a_conditioned_student_reads_the_library_and_has_a_key_of_its_own(compose_config: Composer) -> None:
    nothing: Any = lambda stage: False  # noqa: E731
    assert plan(["student"], nothing, conditioned=True) == ["teacher", "library", "student"]
    assert plan(["baseline"], nothing, conditioned=True) == ["teacher", "library", "baseline"]
    assert share_threads(["teacher", "library", "baseline"], 4, conditioned=True)["teacher"] == 4
    usual = stage_settings("student", compose_config())
    assert "student.kind" not in usual  # as what was trained before
    config = compose_config("experiment=every_speed")
    for stage in ("student", "baseline"):
        key = stage_key(stage, config, {})
        assert key == stage_key(stage, with_value(config, "speed", 3.0), {})
        own = {name for name in stage_settings(stage, config) if name not in usual and name.startswith("student.")}
        assert len(own) == 12
        silent = {f"student.{name}" for name in ("mismatched_share", "mismatch_distance", "stratify")}
        silent |= {"student.standardize_by_command", "student.final_eta"}
        for name in own - {"student.kind"}:
            value = value_of(config, name)
            changed = [1.0, 2.0] if isinstance(value, list) else not value if isinstance(value, bool) else 0.25
            changes = stage_key(stage, with_value(config, name, changed), {}) != key
            assert changes == (stage == "student" or name not in silent), name
    resets = stage_settings("baseline", config)["student.reference_resets"]
    assert resets == stage_settings("student", config)["student.reference_resets"] > 0
