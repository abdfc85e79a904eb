"""docs/results.md and the README's table from sweeps."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest

from romgrl.artifacts import storage
from romgrl.config.schema import Config
from romgrl.errors import StorageError
from romgrl.results import results_document, statistics, sweep_tables
from romgrl.results.__main__ import main
from romgrl.results.readme_table import END, START, runs_table
from romgrl.results.results_document import finished_sweeps, same_speeds
from romgrl.results.sweep_cells import results
from romgrl.results.sweep_record import public, read_sweep
from tests.results.chains import changed
from tests.results.test_sweep_tables import swept


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(statistics, "RESAMPLES", 999)
    monkeypatch.setattr(
        sweep_tables,
        "save_figures",
        lambda cells, jobs, title, directory: (directory / "by_x.png").write_text(title, encoding="utf-8"),
    )


def stored(outputs: Path, config: Config, place: str, name: str, values: dict[str, list[str]], fail: str = "-") -> None:
    """A sweep of the file `name`, in its own directory."""
    sweep = swept(outputs, config, values, fail=fail)
    path = sweep.directory / "sweep.json"
    command = f"python -m romgrl --config-dir /home/me/sweeps --config-name {name} paths.outputs=/home/me/o"
    changes = {"name": name, "command": command, "started": len(place)}
    path.write_text(json.dumps(json.loads(path.read_text(encoding="utf-8")) | changes), encoding="utf-8")
    sweep.directory.rename(outputs / "sweeps" / place)


def test_every_sweep_with_its_command_its_tables_and_its_proofs(default_config: Config, tmp_path: Path) -> None:
    outputs, docs = tmp_path / "outputs", tmp_path / "docs"
    values = {"speed": ["4.0", "1.0"], "seed": ["0", "1", "2"]}
    stored(outputs, default_config, "a", "paper", values, fail="speed=1.0 seed=2")
    more = {"speed": ["4.0"], "seed": ["3", "4", "5", "6"]}  # more seeds, another time
    stored(outputs, default_config, "aa", "paper", more)
    stored(outputs, changed(default_config, "student.total_steps=1000"), "aaa", "eta", {"eta": ["0.3", "0.7"]})
    for path in outputs.glob("sweeps/aaa/sweep.json"):
        path.write_text(
            json.dumps(json.loads(path.read_text(encoding="utf-8")) | {"usual": {"student.total_steps": 2000}}),
            encoding="utf-8",
        )
    readme = tmp_path / "README.md"
    readme.write_text(f"before\n{START}\nold\n{END}\nafter\n", encoding="utf-8")
    assert main([str(outputs), str(docs), str(readme)]) == 0
    text = (docs / "results.md").read_text(encoding="utf-8")
    assert text.count("    python -m romgrl --config-dir sweeps --config-name paper\n") == 1
    assert str(tmp_path) not in text
    assert "/home" not in text
    assert "9 of 10 jobs finished" in text
    assert "- speed=1.0 seed=2: student: loss = nan at step 7" in text
    assert "### Claims at 4 m/s, teacher of 4 m/s\n\nSeeds 5, 6 (held out).\n" in text
    row = "| average reduction | Table 1 | ≥ 44.4 % | by the paper | 86.1 (86 to 86.2) | 2 | interval | too few seeds |"
    assert row in text
    assert "### Claims at 4 m/s, teacher of 4 m/s, seeds that chose the settings\n\nSeeds 0, 1, 2, 3, 4 (chose" in text
    found = r"\| average reduction \| Table 1 \| ≥ 44.4 % \| by the paper \| 84.9 \[84.\d+, 85.\d+\] \| 5 \| interval"
    assert re.search(rf"{found} \| reproduced", text)
    assert "### Claims at 1 m/s, teacher of 4 m/s\n\nSeeds 0, 1 (chose the settings).\n" in text
    assert text.count("one seed, short budget") == 2  # the cells of eta
    assert "![eta, by_x](results/eta_by_x.png)" in text
    claims = pd.read_csv(docs / "results" / "paper_claims_4_teacher_4_chosen.csv")
    assert set(claims["verdict"]) >= {"reproduced", "not reproduced", "reached", "evaluated too briefly"}
    assert set(pd.read_csv(docs / "results" / "paper_claims_4_teacher_4.csv")["verdict"]) == {"too few seeds"}
    comparisons = pd.read_csv(docs / "results" / "paper_comparisons_4_teacher_4_chosen.csv")
    assert comparisons["p, paired"].tolist() == ["1", "1", "1", "-"]  # all walk alike, of unknown cost
    jobs = pd.read_csv(docs / "results" / "paper_jobs.csv")
    assert jobs["seed"].tolist() == [0, 1, 2, 0, 1, 2, 3, 4, 5, 6]
    for digest in jobs["digest"].dropna():
        assert f"| {digest[:16]} |" in text

    table = readme.read_text(encoding="utf-8")
    assert table.startswith("before\n")
    assert table.endswith("after\n")
    assert "old" not in table
    titles = ["4 m/s, 2 seeds (held out)", "4 m/s, 5 seeds (chose the settings)"]
    titles += ["1 m/s, 2 seeds (chose the settings), teacher of 4 m/s"]
    assert f"| mean (smallest to largest) | {' | '.join(titles)} |" in table
    assert (
        "| aligned error, average: reduction [%] | 86.1 (86.0 to 86.2) | 84.9 (84.0 to 85.7) | 84.3 (84.0 to 84.5) |"
        in table
    )
    assert "| student: MMD² | - | - | - |" in table  # these evaluations have no such numbers
    assert "| statue: error over variance | - | - | - |" in table


def test_students_of_one_speed_stand_beside_one_another(default_config: Config, tmp_path: Path) -> None:
    """Those of sweeps over seeds and speeds alone, and of speeds that several have."""
    for place, name, values in (
        ("a", "paper", {"seed": ["5", "6"]}),
        ("bb", "walking", {"seed": ["5"]}),
        ("ccc", "eta", {"eta": ["0.3", "0.7"], "seed": ["5"]}),
    ):
        stored(tmp_path, default_config, place, name, values)
    section = same_speeds(finished_sweeps(tmp_path))
    rows = section[-1].splitlines()[2:]
    assert [row.split(" | ")[:4] for row in rows] == [
        ["| 4", "paper", "4", "5, 6"],
        ["| 4", "walking", "4", "5"],
    ]
    assert rows[0].endswith("too few seeds |")
    shutil.rmtree(tmp_path / "sweeps" / "bb")
    assert same_speeds(finished_sweeps(tmp_path)) == []


def test_the_readmes_table_has_distances_floors_and_null_models(default_config: Config, tmp_path: Path) -> None:
    stored(tmp_path, default_config, "a", "paper", {"seed": ["0"]})
    (job,) = results(read_sweep(tmp_path / "sweeps" / "a"), tmp_path)
    numbers = {"mmd/all/student": 0.00612, "mmd/all/teacher_floor": -0.0003, "dtw/all/baseline": 1.3018}
    numbers |= {"student/error_over_variance": 0.1651, "teacher/error_over_variance": 0.0767}
    numbers |= {"error_over_variance/average/statue": 0.9744, "aligned_reduction_percent/average/statue": 65.22}
    numbers |= {"aligned_reduction_percent/mean_error/student": 97.583}
    table = runs_table([replace(job, numbers=numbers)])
    shown = dict(zip(table.iloc[:, 0], table.iloc[:, 1], strict=True))
    assert shown["student: MMD²"] == "0.0061"
    assert shown["teacher against itself: MMD²"] == "-0.0003"
    assert shown["baseline: DTW [SD of the teacher]"] == "1.302"
    assert shown["student: error over variance"] == "0.17"
    assert shown["teacher against itself: error over variance"] == "0.08"
    assert shown["statue: error over variance"] == "0.97"
    assert shown["the same average of a statue [%]"] == "65.2"
    assert shown["aligned error, mean of the channels: reduction [%]"] == "97.6"
    assert shown["student: DTW [SD of the teacher]"] == "-"


def test_the_readme_has_what_stands_in_the_students_place(default_config: Config, tmp_path: Path) -> None:
    outputs, readme = tmp_path / "outputs", tmp_path / "README.md"
    readme.write_text(f"{START}\n{END}\n", encoding="utf-8")
    stored(outputs, default_config, "a", "paper", {"speed": ["4.0"], "seed": ["5", "6"]})
    assert main([str(outputs), str(tmp_path / "docs"), str(readme)]) == 0
    assert "in the student's place" not in readme.read_text(encoding="utf-8")
    stored(outputs, default_config, "aa", "fair", {"comparison": ["student", "same_choice"], "seed": ["5", "6"]})
    assert main([str(outputs), str(tmp_path / "docs"), str(readme)]) == 0
    text = readme.read_text(encoding="utf-8")
    assert (
        "| walker | seeds | error over variance | largest channel | falls [%] | p, unpaired, largest channel |" in text
    )
    for walker in ("student", "same_choice", "baseline"):
        assert f"| {walker} | 5, 6 |" in text
    assert "What the imitation alone is worth: " in text
    assert "Other settings" not in text
    stored(outputs, default_config, "aaa", "paper_discriminator", {"noise": ["0.1", "0.2"], "seed": ["5", "6"]})
    assert main([str(outputs), str(tmp_path / "docs"), str(readme)]) == 0
    shown = [line for line in readme.read_text(encoding="utf-8").splitlines() if "paper_discriminator" in line]
    begun = [f"| paper_discriminator, noise={noise} | 5, 6 | " for noise in ("0.1", "0.2")]
    assert [row[: len(start)] for row, start in zip(shown, begun, strict=True)] == begun
    assert all(row.endswith(" | 4 (4 to 4) | 0 (0 to 0) | too few seeds |") for row in shown)


def test_trainings_on_another_processor_stand_apart(default_config: Config, tmp_path: Path) -> None:
    """Other bits are other trainings: a sweep that was made again has its own section, table and column."""
    outputs, readme = tmp_path / "outputs", tmp_path / "README.md"
    readme.write_text(f"{START}\n{END}\n", encoding="utf-8")
    for place, processor in (("a", "One"), ("aa", "Two (R)")):
        stored(outputs, default_config, place, "paper", {"seed": ["5", "6"]})
        stored(outputs, default_config, f"{place}f", "fair", {"comparison": ["student", "upright"], "seed": ["5", "6"]})
        for record in (outputs / "sweeps" / name / "sweep.json" for name in (place, f"{place}f")):
            document = json.loads(record.read_text(encoding="utf-8")) | {"machine": {"processor": processor}}
            record.write_text(json.dumps(document), encoding="utf-8")
    assert main([str(outputs), str(tmp_path / "docs"), str(readme)]) == 0
    text = readme.read_text(encoding="utf-8")
    assert "| 4 m/s, 2 seeds (held out) | 4 m/s, 2 seeds (held out), again on Two (R) |" in text
    assert text.count("| upright | 5, 6 |") == 2
    assert "On Two (R), other bits and so other trainings" in text
    document = (tmp_path / "docs" / "results.md").read_text(encoding="utf-8")
    assert [line for line in document.splitlines() if line.startswith("## ")] == [
        "## paper", "## paper on Two (R)", "## fair", "## fair on Two (R)", "## Students of the same speed"
    ]  # fmt: skip
    names = {path.name for path in (tmp_path / "docs" / "results").glob("*jobs.csv")}
    assert names == {f"{name}_jobs.csv" for name in ("paper", "paper_on_Two_R", "fair", "fair_on_Two_R")}


def test_a_second_writing_replaces_the_first(default_config: Config, tmp_path: Path) -> None:
    stored(tmp_path, default_config, "a", "eta", {"eta": ["0.3", "0.7"]})
    assert main([str(tmp_path), str(tmp_path / "docs")]) == 0
    place = tmp_path / "docs" / "results"
    for name in ("eta_by_noise.png", "eta_notes.md", "speed_jobs.csv"):
        (place / name).write_text("of an older writing, of a user, of a sweep that is elsewhere", encoding="utf-8")
    with (place / "files.txt").open("a", encoding="utf-8") as listed:
        listed.write("eta_by_noise.png\nspeed_jobs.csv\n")
    first = (tmp_path / "docs" / "results.md").read_text(encoding="utf-8")
    assert main([str(tmp_path), str(tmp_path / "docs")]) == 0
    assert (tmp_path / "docs" / "results.md").read_text(encoding="utf-8") == first
    names = sorted(path.name for path in (tmp_path / "docs" / "results").iterdir())
    mine = ["eta_by_x.png", "eta_cells.csv", "eta_jobs.csv"]
    assert names == sorted([*mine, "eta_notes.md", "files.txt", "speed_jobs.csv"])
    assert (place / "files.txt").read_text(encoding="utf-8").split() == [*mine, "files.txt"]


def test_documents_are_not_replaced_by_nothing(
    default_config: Config, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stored(tmp_path, default_config, "a", "eta", {"eta": ["0.3", "0.7"]})
    assert main([str(tmp_path), str(tmp_path / "docs")]) == 0
    before = content(tmp_path / "docs")
    for table in tmp_path.glob("artifacts/evaluation/*/mse.csv"):
        table.unlink()
    capsys.readouterr()
    assert main([str(tmp_path), str(tmp_path / "docs")]) == 3
    line = capsys.readouterr().err
    assert line.count("\n") == 1
    assert "no job of its sweeps has numbers" in line
    assert "mse.csv" in line
    assert content(tmp_path / "docs") == before


def content(place: Path) -> dict[str, bytes]:
    """Every file of the documents."""
    return {str(path.relative_to(place)): path.read_bytes() for path in place.rglob("*") if path.is_file()}


def test_what_cannot_be_written_leaves_all_as_it_was(
    default_config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A README without marks, a sweep without its jobs, a full disk."""
    outputs, others, place = tmp_path / "outputs", tmp_path / "others", tmp_path / "place"
    stored(outputs, default_config, "a", "paper", {"seed": ["0"]})
    stored(others, default_config, "a", "eta", {"eta": ["0.3"]})
    (place / "docs" / "results").mkdir(parents=True)
    for name in ("docs/results.md", "docs/results/paper_by_y.png", "docs/results/eta_by_y.png", "bare.md"):
        (place / name).write_text("old", encoding="utf-8")
    (place / "README.md").write_text(f"{START}\nold\n{END}\n", encoding="utf-8")
    (place / "latin.md").write_bytes(b"\xff")
    before = content(place)
    cases = [(outputs, "bare.md", 3), (outputs, "latin.md", 3), (outputs, "none.md", 5), (others, "README.md", 3)]
    for found, readme, code in cases:
        assert main([str(found), str(place / "docs"), str(place / readme)]) == code
        assert len(capsys.readouterr().err.splitlines()) == 1
        assert content(place) == before
    write = storage.write_bytes

    def full(path: Path, text: bytes) -> None:
        if path.name == ".results.md.new":
            raise StorageError(f"{path}: full")
        write(path, text)

    monkeypatch.setattr(results_document, "write_bytes", full)
    assert main([str(outputs), str(place / "docs"), str(place / "README.md")]) == 5
    assert content(place) == before
    assert sorted(path.name for path in (place / "docs" / "results").iterdir()) == ["eta_by_y.png", "paper_by_y.png"]


def test_bad_paths_are_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for arguments in (["", "docs"], ["outputs", ""], ["outputs", "docs", ""]):
        with pytest.raises(SystemExit) as ended:
            main(arguments)
        assert ended.value.code == 2
        assert capsys.readouterr().err.endswith("is empty; name a place\n")
    assert main(["a" * 5000, "docs"]) == 5
    assert capsys.readouterr().err.endswith("a: File name too long\n")
    assert not [*tmp_path.iterdir()]


def test_nothing_to_write_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(tmp_path), str(tmp_path / "docs")]) == 3
    assert "holds no sweep; python -m romgrl --config-dir sweeps" in capsys.readouterr().err
    assert not (tmp_path / "docs").exists()
    for arguments, code in (([], 2), (["--help"], 0)):
        with pytest.raises(SystemExit) as ended:
            main(arguments)
        assert ended.value.code == code
    assert "the directory of results" in capsys.readouterr().out


def test_a_command_is_shown_without_its_machine() -> None:
    words = ["--config-dir=/home/me/sweeps", "speed=1,4", "tracking.uri=http://me:x@host", "humanoid.xml=/a/b.xml"]
    command = " ".join(["python -m romgrl -m", *words])
    assert public(command) == "python -m romgrl -m --config-dir=sweeps speed=1,4 humanoid.xml=b.xml"
