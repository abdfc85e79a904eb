"""stage=verify: which evaluations count, and the verdicts on them."""

from __future__ import annotations

import io
import math
import re
import shutil
from pathlib import Path

import pytest
from rich.console import Console

from romgrl.config.schema import Config
from romgrl.errors import ArtifactError
from romgrl.gait.features import CHANNELS
from romgrl.pipeline.run import run
from romgrl.results import statistics
from romgrl.results.claims import TOO_FEW, TOO_SHORT, Claim, decide, read_claims
from romgrl.results.evaluation_index import evaluations, select
from romgrl.results.statistics import NOWHERE, Interval
from tests.conftest import Composer
from tests.results.chains import changed, finish

LONG = ("evaluation.episodes=100", "evaluation.steps=1000")


def printed(config: Config) -> str:
    """What the command prints."""
    console = Console(record=True, width=300, file=io.StringIO())
    assert run(config, overrides=[f"speed={config.speed:g}", "stage=verify", "seed=3"], console=console) == {}
    return console.export_text()


def row(text: str, claim: str) -> str:
    """The first row of a claim, which is its verdict."""
    return rows(text, claim)[0]


def rows(text: str, claim: str) -> list[str]:
    """The rows of a claim in all tables."""
    return [line for line in text.splitlines() if re.match(rf"│ {re.escape(claim)} +│", line)]


def cells(line: str) -> list[str]:
    """The texts of a row."""
    return [cell.strip() for cell in line.strip("│ ").split("│")]


@pytest.fixture(autouse=True)
def _few_resamples(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(statistics, "RESAMPLES", 999)


@pytest.fixture
def verify(default_config: Config, tmp_path: Path) -> Composer:
    def composed(*overrides: str) -> Config:
        return changed(default_config, f"paths.outputs={tmp_path}", "stage=verify", *overrides)

    return composed


def test_claim_by_claim(verify: Composer, tmp_path: Path) -> None:
    students = [0.010, 0.011, 0.012, 0.013, 0.014]
    for seed, student in enumerate(students):
        gait = {"stride_frequency_hz": 1.62, "touchdown_phase_strides": 0.48}
        finish(tmp_path, verify(f"seed={seed}", *LONG), student=student, gait=gait)
    text = printed(verify(*LONG))
    average = row(text, "average reduction")
    assert "88 [86.8, 89.2]" in average  # 1 - 0.012 / 0.1; the exact bootstrap of five numbers in steps of 1/5
    assert "≥ 44.4 %" in average
    assert "Table 1" in average
    assert average.rstrip("│ ").endswith("│ reproduced")
    assert "not reproduced" in row(text, "ROM-GRL MSE of pelvis height")  # 0.012 against the paper's 0.00408
    assert " reproduced" in row(text, "ROM-GRL MSE of right foot x")
    assert "not reproduced" in row(text, "more symmetric than the baseline at 4 m/s")  # both 0.9
    assert "p = 1, P = 0.5" in row(text, "more symmetric than the baseline at 4 m/s")
    even = "feet alternate more evenly than the baseline's at 4 m/s"  # 0.02 of a stride off, and 0.05
    assert "p = 0.0312, P = 1" in row(text, even)  # 1 of 32 sign patterns
    assert row(text, even).rstrip("│ ").endswith("│ reproduced")
    assert cells(rows(text, even)[1]) == [even, "0.0312", "0.0625", "0.00397", "1", "5"]  # 2 x 1/32; 1 of 252 splits
    assert "cadences differ" in row(text, "phase lag below the baseline's at 4 m/s")  # 8 % off the teacher's
    assert "after results were seen" in row(text, "baseline MSE of pelvis height")
    assert "before results were seen" in row(text, "mean speed")
    mse = "ROM-GRL MSE of right foot x"
    assert cells(rows(text, mse)[1]) == [mse, "≤ 0.07136 m²", *("0.012", "0.002") * 3]
    assert cells(rows(text, "average reduction")[1])[2:] == ["88", "98"] * 3  # 1 - 0.002 / 0.1
    assert "the numbers below are of seeds 0, 1, 2, 3, 4 (chose the settings)" in text
    error = cells(row(text, "average, aligned"))
    assert error[1:4] == ["0.1", "0.012", "0.002"]
    assert error[6:] == ["1", "0.0312", "0.00397"]
    nulls = cells(row(text, "error over variance, mean"))
    assert nulls[1:] == [
        "0.04 [0.04, 0.04]",
        "-",
        "-",
        "0.24 [0.216, 0.264]",
        "-",
        "-",
        "2 [2, 2]",
    ]  # teacher, student and baseline, over 0.05 m²
    assert cells(row(text, "falls [%]"))[1:4] == ["0 [0, 0]"] * 3
    assert cells(row(text, "stride frequency [Hz]"))[1:] == [
        "1.5 [1.5, 1.5]",
        "1.62 [1.62, 1.62]",
        "1.5 [1.5, 1.5]",
        "1.35 to 1.6",
    ]
    assert row(text, "strides as often as the teacher").rstrip("│ ").endswith("not reached")  # 1.62 Hz against 1.5
    for claim in ("average reduction of 80 %", "average reduction surely above 66 %", "no fall", "mean speed"):
        assert row(text, claim).rstrip("│ ").endswith("│ reached")
    assert "4 m/s, 5 seeds, 100 episodes of 1000 steps" in text
    assert text.count("used: ") == 5
    assert "warning" not in text
    assert "1 m/s" not in text.replace("mean speed", "")


def test_few_seeds_short_episodes_and_what_would_help(verify: Composer, tmp_path: Path) -> None:
    for seed in range(2):
        finish(tmp_path, verify(f"seed={seed}"))
    text = printed(verify())
    assert TOO_FEW in row(text, "average reduction")
    assert "more seeds: python -m romgrl -m seed=0,1,2,3,4 speed=4\n" in text
    assert "90 (90 to 90)" in row(text, "average reduction")  # a range, no interval
    for seed in range(2, 5):
        finish(tmp_path, verify(f"seed={seed}"))
    text = printed(verify())
    assert TOO_SHORT in row(text, "no fall")  # 16 episodes of 300 steps
    assert row(text, "average reduction").rstrip("│ ").endswith("reproduced")


def test_held_out_seeds_are_judged_alone(verify: Composer, tmp_path: Path) -> None:
    finish(tmp_path, verify("seed=0"), student=0.09)
    for seed in (5, 6):
        finish(tmp_path, verify(f"seed={seed}"), student=0.01 * (seed - 4))
    text = printed(verify())
    assert "4 m/s, 3 seeds" in text
    assert "the numbers below are of seeds 5, 6 (held out)\n" in text
    assert "85 (80 to 90)" in row(text, "average reduction")
    assert "more seeds: python -m romgrl -m seed=5,6,7,8,9 speed=4\n" in text


def test_phase_lags_are_compared_at_one_cadence(verify: Composer, tmp_path: Path) -> None:
    lag = "phase lag below the baseline's at 4 m/s"
    for seed in range(5):
        gait = {"stride_frequency_hz": 1.57, "phase_lag_strides": 0.01 * (seed + 1)}  # 4.7 % off
        finish(tmp_path, verify(f"seed={seed}"), gait=gait)
    found = cells(row(printed(verify()), lag))
    # the baseline's lag is 0.05: differences of 4 3 2 1 0 hundredths, the sign of the last one is free, 2 of 32
    assert found[4] == "p = 0.0625, P = 0.9"
    assert found[-1] == "not reproduced"
    finish(tmp_path, verify("seed=4"), gait={"stride_frequency_hz": 1.58}, revision="b" * 40)  # 5.3 %
    assert "cadences differ" in row(printed(verify()), lag)
    finish(tmp_path, verify("seed=4"), gait={"stride_frequency_hz": math.nan}, revision="c" * 40)
    assert "cadences differ" in row(printed(verify()), lag)


def test_only_the_settings_that_were_asked_for(verify: Composer, tmp_path: Path) -> None:
    mine = [finish(tmp_path, verify(f"seed={seed}")) for seed in range(3)]
    other = finish(tmp_path, verify("seed=0", "eta=0.4", "student.gamma=0.9"), student=0.09)
    old = finish(tmp_path, verify("seed=1"), student=0.09, revision="b" * 40)
    again = finish(tmp_path, verify("seed=1"), revision="c" * 40)
    damaged = finish(tmp_path, verify("seed=4"))
    (damaged / "mse.csv").write_text("x\n", encoding="utf-8")
    selection = select(tmp_path, verify())
    assert [each.directory for each in selection.used] == [mine[0], again, mine[2]]
    assert selection.seeds == [0, 1, 2]
    assert selection.left_out[other] == "student.gamma 0.9 instead of 0.98, eta 0.4 instead of 0.3"
    assert "newer one of seed 1" in selection.left_out[old]
    assert "SHA-256" in selection.left_out[damaged]
    text = printed(verify())
    assert f"left out: {other.name}: student.gamma 0.9 instead of 0.98, eta 0.4 instead of 0.3" in text
    assert "warning: 2 versions of code" in text


def test_an_evaluation_whose_student_is_gone_does_not_count(verify: Composer, tmp_path: Path) -> None:
    directory = finish(tmp_path, verify())
    for path in tmp_path.glob("artifacts/student/*/manifest.json"):
        path.unlink()
    selection = select(tmp_path, verify())
    assert selection.used == []
    assert selection.left_out[directory] == "its student is not there any more"


def test_a_baseline_that_varies_wildly_is_told(verify: Composer, tmp_path: Path) -> None:
    for seed, baseline in enumerate((0.05, 0.1, 0.4)):
        finish(tmp_path, verify(f"seed={seed}"), baseline=baseline)
    text = printed(verify())
    assert "warning: the baseline varies wildly over seeds (pelvis_y 103%" in text
    assert "0.183" in row(text, "average")  # the mean of the three
    assert "0.05" in row(text, "average")
    assert "0.4" in row(text, "average")


def test_a_seed_that_fell_counts_against_the_claims(verify: Composer, tmp_path: Path) -> None:
    for seed in range(5):
        finish(tmp_path, verify(f"seed={seed}"), comparable=seed != 3, gait={"falls": 90.0 if seed == 3 else 0.0})
    text = printed(verify())
    assert "not reproduced" in row(text, "average reduction")
    assert "5 (1 without)" in row(text, "average reduction")
    assert "warning: seed 3: student or baseline fell" in text
    assert "not reached" in row(text, "no fall")


def test_a_speed_without_claims_has_its_tables(verify: Composer, tmp_path: Path) -> None:
    finish(tmp_path, verify("speed=2.5"))
    text = printed(verify("speed=2.5"))
    assert "no claim is made about 2.5 m/s" in text
    assert "left_foot_x, raw" in text


def test_nothing_finished_is_one_line_with_the_command(verify: Composer, tmp_path: Path) -> None:
    with pytest.raises(ArtifactError, match="no finished evaluation of this configuration; python -m romgrl -m seed=5"):
        run(verify())
    finish(tmp_path, verify("eta=0.4"))
    with pytest.raises(ArtifactError) as raised:
        run(verify("speed=1"), overrides=["stage=verify", "speed=1"])
    assert raised.value.exit_code == 3
    assert str(raised.value) == (
        f"{tmp_path}: no finished evaluation of this configuration (1 with other settings or damaged); "
        "python -m romgrl -m seed=5,6,7,8,9 speed=1 makes it"
    )


def claim(**changes: object) -> Claim:
    fields = {"id": "x", "of": "paper", "speed": 4, "measure": "m", "unit": "%", "source": "here", "set": "then"}
    return Claim(**(fields | {"relation": "at_least", "value": 44.4, "judged_by": "interval"} | changes))


@pytest.mark.parametrize(
    ("changes", "low", "high", "seeds", "verdict"),
    [
        ({}, 45, 60, 5, "reproduced"),
        ({}, 20, 44, 5, "not reproduced"),
        ({}, 40, 60, 5, "not reproduced"),  # open
        ({}, 45, 60, 4, "too few seeds"),
        ({}, 20, 44, 4, "too few seeds"),
        ({"of": "project"}, 45, 60, 5, "reached"),
        ({"of": "project"}, 20, 30, 5, "not reached"),
        ({"relation": "at_most"}, 20, 44, 5, "reproduced"),
        ({"relation": "above", "value": 66}, 66, 70, 5, "not reproduced"),
        ({"relation": "at_least", "value": 66}, 66, 70, 5, "reproduced"),
        ({"relation": "about", "tolerance": 5}, 40, 49, 5, "reproduced"),
        ({"relation": "about", "tolerance": 5}, 50, 51, 5, "not reproduced"),
        ({"judged_by": "mean"}, 0, 100, 5, "reproduced"),
        ({"judged_by": "mean"}, 0, 100, 4, "too few seeds"),
        ({"judged_by": "mean", "value": 51}, 0, 100, 5, "not reproduced"),
    ],
)
def test_the_rule(changes: dict[str, object], low: float, high: float, seeds: int, verdict: str) -> None:
    assert decide(claim(**changes), 50.0, Interval(low, high), [50.0] * seeds) == verdict


def test_the_rule_for_every_seed_and_for_missing_numbers() -> None:
    fall = claim(relation="at_most", value=0, judged_by="every_seed")
    assert decide(fall, 0.2, NOWHERE, [1.0]) == "not reproduced"  # one fall is enough
    assert decide(fall, 0.0, NOWHERE, [0.0] * 4) == "too few seeds"
    assert decide(fall, 0.0, NOWHERE, [0.0] * 5) == "reproduced"
    assert decide(fall, 0.0, NOWHERE, [0.0] * 5, brief=True) == "evaluated too briefly"
    assert decide(claim(), 90.0, Interval(80, 95), [90.0] * 4 + [math.nan]) == "not reproduced"


def test_what_is_better_is_judged_by_its_p() -> None:
    better = claim(relation="better", way="larger", than="y", judged_by="paired_p")
    assert decide(better, 1 / 32, NOWHERE, [50.0] * 5) == "reproduced"
    assert decide(better, 2 / 32, NOWHERE, [50.0] * 5) == "not reproduced"
    assert decide(better, 1 / 16, NOWHERE, [50.0] * 4) == "too few seeds"  # four pairs cannot have less


def test_the_claims_are_the_papers_table() -> None:
    claims = {each.id: each for each in read_claims()}
    assert len(claims) == len(read_claims())
    by_measure = {each.measure: each.value for each in claims.values() if each.source == "Table 1"}
    reductions = [by_measure[f"{channel}/aligned/reduction_percent"] for channel in CHANNELS]
    for channel, reduction in zip(CHANNELS, reductions, strict=True):
        student, baseline = (by_measure[f"{channel}/aligned/{name}"] for name in ("student", "baseline"))
        assert 100 * (1 - student / baseline) == pytest.approx(reduction, abs=0.06)  # the table fits itself
    assert sum(reductions) / 5 == pytest.approx(by_measure["average/aligned/reduction_percent"], abs=0.06)
    assert {each.of for each in claims.values()} == {"paper", "project"}
    when = {"paper": {"by the paper", "after results were seen"}, "project": {"before results were seen"}}
    assert {of: {each.set for each in claims.values() if each.of == of} for of in when} == when
    for each in claims.values():
        assert (each.judged_by == "paired_p") == (each.relation == "better"), each.id
        assert not each.tolerance or each.of == "project" or each.set == "after results were seen", each.id


def test_what_an_evaluation_came_from_is_there_and_whole(tmp_path: Path, compose_config: Composer) -> None:
    """Damaged tables of its teacher are not read, nor is it where a stage before it is gone."""
    directory = finish(tmp_path, compose_config("seed=0"))
    (teacher,) = (tmp_path / "artifacts" / "teacher").iterdir()
    (teacher / "content.txt").write_text("else", encoding="utf-8")
    assert evaluations(tmp_path)[0] == []
    assert "SHA-256" in evaluations(tmp_path)[1][directory]
    shutil.rmtree(teacher)
    assert evaluations(tmp_path) == ([], {directory: "its teacher is not there any more"})
