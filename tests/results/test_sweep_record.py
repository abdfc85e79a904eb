"""A job knows its place in a sweep, however many there are, from one reading of what was asked for."""

from __future__ import annotations

from pathlib import Path

import pytest

from romgrl.errors import ArtifactError
from romgrl.results import sweep_record
from romgrl.results.sweep_record import (
    JOBS,
    SWEEP_VARIABLE,
    UNFINISHED,
    JobEnd,
    note_end,
    position,
    public_words,
    sweeps,
    write_sweep,
)


def test_places_of_files_are_left_out_of_lists_too() -> None:
    told = {
        "library.others=[/home/me/a/walk, /home/me/b]": "library.others=[walk, b]",
        "library.others=[/home/me/a],['/home/me/b']": "library.others=[a],['b']",
        "humanoid.xml=/home/me/robot.xml": "humanoid.xml=robot.xml",
        "robustness.mass=[1,2]": "robustness.mass=[1,2]",
        "python -m romgrl": "python -m romgrl",
    }
    assert public_words([*told, "paths.outputs=/home/me"]) == [*told.values()]


def test_the_places_of_a_sweep_are_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    jobs = [[f"seed={seed}", "stage=teacher"] for seed in range(200)]
    write_sweep(tmp_path, "config", "", [*jobs, ["seed=7"]], machine={}, started=0.0, usual={})
    read, whole = [], sweep_record.read_sweep
    monkeypatch.setattr(sweep_record, "read_sweep", lambda directory: (read.append(directory), whole(directory))[1])
    assert [position(job) for job in jobs] == [(place, 201) for place in range(1, 201)]
    assert position(["seed=200"]) is None
    assert read == [tmp_path]
    write_sweep(tmp_path / "other", "config", "", jobs[5:7], machine={}, started=0.0, usual={})
    assert position(jobs[6]) == (2, 2)
    (tmp_path / "other" / "sweep.json").unlink()
    assert position(jobs[6]) is None


def test_a_line_that_was_cut_is_a_job_that_did_not_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And spoils neither the lines before it nor the next one."""
    directory = tmp_path / "sweeps" / "a"
    write_sweep(directory, "fair", "", [["seed=0"], ["seed=1"], ["seed=2"]], machine={}, started=0.0, usual={})
    monkeypatch.setenv(SWEEP_VARIABLE, str(directory))
    note_end(JobEnd(["seed=0"], {"teacher": "/a"}))
    note_end(JobEnd(["seed=1"], {"teacher": "/b"}))
    lines = directory / JOBS
    lines.write_bytes(lines.read_bytes()[:-20])
    note_end(JobEnd(["seed=2"], {"teacher": "/c"}))
    (sweep,) = sweeps(tmp_path)
    assert [sweep.end_of([f"seed={seed}"]).error for seed in range(3)] == [None, UNFINISHED, None]
    (directory / "sweep.json").write_text('{"name"', encoding="utf-8")
    with pytest.raises(ArtifactError, match=r"sweep\.json: cannot be read"):
        sweeps(tmp_path)


@pytest.mark.parametrize(
    ("file", "text", "named"),
    [
        ("sweep.json", "[]", r"\[\] is no mapping"),
        ("sweep.json", '{"name": 1}', "name 1"),
        ("sweep.json", '{"name": "a", "started": "now"}', "started 'now'"),
        ("sweep.json", '{"name": "a", "jobs": ["seed=0"]}', "'seed=0' is no list"),
        ("sweep.json", '{"name": "a"}', "jobs"),
        ("jobs.jsonl", '{"overrides": "seed=0"}', "overrides 'seed=0'"),
        ("jobs.jsonl", '{"overrides": [0]}', r"\[0\] is no list"),
        ("jobs.jsonl", '{"overrides": ["seed=0"], "artifacts": ["/a"]}', r"artifacts \['/a'\]"),
        (
            "sweep.json",
            '{"name": "a", "jobs": [["seed=0"]], "usual": {"student.total_steps": "abc"}}',
            "'abc': not what",
        ),
        ("sweep.json", "[" * 200_000, "recursion"),
        ("jobs.jsonl", '{"overrides": ["seed=0"], "artifacts": {"evaluation": 5}}', "evaluation 5"),
        ("jobs.jsonl", '{"error": "lost"}', "None is no list of overrides"),
    ],
)
def test_other_content_is_refused(file: str, text: str, named: str, tmp_path: Path) -> None:
    directory = tmp_path / "sweeps" / "a"
    write_sweep(directory, "fair", "", [["seed=0"]], machine={}, started=0.0, usual={})
    (directory / file).write_text(text, encoding="utf-8")
    with pytest.raises(ArtifactError, match=f"{file}: cannot be read: .*{named}"):
        sweeps(tmp_path)


def test_what_is_no_text_did_not_end(tmp_path: Path) -> None:
    """As a line that was cut; other lines count."""
    directory = tmp_path / "sweeps" / "a"
    write_sweep(directory, "fair", "", [["seed=0"], ["seed=1"]], machine={}, started=0.0, usual={})
    (directory / JOBS).write_bytes(b"\x95\xff\n" + b"[" * 200_000 + b'\n{"overrides": ["seed=1"]}\n')
    (sweep,) = sweeps(tmp_path)
    assert [sweep.end_of([f"seed={seed}"]).error for seed in range(2)] == [UNFINISHED, None]
