"""Names and descriptions of runs in MLflow, and the numbers that it shows first."""

from __future__ import annotations

from dataclasses import replace

from romgrl.config.schema import Config
from romgrl.pipeline.run_names import job_title, stage_title
from romgrl.report.terminal_tables import HEADLINE, headline


def test_names_tell_what_differs(smoke_config: Config) -> None:
    config = replace(smoke_config, eta=0.3, seed=2)
    overrides = ["eta=0.3", "seed=2", "+student.gamma=0.97", "teacher.alpha=2", "paths.outputs=x", "stage=all"]
    assert (
        stage_title("student", config, overrides)
        == "student v=4 eta=0.3 noise=0.05 s=2 student.gamma=0.97 teacher.alpha=2"
    )
    assert stage_title("teacher", config, overrides) == "teacher v=4 s=2 teacher.alpha=2"
    assert stage_title("baseline", config, overrides) == "baseline v=4 s=2 student.gamma=0.97"
    assert job_title("eta=0.3 seed=2", config, ["eta=0.3", "seed=2"]) == "job v=4 eta=0.3 noise=0.05 s=2"
    assert job_title("job", config, []) == "job v=4 eta=0.3 noise=0.05 s=2"


def test_a_student_without_imitation_says_so(smoke_config: Config) -> None:
    config = replace(smoke_config, discriminator=replace(smoke_config.discriminator, enabled=False))
    title = stage_title("student", config, ["discriminator=none"])
    assert title == "student v=4 eta=1 noise=0 s=0 discriminator=none"


def test_the_numbers_that_matter_come_first() -> None:
    channels = ("pelvis_y", "left_foot_x", "left_foot_z", "right_foot_x", "right_foot_z")
    numbers = {f"{name}/aligned/reduction_percent": 10.0 * i for i, name in enumerate(channels, 1)}
    numbers |= {"average/aligned/reduction_percent": 44.4, "student/episodes": 16.0, "student/falls": 4.0}
    found = headline(numbers)
    assert found == {
        "01_reduction_percent": 44.4,
        "02_weakest_reduction_percent": 10.0,
        "05_falls_percent": 25.0,
    }
    others = [*numbers, "loss", "system/cpu_utilization_percentage"]
    assert sorted([*HEADLINE, *others])[: len(HEADLINE)] == [*HEADLINE]
