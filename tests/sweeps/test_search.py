"""Searches as commands, with stages that take milliseconds; a real one is slow."""

from __future__ import annotations

import csv
import math
import subprocess
import sys
from pathlib import Path

import pytest

from romgrl.cli.arguments import faults
from romgrl.cli.command import objective_after
from romgrl.errors import ConfigurationError, DivergenceError, RomgrlError, StorageError
from romgrl.report.objective import objective_names, objective_of
from romgrl.report.terminal_tables import result_metrics, with_falls, with_weakest
from romgrl.results.sweep_record import sweeps
from tests.helpers.jobs import ROOT, Command, start, trainings
from tests.helpers.limits import PATIENCE

SPACE = ("eta=interval(0.1,0.9)", "discriminator.window=1,2")
BASE = ("-m", "hydra/sweeper=optuna", "experiment=smoke", "stage=evaluation")
SEARCH = (*BASE, *SPACE, "objective=average/raw/reduction_percent", "tracking=none", "hydra.sweeper.n_trials=2")


def told(outputs: Path) -> list[dict[str, str]]:
    """The trials of the last search."""
    path = sorted(outputs.glob("sweeps/*/results/trials.csv"))[-1]
    return list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))


def test_a_search_goes_on_where_it_stopped(command: Command, tmp_path: Path) -> None:
    outputs = tmp_path / "outputs"
    stopped = command(*SEARCH, FAKE_FAULT="student:interrupt")
    assert stopped.returncode == 130
    result = command(*SEARCH)
    assert result.returncode == 0, result.stderr
    assert "search: 0 of 2 trials are done, 1 to be tried again" in result.stdout
    assert "job 2 of 2: " in result.stdout
    rows = told(outputs)
    assert [row["ended"] for row in rows] == ["failed", "finished", "finished"]
    assert rows[1] == rows[0] | {"trial": "1", "ended": "finished", "objective": "50.0"}
    assert f"search: best average/raw/reduction_percent = 50 of trial 1: eta={rows[1]['eta']} " in result.stdout
    sweep = sweeps(outputs)[-1]
    assert len(sweep.jobs) == 2
    assert "eta" in sweep.swept
    assert (sweep.directory / "results" / "jobs.csv").exists()
    assert (outputs / "optuna.db").exists()


@pytest.mark.slow
def test_a_search_whose_trainings_diverge_goes_on_and_says_so(command: Command, tmp_path: Path) -> None:
    result = command(*SEARCH[:-1], "hydra.sweeper.n_trials=1", FAKE_FAULT="student:diverge")
    assert result.returncode == 4
    assert "Traceback" not in result.stderr
    assert "search: no trial has average/raw/reduction_percent" in result.stderr.splitlines()
    assert [(row["ended"], row["objective"]) for row in told(tmp_path / "outputs")] == [("no number", "")]


def test_without_optuna_nothing_begins(tmp_path: Path) -> None:
    script = "import sys; sys.modules['optuna'] = None; from tests.helpers.fake_stages import main; main()"
    arguments = [sys.executable, "-c", script, *SEARCH, f"paths.outputs={tmp_path}/outputs"]
    result = subprocess.run(arguments, cwd=ROOT, capture_output=True, text=True, encoding="utf-8", check=False)
    assert result.returncode == 2
    assert result.stderr == "hydra/sweeper=optuna: is not installed; pip install optuna, the extra romgrl[optuna]\n"
    assert result.stdout == ""
    assert not list(tmp_path.iterdir())


AMISS = {  # by what is told together
    "objective": {
        "objective=average/aligned/reduction": "average/aligned/reduction is not allowed; allowed: a number of"
    },
    "stage": {"stage=report": "report is not allowed; allowed: all, evaluation, teacher, whose numbers"},
    "intervals": {
        "eta=interval(0.5,0.1)": "is no interval; write interval(LOW,HIGH) or",
        "noise=tag(log,interval(0,1))": "is no interval; write interval(LOW,HIGH) or",
        "student.mirror=interval(0,1)": "student.mirror is no number; allowed: true",
    },
    "values": {
        "eta=interval(0.5,2)": "2.0 is not allowed; allowed: a number >= 0 and <= 1",
        "discriminator.window=1,99": "99 is not allowed; allowed: a whole number >= 1",
        "hydra.sweeper.n_trials=0": "0 is not allowed; allowed: a whole number >= 1",
        "hydra.sweeper.n_jobs=a": "a is not allowed; allowed: a whole number >= 1",
        "hydra.sweeper.direction=up": "up is not allowed; allowed: maximize, minimize",
        "hydra.sweeper.storage=/": "/ is not allowed; allowed: a file that can be written",
        "hydra.sweeper.seed=-1": "-1 is not allowed; allowed: a whole number from 0 to",
    },
}


@pytest.mark.parametrize("together", AMISS)
def test_what_no_search_can_be_after_is_told_on_one_line_each(together: str) -> None:
    amiss = AMISS[together]
    given = {text.partition("=")[0] for text in amiss}
    found = faults([text for text in (*BASE, SPACE[0]) if text.partition("=")[0] not in given] + [*amiss])
    assert len(found) == len(amiss), found
    for text, words in amiss.items():
        key = text.partition("=")[0]
        assert any(line.startswith((f"{text}: {words}", f"{key}: {words}")) for line in found), (text, found)


def test_a_search_varies_something_and_a_sweep_has_an_end() -> None:
    (line,) = faults(BASE)
    assert line.startswith("hydra/sweeper=optuna: there is nothing to search; ")
    (line,) = faults(["-m", "eta=interval(0.1,0.9)"])
    assert line.startswith("eta=interval(0.1,0.9): has no end; list the values of eta, or add hydra/sweeper=optuna; ")
    assert not faults([*BASE, *SPACE])
    assert not faults(["--config-dir=sweeps", "--config-name=tune"])


def test_the_objective_is_a_number_of_the_walkers_that_do_not_fall(tmp_path: Path) -> None:
    head, errors = "walker,episodes,falls,duty_factor\n", "channel,alignment,student,note\n"
    (tmp_path / "gait.csv").write_text(f"{head}student,10,2,0.4\nbaseline,10,6,0.6\n", encoding="utf-8")
    (tmp_path / "mse.csv").write_text(f"{errors}average,raw,0.02,ok\naverage,aligned,,fell\n", encoding="utf-8")
    names = ("average/raw/student", "student/duty_factor", "student/falls_percent", "baseline/falls_percent")
    assert [objective_of(name, {"evaluation": tmp_path}) for name in names] == [0.02, 0.4, 20.0, 60.0]
    for name in ("average/aligned/student", "baseline/duty_factor"):
        assert math.isnan(objective_of(name, {"evaluation": tmp_path}))
    assert math.isnan(objective_of(names[0], {}))


@pytest.mark.parametrize(
    ("error", "bad"), [(DivergenceError("a"), True), (ConfigurationError("a"), True), (StorageError("a"), False)]
)
def test_a_job_that_failed_says_whether_its_settings_are_to_blame(error: RomgrlError, *, bad: bool) -> None:
    after = objective_after(error)
    assert (after is not None and math.isnan(after)) if bad else after is None


@pytest.mark.slow
def test_a_finished_search_goes_on_when_it_may_try_more(command: Command, tmp_path: Path) -> None:
    assert command(*SEARCH).returncode == 0
    finished = trainings(tmp_path / "outputs")
    again = command(*SEARCH)
    assert again.returncode == 0, again.stderr
    assert "search: 2 of 2 trials are done, 0 to be tried again" in again.stdout
    assert trainings(tmp_path / "outputs") == finished
    more = command(*SEARCH[:-1], "hydra.sweeper.n_trials=3")
    assert more.returncode == 0, more.stderr
    assert len(told(tmp_path / "outputs")) == 3


@pytest.mark.slow
def test_jobs_side_by_side_are_told_too(tmp_path: Path) -> None:
    launched = ("hydra/launcher=joblib", "hydra.sweeper.n_jobs=2", f"paths.outputs={tmp_path}")
    process = start(*SEARCH, *launched, module="tests.helpers.fake_jobs")
    out, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0, err
    assert "sweep: 2 jobs, 2 at once" in out
    assert [row["ended"] for row in told(tmp_path)] == ["finished"] * 2


@pytest.mark.slow
def test_a_real_search(tmp_path: Path) -> None:
    """Nothing learns to walk in it, so how often it falls is the number that there is."""
    few = ("hydra.sweeper.n_trials=3", "hydra.sweeper.direction=minimize", "objective=student/falls_percent")
    process = start(*BASE, *SPACE, *few, f"paths.outputs={tmp_path}", module="romgrl")
    out, err = process.communicate(timeout=PATIENCE)
    assert (process.returncode, err) == (0, "")
    assert "search: best student/falls_percent = 100 of trial 0: " in out
    assert [row["objective"] for row in told(tmp_path)] == ["100.0"] * 3
    found = with_weakest(with_falls(result_metrics(next(tmp_path.glob("artifacts/evaluation/*")))))
    unnamed = {name for name in found if name not in objective_names("evaluation")}
    assert unnamed <= {name for name in found if name.endswith("_episodes")}
    assert list(tmp_path.glob("mlartifacts/**/trials.csv"))
