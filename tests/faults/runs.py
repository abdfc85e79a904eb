"""What a test tells a recorder, and what a store of MLflow has of it, counted in its database row by row."""

from __future__ import annotations

import sqlite3
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from romgrl.tracking.recorder import Recorder

FILES = {"policy.safetensors": b"w" * 3000, "curve.csv": b"step,loss\n", "figures/gait.png": b"p" * 500}
PARAMS = {"seed": 1, "student": {"gamma": 0.98, "sizes": [256, 256]}}


def numbers(step: int) -> dict[str, float]:
    """What a training says at a step."""
    return {"loss": float(step % 7), "return": 0.1 * step, "nothing": float("nan")}


@dataclass
class Told:
    """A job run with one stage below it, told step by step; `blocked` is the time that all calls took together."""

    recorder: Recorder
    directory: Path
    blocked: float = 0.0
    points: list[tuple[str, str, int, float]] = field(default_factory=list)

    @contextmanager
    def timed(self) -> Iterator[None]:
        start = time.perf_counter()
        yield
        self.blocked += time.perf_counter() - start

    def start(self) -> None:
        with self.timed():
            self.job = self.recorder.start("job", tags={"stage": "job"}, params=PARAMS)
            self.stage = self.recorder.start("stage", parent=self.job, tags={"stage": "stage"}, params=PARAMS)

    def steps(self, first: int, last: int) -> None:
        """Tell three numbers for each step."""
        for step in range(first, last):
            with self.timed():
                self.stage.metrics(numbers(step), step)
        self.expect(first, last)

    def expect(self, first: int, last: int) -> None:
        """Somebody told these steps."""
        steps = range(first, last)
        self.points += [("stage", name, step, value) for step in steps for name, value in numbers(step).items()]

    def finish(self) -> str:
        """Publish files, end both runs and let the recorder go; returns the id that the manifest would have."""
        for name, content in FILES.items():
            (self.directory / name).parent.mkdir(parents=True, exist_ok=True)
            (self.directory / name).write_bytes(content)
        with self.timed():
            run_id = self.stage.run_id
            self.stage.artifacts(self.directory)
            self.job.tags({"romgrl.run.stage": str(run_id)})
            self.stage.finish()
            self.job.finish()
            self.recorder.close()
        return str(run_id)


@dataclass
class Stored:
    """What the database of a store has of an experiment."""

    runs: list[tuple[Any, ...]]  # name, status, id
    deleted: int
    points: Counter[tuple[Any, ...]]
    params: Counter[tuple[Any, ...]]
    tags: dict[tuple[str, str], str]


def stored(database: Path, experiment: str) -> Stored:
    """Read the tables of MLflow; a number that is nan reads as None."""
    of_experiment = "runs r join experiments e on r.experiment_id = e.experiment_id and e.name = ?"
    active = f"{of_experiment} and r.lifecycle_stage = 'active'"
    value = "case when m.is_nan then 'nan' else m.value end"
    with closing(sqlite3.connect(f"file:{database}?mode=ro", uri=True)) as store:

        def rows(query: str) -> list[tuple[Any, ...]]:
            return list(store.execute(query, [experiment]))

        tags = rows(f"select r.name, t.key, t.value from tags t join {active} where t.run_uuid = r.run_uuid")
        return Stored(
            runs=sorted(rows(f"select r.name, r.status, r.run_uuid from {active}")),
            deleted=len(rows(f"select r.name from {of_experiment} and r.lifecycle_stage = 'deleted'")),
            points=Counter(
                rows(
                    f"select r.name, m.key, m.step, {value} from metrics m join {active} where m.run_uuid = r.run_uuid"
                )
            ),
            params=Counter(rows(f"select r.name, p.key from params p join {active} where p.run_uuid = r.run_uuid")),
            tags={(run, key): text for run, key, text in tags},
        )


def differences(told: Told, found: Stored, status: str = "FINISHED") -> tuple[int, int]:
    """How much of what was told is not in the store, and how much is there more than once. All else is asserted."""
    expected = Counter((run, key, step, "nan" if value != value else value) for run, key, step, value in told.points)
    names = [name for name, _, _ in found.runs]
    params = Counter((run, key) for run in ("job", "stage") for key in ("seed", "student.gamma", "student.sizes"))
    lost = expected - found.points, params - found.params, Counter(("job", "stage")) - Counter(names)
    twice = found.points - expected, found.params - params, Counter(names) - Counter(("job", "stage"))
    assert {state for _, state, _ in found.runs} == {status}
    ids = {name: run_id for name, _, run_id in found.runs}
    assert found.tags["stage", "mlflow.parentRunId"] == ids["job"]
    assert found.tags["stage", "stage"] == "stage"
    return sum(part.total() for part in lost), sum(part.total() for part in twice)
