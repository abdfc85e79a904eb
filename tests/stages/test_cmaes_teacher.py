"""teacher=cmaes: a search on the native engine, its controller in a file, its artifact like any teacher's."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch

from romgrl.algorithms.policy_file import NETWORK
from romgrl.artifacts import load_tensors, save_tensors
from romgrl.errors import ArtifactError
from romgrl.gait.footfall import FOOTFALLS
from romgrl.rom.gait_clocks import CLOCKS, HOP, RUN
from romgrl.rom.phase_policy import COLUMNS, PhasePolicy, Span
from romgrl.runtime.stage_log import SilentLog
from romgrl.stages import reference, teacher
from romgrl.stages.training.cycle_measures import UNJUMPED, ApexErrors, TouchdownTimes, Tries, TrySums
from romgrl.stages.training.cycle_search import CycleSearch
from romgrl.stages.wiring.teacher_policy import load_phase_policy, save_phase_policy
from tests.conftest import Composer
from tests.helpers.searches import SMALL, search_of, shorten_checks

WALK = ("teacher.gait=walk", "rom=variable_walking", "teacher.speed=1.25")


def test_times_between_touchdowns() -> None:
    """World 0 steps evenly, world 1 limps, world 2 falls: what follows counts in neither."""
    moments = np.array([[0.1, 0.4, 0.7, 1.0], [0.1, 0.3, 0.7, 0.9], [0.1, 0.2, 0.3, 0.4]])
    times = TouchdownTimes.of(np.array([1.0, 1.0, 1.0]), phase=0.5)
    for step, moment in enumerate(moments.T):
        side = np.full(3, -1.0 if step % 2 == 0 else 1.0)
        times.add(side, moment, np.array([True, True, step < 1]))
        times.add(side, moment, np.array([True, True, step < 1]))  # no touchdown in this step
    np.testing.assert_array_equal(times.count, [3, 3, 0])
    gaps = np.array([0.2, 0.4, 0.2])
    np.testing.assert_allclose(times.spread(), [0.0, gaps.std() / gaps.mean(), 0.5], atol=1e-7)


def test_a_search_improves_and_has_the_same_bits_again(compose_config: Composer) -> None:
    config = compose_config(*SMALL, *WALK, "teacher.generations=60", "teacher.population=16")
    one, other = (search_of(config) for _ in range(2))
    told = [one.generation(number) for number in range(1, 61)]
    assert [other.generation(number) for number in range(1, 61)] == told
    np.testing.assert_array_equal(one.best, other.best)
    assert [one.steps_of(done) for done in (0.02, 0.2, 0.5)] == [20, 40, 80]
    first, last = (
        one.tries(parameters[None].repeat(16, axis=0), 80, seed=1) for parameters in (CLOCKS["walk"].mean, one.best)
    )
    assert one.paid(last).mean() > one.paid(first).mean() + 0.02
    assert last.upright.mean() > first.upright.mean()


def test_what_is_paid_ends_with_a_fall(compose_config: Composer) -> None:
    search = search_of(compose_config(*SMALL))
    tries = search.tries(np.array([RUN.mean - 100 * RUN.deviation] * 8), 80, seed=1)
    assert tries.upright.max() < 0.9
    assert (search.paid(tries) <= tries.upright).all()


def test_a_speed_that_drifts() -> None:
    """World 0 goes faster and faster, 1 holds its speed, 2 falls in the first half of what counts, 3 before it."""
    sums = TrySums(np.ones(4), 0.5, 12, 1 / 30, np.ones(4))
    for step in range(12):
        info = {
            "contact": np.ones((4, 2), bool),
            "positive_power": np.zeros(4),
            "forward_velocity": np.array([step, 2.0, 3.0, 4.0], np.float32),
            "features": np.ones((4, 5), np.float32),
        }
        fallen = np.array([False, False, step >= 6, step >= 2])
        sums.add(step, np.ones(4), np.zeros(4), fallen, info)
    tries = sums.tries()
    np.testing.assert_allclose(tries.speed, [7.5, 2.0, 3.0, 4.0])  # of steps 4 to 11
    np.testing.assert_allclose(tries.drift, [2.0, 0.0, 0.0, 0.0])  # of steps 8 to 11: 9.5


def test_what_a_gait_costs(compose_config: Composer) -> None:
    """A walk may not fly, a hop must; a limp and work have their price; something is always left."""
    usual = Tries(*(np.full((1, 1, 1), value) for value in (1.0, 1.0, 0.0, 0.08, 0.0, 0.0, 0.0)))
    flown = usual._replace(flight=np.full((1, 1, 1), 0.22))
    for gait, rom, standing, flying in (("walk", "variable_walking", 1.0, 0.8), ("hop", "hopping", 0.9, 1.0)):
        search = search_of(compose_config(*SMALL, f"teacher.gait={gait}", f"rom={rom}", "teacher.flight_cost=1"))
        assert search.kept(usual).item() == pytest.approx(standing)
        assert search.kept(flown).item() == pytest.approx(flying)
    search = search_of(compose_config(*SMALL, "teacher.work_cost=0.5", "teacher.limp_cost=2"))
    working = usual._replace(power=np.full((1, 1, 1), search.power_unit))
    assert search.kept(working).item() == pytest.approx(0.5)
    assert search.kept(usual._replace(limp=np.full((1, 1, 1), 0.18))).item() == pytest.approx(0.8)
    assert search.kept(usual._replace(limp=np.full((1, 1, 1), 3.0))).item() == 0.05


def test_feet_that_come_down_together_and_in_unequal_times() -> None:
    """Touchdowns of a hop within a tenth of a second are one; a skip's times are compared by its phase."""
    hop = TouchdownTimes.of(np.array([1.0]), phase=0.0)
    for side, moment in ((1.0, 0.5), (-1.0, 0.52), (1.0, 1.0), (1.0, 1.5)):
        hop.add(np.array([side]), np.array([moment]), np.array([True]))
    assert hop.count.tolist() == [2]
    np.testing.assert_allclose(hop.spread(), [0.0], atol=1e-7)
    skip = TouchdownTimes.of(np.array([1.0]), phase=0.3)
    for side, moment in ((-1.0, 0.3), (1.0, 1.0), (-1.0, 1.3), (1.0, 2.0)):
        skip.add(np.array([side]), np.array([moment]), np.array([True]))
    assert skip.count.tolist() == [3]
    np.testing.assert_allclose(skip.spread(), [0.0], atol=1e-7)


def test_a_teacher_of_a_range_is_tried_at_all_that_is_checked(compose_config: Composer) -> None:
    """Its controllers follow the speed that is asked, in the unit that they see."""
    config = compose_config(*SMALL, "teacher.speeds=[3,5]", "teacher.stiffness_shares=[0.8,1.2]")
    search = search_of(config)
    assert [task.speed for task in search.tasks] == [speed for speed in (3.0, 3.5, 4.0, 4.5, 5.0) for _ in range(2)]
    assert [span.column for span in search.spans] == ["target_speed", "stiffness_share"]
    assert len(search.mean) == 3 * len(RUN.mean)
    observation, _ = search.tasks[0].env.reset(seed=0)
    assert observation[0, 18] == pytest.approx(search.spans[0].low)
    assert observation[0, 26] == pytest.approx(search.spans[1].low)
    tries = search.tries(np.array([search.mean] * 8), 40, seed=1)
    assert tries.upright.shape == (10, 8, 2)
    assert np.ptp(tries.speed.mean(axis=(1, 2))) > 0.1


def test_a_curve_is_searched_around_a_line(compose_config: Composer) -> None:
    """One term for each power of the speed, the higher the nearer to none at first; stiffness stays linear."""
    config = compose_config(*SMALL, "teacher.speeds=[3,5]", "teacher.stiffness_shares=[0.8,1.2]", "teacher.degree=2")
    search = search_of(config)
    assert [(span.column, span.power) for span in search.spans] == [
        ("target_speed", 1),
        ("target_speed", 2),
        ("stiffness_share", 1),
    ]
    line, curve, share = search.deviation[len(RUN.mean) :].reshape(3, -1)
    np.testing.assert_allclose(curve, 0.5 * line)
    np.testing.assert_allclose(share, line)
    jumping = search_of(compose_config(*SMALL, "teacher=jumping", "teacher.population=8", "teacher.degree=3"))
    assert [span.power for span in jumping.spans] == [1, 2, 3]


def test_apexes_of_whole_flights() -> None:
    """World 0 jumps twice, 0.1 m too low and 0.2 too high; 1 falls in its second flight; 2 never lands; 3 is in the air
    at first, which counts nowhere."""
    errors = ApexErrors(np.full(4, 1.3))
    heights = np.array(
        [
            [0.9, 1.1, 1.2, 0.9, 1.4, 1.5, 1.0],
            [0.9, 1.2, 1.3, 0.9, 1.2, 0.8, 0.7],
            [0.9, 1.0, 1.1, 1.2, 1.3, 1.3, 1.3],
            [1.0, 0.9, 0.9, 1.0, 1.3, 1.2, 0.9],
        ]
    )
    flying = np.array(
        [[0, 1, 1, 0, 1, 1, 0], [0, 1, 1, 0, 1, 1, 0], [0, 1, 1, 1, 1, 1, 1], [1, 1, 0, 0, 1, 1, 0]], bool
    )
    counted = np.array([[1] * 7, [1, 1, 1, 1, 1, 0, 0], [1] * 7, [1] * 7], bool)
    for height, flies, counts in zip(heights.T, flying.T, counted.T, strict=True):
        errors.add(height.astype(np.float32), flies, counts)
    np.testing.assert_allclose(errors.mean(), [0.15, 0.0, UNJUMPED, 0.0], atol=1e-6)


def test_a_jump_is_paid_by_its_apex(compose_config: Composer) -> None:
    """Controllers of one number that jump to what they are asked for earn all; what no gait asks for costs nothing."""
    jumping = search_of(compose_config(*SMALL, "teacher=jumping", "teacher.population=8"))
    assert [task.apex for task in jumping.tasks] == pytest.approx([0.1, 0.2, 0.3, 0.4, 0.5])
    assert [span.column for span in jumping.spans] == ["target_takeoff_velocity"] * 2
    observation, _ = jumping.tasks[-1].env.reset(seed=0)
    assert observation[0, COLUMNS["target_takeoff_velocity"]] == pytest.approx(jumping.spans[0].high)
    perfect = Tries(*(np.full((5, 8, 2), value) for value in (1.0, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0)))
    assert jumping.paid(perfect) == pytest.approx(1.0)
    assert jumping.paid(perfect._replace(apex_error=perfect.flight * 0.2)) == pytest.approx(np.exp(-2.0))
    assert jumping.paid(perfect._replace(drift=perfect.flight)) == pytest.approx(np.exp(-0.75))
    tried = jumping.tries(np.tile(jumping.mean, (8, 1)), 60, seed=1)
    assert (np.diff(tried.apex_error.mean(axis=(1, 2))) != 0).all()  # the same controller, other apexes asked for
    running = search_of(compose_config(*SMALL)).tries(np.array([RUN.mean] * 8), 80, seed=1)
    assert running.apex_error.max() == 0.0


@pytest.fixture
def _short_check(monkeypatch: pytest.MonkeyPatch) -> None:
    shorten_checks(monkeypatch)


@pytest.mark.usefixtures("_short_check")
def test_the_stage_leaves_a_teachers_artifact(compose_config: Composer, tmp_path: Path) -> None:
    config = compose_config(*SMALL, "teacher.generations=4", "reference.steps=100", "reference.warmup_steps=1")
    log = SilentLog()
    teacher.run(config, {}, tmp_path, log)
    assert [step for step, _ in log.rows] == [1, 2, 3, 4]
    assert {"loss", "reward", "limp", "flight", "upright"} <= log.rows[0][1].keys()
    checks = pd.read_csv(tmp_path / "checks.csv")
    assert checks.step.tolist() == [2, 3, 4]
    assert pd.read_csv(tmp_path / "gait.csv").walker.tolist() == ["teacher"]
    load_phase_policy(tmp_path / "policy.safetensors")
    (tmp_path / "reference").mkdir()
    with pytest.raises(ArtifactError, match="falls"):  # four generations do not walk
        reference.run(config, {"teacher": tmp_path}, tmp_path / "reference", log)


@pytest.mark.usefixtures("_short_check")
def test_the_best_of_the_searches_goes_on(
    compose_config: Composer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After three of ten generations one is left: that whose mean loses least."""
    made: list[tuple[int, int]] = []
    means: dict[int, float] = {}
    generation, loss_of_mean = CycleSearch.generation, CycleSearch.loss_of_mean

    def count(search: CycleSearch, number: int) -> dict[str, float]:
        made.append((number, search.seed))
        return generation(search, number)

    def lose(search: CycleSearch) -> float:
        return means.setdefault(search.seed, loss_of_mean(search))

    monkeypatch.setattr(CycleSearch, "generation", count)
    monkeypatch.setattr(CycleSearch, "loss_of_mean", lose)
    teacher.run(compose_config(*SMALL, "teacher.generations=10", "teacher.scouts=3"), {}, tmp_path, SilentLog())
    seeds = {seed for _, seed in made}
    assert len(seeds) == 3
    assert [sum(number == each for number, _ in made) for each in range(1, 11)] == [3, 3, 3, *[1] * 7]
    assert means.keys() == seeds
    assert {seed for number, seed in made if number > 3} == {min(means, key=means.__getitem__)}


def test_a_controller_comes_back_from_its_file_and_no_other_does(tmp_path: Path) -> None:
    path, spans = tmp_path / "policy.safetensors", [Span("target_speed", 0.1, 0.9, power) for power in (1, 2)]
    policy = PhasePolicy(np.tile(HOP.mean + 0.1, 3), "hop", spans)
    save_phase_policy(path, policy)
    back = load_phase_policy(path)
    np.testing.assert_array_equal(back.parameters, policy.parameters)
    assert (back.gait, back.spans) == ("hop", tuple(spans))
    tensors, metadata = load_tensors(path)
    spec = json.loads(metadata[NETWORK])
    nan = {"parameters": torch.full((63,), float("nan"), dtype=torch.float64)}
    for kept, said, line in (
        (tensors, spec | {"algorithm": "ppo"}, "algorithm ppo; needed: cmaes"),
        (tensors, {"algorithm": "cmaes"}, "does not describe its controller"),
        (tensors, spec | {"gait": "fly"}, "does not describe its controller"),
        (tensors, spec | {"spans": [["target_speed", 0.9, 0.1]]}, "does not describe its controller"),
        (tensors, spec | {"spans": [["target_speed", 0.1, 0.9, 0.5]] * 2}, "does not describe its controller"),
        (tensors, spec | {"spans": []}, r"parameters is torch.float64 \(63,\)"),
        (tensors, spec | {"observation_names": ["height"]}, "column 0 of what it reads is height"),
        ({"parameters": tensors["parameters"][:5]}, spec, r"parameters is torch.float64 \(5,\)"),
        (nan, spec, "not finite"),
        ({}, spec, "no tensor parameters"),
    ):
        save_tensors(path, kept, {NETWORK: json.dumps(said)})
        with pytest.raises(ArtifactError, match=line):
            load_phase_policy(path)


@pytest.mark.slow
def test_a_whole_search_finds_a_run(compose_config: Composer, tmp_path: Path) -> None:
    """Two of three seeds had 5 and 6 falls in 100 episodes of 33 s, 4.00 and 4.01 m/s, a correlation of -0.99."""
    teacher.run(compose_config("teacher=cmaes", "threads=1"), {}, tmp_path, SilentLog())
    row = pd.read_csv(tmp_path / "gait.csv").iloc[0]
    assert row.falls <= 25
    assert row.steady_speed_m_per_s == pytest.approx(4.0, rel=0.03)
    assert row.left_right_correlation < -0.9
    assert 1.3 <= row.stride_frequency_hz <= 1.8


@pytest.mark.slow
def test_a_whole_search_finds_jumps(compose_config: Composer, tmp_path: Path) -> None:
    """To what is asked for in the middle of its apexes."""
    teacher.run(compose_config("teacher=jumping", "threads=1"), {}, tmp_path, SilentLog())
    row = pd.read_csv(tmp_path / "gait.csv").iloc[2]
    assert row.falls <= 5
    assert row.jump_apex_m == pytest.approx(0.25, abs=0.03)
    assert row.jump_apex_error_m < 0.04


@pytest.mark.slow
@pytest.mark.parametrize(("preset", "speed"), [("variable_walking", 1.125), ("hopping", 1.25), ("skipping", 1.75)])
def test_a_whole_search_finds_the_gait_of_a_range(
    preset: str, speed: float, compose_config: Composer, tmp_path: Path
) -> None:
    """In the middle of its speeds; seed 0 had no falls there."""
    config = compose_config(f"teacher={preset}", "threads=1")
    teacher.run(config, {}, tmp_path, SilentLog())
    row = pd.read_csv(tmp_path / "gait.csv").iloc[2]
    assert row.target_speed_m_per_s == pytest.approx(speed)
    assert row.falls <= 25
    assert row.steady_speed_m_per_s == pytest.approx(speed, rel=0.05)
    footfall = FOOTFALLS[config.teacher.gait]
    assert abs((row.touchdown_phase_strides - footfall.phase + 0.5) % 1.0 - 0.5) < 0.12
