"""Windows beside their command: statistics between cells, what is real, fake and mismatched, and the penalty."""

from __future__ import annotations

from copy import deepcopy
from typing import Any

import pytest
import torch

from romgrl.algorithms.commanded_windows import CellWindows
from romgrl.algorithms.conditioned_discriminator import ConditionedDiscriminator
from romgrl.algorithms.conditioned_rom_grl import CommandedBuffer
from romgrl.algorithms.discriminator_health import WATCHED
from tests.helpers.command_cells import COLUMNS, RUN, WALK, W, asked, cells

SETTINGS: dict[str, Any] = {
    "hidden_sizes": [16],
    "dropout": 0.0,
    "learning_rate": 1e-2,
    "penalty_weight": 0.1,
    "label_smoothing": 0.1,
    "noise": 0.1,
    "reward_limit": 3.0,
    "held_out": 0.1,
    "patience": None,
    "seed": 0,
}


def test_statistics_are_straight_between_cells_of_a_gait_and_flat_beyond() -> None:
    made = cells()
    mean, deviation = made.moments(asked(RUN, 1.0, 2.0, 2.25, 4.0, 9.0))
    torch.testing.assert_close(mean, torch.stack((made.mean[0], made.mean[0], 0.75 * made.mean[0] + 0.25 * made.mean[1],
                                                  made.mean[2], made.mean[2])))  # fmt: skip
    torch.testing.assert_close(deviation[2], 0.75 * made.deviation[0] + 0.25 * made.deviation[1])
    torch.testing.assert_close(made.moments(asked(WALK, 0.5, 4.0))[0], made.mean[[3, 3]])
    assert made.nearest(asked(RUN, 1.0, 2.49, 2.51, 3.9)).tolist() == [0, 0, 1, 2]
    assert made.taught(torch.cat((asked(RUN, 0.0, 2.0), asked(WALK, 0.0, 1.0)))).tolist() == [False, True, False, True]
    together = cells(by_command=False)
    assert torch.equal(together.mean[0], together.mean[3])


def test_the_gap_of_the_features_is_in_deviations_of_each_command() -> None:
    """A deviation off at each command: half of the columns' terms are 1, the others, of equal deviations, 0."""
    judged = judge()
    student = judged.real.clone()
    student[:, :W] += judged.cells.moments(student)[1]
    values = judged.measures(student)
    assert values["discriminator_feature_gap"] == pytest.approx(0.5**0.5, rel=0.02)
    assert judged.measures(judged.real)["discriminator_feature_gap"] < 1e-6
    assert set(values) < set(WATCHED)
    assert judged.measures(asked(RUN, 0.0, 0.0)) == {}  # to stand, of which there is no reference


def test_accuracies_are_of_the_cells_that_are_meant() -> None:
    """A network that sees the weight of the first gait alone takes runs for the teacher's, and no walk."""
    judged = judge()
    judged.network = torch.nn.Sequential(torch.nn.Linear(W + 3, 1))
    weights = torch.zeros((1, W + 3))
    weights[0, W + 1 + RUN] = 2.0
    judged.network.load_state_dict({"0.weight": weights, "0.bias": torch.tensor([-1.0])})
    student, runs = torch.cat((asked(RUN, 2.0, 3.0, 3.5), asked(WALK, 1.0))), judged.cells.gait == RUN
    for among, share in ((runs, 1.0), (~runs, 0.0)):
        assert [*judged.accuracies_of(student, among).values()] == [share, 0.25]


def test_what_is_far_is_another_gait_or_speed() -> None:
    assert cells().far(1.5).int().tolist() == [[0, 0, 1, 1], [0, 0, 0, 1], [1, 0, 0, 1], [1, 1, 1, 0]]


def test_cells_are_sorted_and_each_has_windows_to_validate() -> None:
    windows = [torch.randn((20, W)) for _ in range(2)]
    for gait, speed, held_out in (([0, 0], [3.0, 2.0], 0.1), ([0, 0], [2.0, 3.0], 1e-6), ([1, 1], [2.0, 3.0], 0.1)):
        with pytest.raises(ValueError, match=r"cells|gait|held_out"):
            CellWindows(windows, gait, speed, gaits=2, held_out=held_out, by_command=True)


def judge(**changes: Any) -> ConditionedDiscriminator:
    return ConditionedDiscriminator(
        cells(), **{"mismatched": 0.25, "distance": 0.7, "standardize": True} | SETTINGS | changes
    )


def test_each_real_window_is_the_reference_at_the_command_and_mismatches_are_of_others() -> None:
    made = judge()
    rows = torch.cat((asked(RUN, *[2.1] * 400, *[3.75] * 400), asked(WALK, *[1.2] * 400)))
    real, fake = made._streams(rows)
    assert torch.equal(real[:, COLUMNS.commands], rows[:, COLUMNS.commands])
    assert torch.equal(fake[:, COLUMNS.commands], rows[:, COLUMNS.commands])
    for part, mean, deviation in zip(real.chunk(3), (1.0, 17.5, 30.0), (1.1, 2.75, 4.0), strict=True):
        seen = part[:, :W]
        assert float(seen.mean()) == pytest.approx(mean, abs=0.5)
        assert float(seen.std()) == pytest.approx(deviation, rel=0.1)
    assert torch.equal(fake[300:], rows[300:])
    assert fake[:300, 0].min() > 5  # of a cell other than the slowest run, whose windows are about 0


def test_no_command_tells_the_streams_apart() -> None:
    """Of a student whose windows are the reference's."""
    made, generator = judge(mismatched=0.0), torch.Generator().manual_seed(1)
    rows = made.cells.draw_at(asked(RUN, *(2 + 2 * torch.rand(1024, generator=generator)).tolist()), generator)
    for _ in range(200):
        made.update(rows[torch.randperm(len(rows), generator=generator)[:128]])
    fresh = made.cells.draw_at(asked(RUN, *(2 + 2 * torch.rand(4096, generator=generator)).tolist()), generator)
    with torch.no_grad():
        apart = made.logits(made.cells.real).mean() - made.logits(fresh).mean()
    assert abs(float(apart)) < 0.3  # 1.3 where real ones stood at the speeds of their cells


def test_a_cell_without_another_that_is_far_is_refused() -> None:
    with pytest.raises(ValueError, match=r"no reference is 0\.7"):
        ConditionedDiscriminator(
            CellWindows([torch.randn(20, W)], [0], [2.0], gaits=1, held_out=0.1, by_command=True),
            mismatched=0.2, distance=0.7, standardize=True, **SETTINGS,
        )  # fmt: skip


@pytest.mark.parametrize("where", ["interpolates", "reference", "both"])
def test_the_penalty_is_on_the_window_with_the_command_held_fixed(where: str) -> None:
    """Of a linear network: its weights of the window alone count."""
    made = judge(penalty_on=where)
    slopes = torch.arange(1.0, W + 4) / 10
    made.network = torch.nn.Linear(W + 3, 1, bias=False)
    made.network.weight.data = slopes[None]
    norm = slopes[:W].norm()
    expected = (norm - 1).square() if where == "interpolates" else norm.square()
    found = made._penalty(*made._streams(asked(RUN, *[2.5] * 8)))
    assert float(found.detach()) == pytest.approx(float(expected), rel=1e-5)


def test_noise_is_in_deviations_of_the_command_and_leaves_it() -> None:
    made, rows = judge(), torch.cat((asked(RUN, *[2.0] * 4000), asked(RUN, *[4.0] * 4000)))
    disturbed = made._perturb(rows)
    assert torch.equal(disturbed[:, W:], rows[:, W:])
    for part, cell in zip(disturbed.chunk(2), (0, 2), strict=True):
        torch.testing.assert_close(part[:, :W].std(0), 0.1 * made.cells.deviation[cell], rtol=0.05, atol=0)


def test_it_learns_which_windows_belong_to_a_command() -> None:
    """The same windows are the teacher's at one command and not at another; its state goes on bit by bit."""
    made = judge(mismatched=0.5)
    rows = torch.cat((asked(RUN, *[2.0] * 64, *[4.0] * 64), asked(WALK, *[1.0] * 64)))
    rows[:, :W] = 50.0
    for _ in range(150):
        made.update(rows)
    right, wrong = made.cells.draw(torch.full((200,), 0), made.generator), asked(RUN, *[4.0] * 200)
    wrong[:, :W] = right[:, :W]
    with torch.no_grad():
        assert float(made.logits(right).mean()) > 1 > -1 > float(made.logits(wrong).mean())
    other = judge(mismatched=0.5)
    other.restore(deepcopy(made.state()))
    one, two = made.update(rows), other.update(rows)
    assert all(torch.equal(one[name], two[name]) for name in one)


@pytest.mark.parametrize(("stratify", "walks"), [(True, 0.5), (False, 4 / 30)])  # two of 32 are to stand
def test_the_student_has_as_many_windows_of_each_gait_and_none_to_stand(stratify: bool, walks: float) -> None:
    buffer = CommandedBuffer(
        columns=COLUMNS, slowest=torch.tensor([2.0, 1.0]), stratify=stratify,
        capacity=80, num_envs=8, observation_size=1, action_size=1, seed=0,
    )  # fmt: skip
    rows = torch.cat((asked(RUN, *[2.5] * 7), asked(WALK, 1.5)))
    for step in range(25):
        rows[0, W] = 0.0 if step % 2 else 2.0
        rows[:, 0] = step
        flags, nothing = torch.zeros(8), torch.zeros((8, 1))
        buffer.add(nothing, nothing, nothing, flags, flags, flags, rows.clone())
    drawn = buffer.sample_windows(20_000, recent=32)
    assert {*drawn[:, 0].tolist()} == {21.0, 22.0, 23.0, 24.0}
    assert drawn[:, W].min() >= 1.5
    assert float(drawn[:, W + 2].mean()) == pytest.approx(walks, abs=0.015)
