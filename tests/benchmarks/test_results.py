"""Rows in results.json and the table of docs/benchmarks.md."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from benchmarks import __main__ as command
from benchmarks import plots, results
from benchmarks.measure import Options, Result, Unavailable, compare, reached
from benchmarks.peers import started
from benchmarks.rows import ROWS, Row

ROOT = Path(__file__).resolve().parents[2]

MACHINE = {"processor": "p", "cores": 2, "system": "Linux", "versions": {"torch": "2"}, "revision": "abc"}


def row(name: str, **changes: Any) -> results.Row:
    values = {"value": 20.0, "unit": "updates/s", "reference": 10.0, "ratio": 2.0, "target": ">= 2", "reached": True}
    stamp = {"settings": {"batch": 256}, "time": "today", "machine": MACHINE}
    return {"name": name, "status": "measured", **values, **stamp, **changes}


def test_new_rows_replace_old_ones_and_the_rest_stays() -> None:
    merged = results.merge([row("a"), row("b"), row("gone")], [row("b", value=3.0)], ["b", "a", "c"])
    assert [(each["name"], each["value"]) for each in merged] == [("b", 3.0), ("a", 20.0)]


def test_rows_survive_the_file(tmp_path: Path) -> None:
    results.write([row("a")], tmp_path / "results.json")
    assert results.load(tmp_path / "results.json") == [row("a")]
    assert results.load(tmp_path / "none.json") == []


def test_table_marks_what_was_missed_and_what_was_not_measured() -> None:
    rows = [
        row("a"),
        row("b", ratio=1.5, reached=False),
        row("c", status="skipped", reason="no GPU"),
        row("d", reference=None, ratio=None, target=None, reached=None, value=12345.6, unit="steps/s"),
    ]
    lines = results.table(rows, {"a": "First"}).splitlines()[2:]
    assert lines[0] == "| First (`a`) | 20 updates/s | 10 | 2 | >= 2 | reached |"
    assert "| 1.5 | >= 2 | **missed** |" in lines[1]
    assert "skipped: no GPU" in lines[2]
    assert "| 12,346 steps/s |  |  |  |  |" in lines[3]


def test_the_notes_around_the_table_are_kept() -> None:
    page = f"before\n{results.START}\nold table\n{results.END}\nafter\n"
    written = results.document(page, [row("a")], {})
    assert written.startswith("before\n")
    assert written.endswith("\nafter\n")
    assert "old table" not in written
    assert "`a` (today, abc): batch 256" in written
    paced = results.details([row("a", sgemm={"1": 68.0, "2": 139.5})])
    assert paced == "- `a` (today, abc, sgemm 68 GFLOP/s on 1 thread(s), sgemm 139.5 GFLOP/s on 2 thread(s)): batch 256"
    assert results.document(written, [row("a")], {}) == written
    with pytest.raises(ValueError, match="markers"):
        results.document("no markers", [], {})


def test_the_real_page_has_its_markers() -> None:
    assert results.document(results.DOCUMENT.read_text(encoding="utf-8"), [row("a")], {})


@pytest.mark.parametrize(
    ("number", "target", "answer"), [(2.0, ">= 2", True), (1.9, ">= 2", False), (1, "<= 1.5", True)]
)
def test_targets(number: float, target: str, answer: bool) -> None:
    assert reached(number, target) is answer


def test_compare_gives_medians_and_the_range_of_the_ratio() -> None:
    ours, other = iter([99.0, 4.0, 8.0, 6.0]), iter([99.0, 2.0, 2.0, 3.0])
    result = compare(lambda: next(ours), lambda: next(other), unit="1/s", target=">= 2", settings={}, repeats=3)
    assert (result.value, result.reference, result.ratio) == (6.0, 2.0, 3.0)
    assert result.settings == {"repeats": 3, "ratio_range": [2.0, 4.0]}
    assert result.reached


def test_unknown_row_is_one_line(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.argv", ["benchmarks", "nonsense"])
    assert command.main() == 2
    assert capsys.readouterr().err.splitlines() == ["no row nonsense; python -m benchmarks --list names them"]


@pytest.mark.slow
def test_a_row_that_fails_says_so_and_does_not_stop_the_rest(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(options: Options) -> Result:
        raise RuntimeError("it broke")

    def absent(options: Options) -> Result:
        raise Unavailable("no GPU")

    monkeypatch.setitem(ROWS, "broken", Row("x", broken))
    monkeypatch.setitem(ROWS, "absent", Row("x", absent))
    monkeypatch.setitem(ROWS, "good", Row("x", lambda options: Result(1.0, "s")))
    monkeypatch.setattr("sys.argv", ["benchmarks", "broken", "absent", "good"])
    assert command.main() == 1
    printed = capsys.readouterr().out.replace("}\n{", "}\0{").split("\0")
    statuses = [(each["status"], each.get("reason")) for each in map(json.loads, printed)]
    assert statuses == [("failed", "RuntimeError: it broke"), ("skipped", "no GPU"), ("measured", None)]


def test_plots_are_drawn_from_the_series(tmp_path: Path) -> None:
    environments = [{"x": 1, "y": 10.0}, {"x": 4, "y": 30.0}]
    sizes = [{"x": 64, "width": 128, "y": 90.0}, {"x": 256, "width": 128, "y": 40.0}]
    stages = [{"x": 1, "teacher": 3.0, "student": 5.0}, {"x": 2, "teacher": 2.0, "student": 3.0}]
    rows = [
        row(name, settings={"series": series})
        for name, series in (
            ("scaling_rom", environments),
            ("scaling_humanoids", environments),
            ("scaling_updates", sizes),
            ("scaling_threads", stages),
        )
    ]
    names = [path.name for path in plots.draw(rows, tmp_path)]
    assert names == ["scaling_environments.png", "scaling_training.png"]
    assert all((tmp_path / name).stat().st_size > 10_000 for name in names)
    assert plots.draw(rows[:1], tmp_path) == []


def test_gpu_row_is_skipped_with_a_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    measured = command.measure("student_cuda", Options(threads=1, quick=True))
    assert (measured["status"], measured["reason"].split(" (")[0]) == ("skipped", "no GPU is at hand")


def test_a_peer_without_its_environment_is_skipped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("benchmarks.peers.ENVIRONMENTS", ROOT / "benchmarks" / ".no-peers")
    with (
        pytest.raises(Unavailable, match=r"make benchmarks/\.no-peers/rl/\.built"),
        started("rl", "sb3_sac.py", threads=1),
    ):
        pass
