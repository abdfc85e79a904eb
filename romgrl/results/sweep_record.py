"""What a sweep was asked for and how each of its jobs ended, as files in its directory.

sweep.json is written when it starts, a line of jobs.jsonl by each job when it ends, in whatever process that runs.
"""

from __future__ import annotations

import json
import os
import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

from romgrl.config.addresses import without_quotes
from romgrl.errors import ArtifactError

SWEEP_VARIABLE = "ROMGRL_SWEEP"  # directory of the sweep, for its jobs
SWEEP, JOBS, RESULTS = "sweep.json", "jobs.jsonl", "results"
UNFINISHED = "did not end"
END_KINDS = {"overrides": list, "artifacts": dict, "seconds": float | int, "error": str | None}
SWEEP_KINDS = {
    "name": str,
    "command": str,
    "jobs": list,
    "machine": dict,
    "started": float | int,
    "usual": dict,
    "trials": int,
}
HOW = ("hydra", "paths", "tracking", "threads", "device", "parallel_stages", "checkpoint_seconds", "stage", "objective")
PLACES = re.compile(r"(?<![\w.:/])/[^\s,\[\]'\"]+")
"""Absolute paths in a text, as in a list of them."""
PRIVATE = ("paths", "tracking")  # what of a command is about one machine


@dataclass(frozen=True)
class JobEnd:
    """How a job ended: its stages' artifacts, or the line of its failure. `seconds`: how long it ran."""

    overrides: list[str]
    artifacts: dict[str, str] = field(default_factory=dict)
    error: str | None = None
    seconds: float = 0.0


@dataclass(frozen=True)
class Sweep:
    """A sweep: the file that stores it, the command that started it, the overrides of each job, and where it ran.

    `started`: seconds since 1970; `usual`: settings below which the budget of a job counts as short; `trials`: how many
    jobs a search may come to, which are added as it chooses them; `on`: its processor, where the same sweep was made on
    another one first.
    """

    directory: Path
    name: str
    command: str
    jobs: list[list[str]]
    machine: dict[str, Any]
    started: float
    usual: dict[str, float]
    trials: int = 0
    ends: list[JobEnd] = field(default_factory=list)
    on: str = ""

    @property
    def swept(self) -> list[str]:
        """The keys in which its jobs differ, in the order of the overrides."""
        values: dict[str, set[str | None]] = {}
        jobs = [settings(job) for job in self.jobs]
        for key in dict.fromkeys(key for job in jobs for key in job):
            values[key] = {job.get(key) for job in jobs}
        return [key for key, found in values.items() if len(found) > 1]

    @property
    def title(self) -> str:
        """The name of the file that stores it, or the keys that it varies; with its processor where `on` says so."""
        return f"{self.subject} on {self.on}" if self.on else self.subject

    @property
    def subject(self) -> str:
        """The title, whatever it ran on."""
        if self.name != "config":
            return self.name
        stages = sorted({text.partition("=")[2] for job in self.jobs for text in job if text.startswith("stage=")})
        return " ".join(["sweep over", ", ".join(self.swept) or "one job", *(["to", *stages] if stages else [])])

    def end_of(self, job: Sequence[str]) -> JobEnd:
        """How a job ended, the last time where it ran more than once."""
        wanted = settings(job)
        ends = [end for end in self.ends if settings(end.overrides) == wanted]
        return ends[-1] if ends else JobEnd([*job], error=UNFINISHED)


def settings(overrides: Sequence[str]) -> dict[str, str]:
    """Overrides as key and value, without those that only say how and where a job runs."""
    pairs = (text.lstrip("+").partition("=") for text in overrides)
    return {key: without_quotes(value) for key, _, value in pairs if key.partition(".")[0].partition("/")[0] not in HOW}


def public(command: str) -> str:
    """A command without what is about one machine."""
    try:
        parts = shlex.split(command)
    except ValueError:  # an open quotation
        parts = command.split()
    return shlex.join(public_words(parts))


def public_words(words: Sequence[str]) -> list[str]:
    """Words of a command without those that are about one machine, and without the places of files."""
    found = []
    for word in words:
        key, equals, value = word.partition("=")
        if key.lstrip("+").partition(".")[0] not in PRIVATE:
            found.append(f"{key}{equals}{last_part(value)}" if equals else last_part(word))
    return found


def last_part(text: str) -> str:
    """An absolute path as the name at its end, and each of those in any other text, as in a list."""
    return Path(text).name if text.startswith("/") else PLACES.sub(lambda found: Path(found[0]).name, text)


def write_sweep(directory: Path, name: str, command: str, jobs: Sequence[Sequence[str]], **more: Any) -> None:
    """Write down what was asked for, and tell the jobs where. `more`: machine, started, usual."""
    directory.mkdir(parents=True, exist_ok=True)
    document = {"name": name, "command": command, "jobs": [[*job] for job in jobs], **more}
    (directory / SWEEP).write_text(json.dumps(document, indent=2), encoding="utf-8")
    os.environ[SWEEP_VARIABLE] = str(directory)


def add_jobs(directory: Path, jobs: Sequence[Sequence[str]], trials: int) -> None:
    """Add the jobs that a search chose to what its sweep was asked for."""
    document = json.loads((directory / SWEEP).read_text(encoding="utf-8"))
    document |= {"jobs": [*document["jobs"], *map(list, jobs)], "trials": trials}
    whole = directory / f"{SWEEP}.new"
    whole.write_text(json.dumps(document, indent=2), encoding="utf-8")
    whole.replace(directory / SWEEP)


def note_end(end: JobEnd) -> None:
    """Let the sweep that this job belongs to know how it ended; no sweep, no note."""
    directory = os.environ.get(SWEEP_VARIABLE)
    if directory:
        path = Path(directory, JOBS)
        cut = path.exists() and not path.read_bytes().endswith(b"\n")  # a line that a full disk or a power cut left
        with path.open("a", encoding="utf-8") as lines:
            lines.write("\n" * cut + json.dumps(asdict(end)) + "\n")


def position(overrides: Sequence[str]) -> tuple[int, int] | None:
    """Which job of its sweep these overrides make, from 1, and how many there are; None outside a sweep."""
    directory = os.environ.get(SWEEP_VARIABLE)
    try:
        places, jobs = places_of(directory, Path(directory, SWEEP).stat().st_mtime_ns) if directory else ({}, 0)
    except (OSError, ArtifactError):
        return None
    place = places.get(frozenset(settings(overrides).items()))
    return None if place is None else (place, jobs)


@lru_cache(maxsize=1)
def places_of(directory: str, written: int) -> tuple[dict[frozenset[tuple[str, str]], int], int]:
    """The place of each job of a sweep by its settings, from 1, and how many there are; read once in a process."""
    sweep = read_sweep(Path(directory))
    jobs = [frozenset(settings(job).items()) for job in sweep.jobs]
    return {job: place for place, job in reversed([*enumerate(jobs, 1)])}, max(len(jobs), sweep.trials)


def read_sweep(directory: Path) -> Sweep:
    """A sweep from its directory. Raises ArtifactError where its files are not what was written."""
    path = directory / SWEEP
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
        check_kinds(document, SWEEP_KINDS)
        for job in document["jobs"]:
            check_overrides(job)
        usual = document.get("usual", {})
        check_kinds(usual, dict.fromkeys(usual, float | int))
        path = directory / JOBS
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines() if path.exists() else []
        ends = [read_end(line) for line in map(whole_line, lines) if line]
        return Sweep(directory=directory, **document, ends=ends)
    except (OSError, KeyError, RecursionError, TypeError, ValueError) as error:
        raise ArtifactError(f"{path}: cannot be read: {error}") from error


def check_kinds(document: Mapping[str, Any], kinds: Mapping[str, Any]) -> None:
    """Raise TypeError unless what was read is a mapping whose values are of these kinds; missing ones are left out."""
    if not isinstance(document, dict):
        raise TypeError(f"{document!r} is no mapping")
    known = {name: kind for name, kind in kinds.items() if name in document}
    wrong = [f"{name} {document[name]!r}" for name, kind in known.items() if not isinstance(document[name], kind)]
    if wrong:
        raise TypeError(f"{', '.join(wrong)}: not what a sweep writes there")


def check_overrides(job: Any) -> None:
    """Raise TypeError unless a job is a list of overrides."""
    if not isinstance(job, list) or not all(isinstance(text, str) for text in job):
        raise TypeError(f"{job!r} is no list of overrides")


def whole_line(line: str) -> dict[str, Any] | None:
    """What a line of jobs.jsonl says; None of one that was cut: that job did not end."""
    try:
        document = json.loads(line)
    except (RecursionError, ValueError):
        return None
    return document if isinstance(document, dict) else None


def read_end(document: Mapping[str, Any]) -> JobEnd:
    """A line of jobs.jsonl. Raises TypeError."""
    check_kinds(document, END_KINDS)
    check_overrides(document.get("overrides"))
    artifacts = document.get("artifacts", {})
    check_kinds(artifacts, dict.fromkeys(artifacts, str))
    return JobEnd(**document)


def sweeps(outputs: Path) -> list[Sweep]:
    """The sweeps under `outputs`, oldest first. Raises ArtifactError for one that cannot be read."""
    found = [read_sweep(path.parent) for path in sorted(outputs.glob(f"sweeps/*/{SWEEP}"))]
    return sorted(found, key=lambda sweep: sweep.started)
