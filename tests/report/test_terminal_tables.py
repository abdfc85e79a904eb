"""The tables that end a run."""

from __future__ import annotations

import io
from pathlib import Path

from rich.console import Console

from romgrl.report.terminal_tables import result_metrics, result_tables

MSE = """channel,alignment,baseline,student,reduction_percent,note
pelvis_y,aligned,0.01407,0.00408,71.0,
average,aligned,0.1,0.05,50.0,
pelvis_y,raw,,,,"not comparable: fell"
average,raw,0.2,,,"not comparable: fell"
"""
DISTANCES = """distance,channel,baseline,student,teacher_floor,baseline_p,student_p,floor_p,unit,note
mmd,all,0.5,0.0625,-0.001,0.0005,0.01,0.6,1,ok
dtw,pelvis_y,0.1,0.02,0.01,,,,m,ok
dtw,all,,0.25,0.125,,,,deviations,ok
"""
NULLS = """walker,measure,channel,value
statue,error_over_variance,pelvis_y,1.01
statue,error_over_variance,average,0.97
student,aligned_reduction_percent,mean_error,
"""
GAIT = "walker,falls,mean_speed_m_per_s\nteacher,0,4.01\nstudent,1,3.9\nbaseline,2,\n"


def test_tables_and_metrics(tmp_path: Path) -> None:
    (tmp_path / "mse.csv").write_text(MSE, encoding="utf-8")
    (tmp_path / "distances.csv").write_text(DISTANCES, encoding="utf-8")
    (tmp_path / "gait.csv").write_text(GAIT, encoding="utf-8")
    (tmp_path / "null_models.csv").write_text(NULLS, encoding="utf-8")
    console = Console(file=io.StringIO(), width=100)
    for table in result_tables(tmp_path):
        console.print(table)
    lines = [[cell.strip() for cell in line.split("│")[1:-1]] for line in console.file.getvalue().splitlines()]
    assert ["pelvis_y", "0.0141", "0.00408", "71", "-", "-", "-"] in lines
    assert ["average", "0.1", "0.05", "50", "0.2", "-", "-"] in lines
    assert ["mmd", "0.5", "0.0625", "-0.001", "0.0005", "0.01", "1"] in lines
    assert ["dtw", "-", "0.25", "0.125", "-", "-", "deviations"] in lines
    assert ["mean speed [m/s]", "4.01", "3.90", "-"] in lines
    assert console.file.getvalue().count("not comparable: fell") == 1
    metrics = result_metrics(tmp_path)
    assert metrics["pelvis_y/aligned/reduction_percent"] == 71
    assert metrics["student/falls"] == 1
    assert "baseline/mean_speed_m_per_s" not in metrics
    assert metrics["mmd/all/student_p"] == 0.01
    assert metrics["dtw/all/teacher_floor"] == 0.125
    assert metrics["error_over_variance/average/statue"] == 0.97
    assert len(metrics) == 7 + 5 + 6 + 2 + 1
    assert "aligned: nearest window of all episodes, raw: no shift" in console.file.getvalue()


def test_nothing_to_show(tmp_path: Path) -> None:
    assert result_tables(tmp_path) == []
    assert result_metrics(tmp_path) == {}
