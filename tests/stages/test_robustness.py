"""The robustness stage: its table, its figure, the same bits again, and what MLflow is told."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from romgrl.config.schema import Config
from romgrl.humanoid.model import configured, fingerprint
from romgrl.report.terminal_tables import robustness_metrics
from romgrl.runtime.stage_log import SilentLog
from romgrl.stages import robustness
from tests.conftest import Composer
from tests.helpers.stage_inputs import teacher as write_teacher
from tests.helpers.walkers import write_walker

COLUMNS = [
    "perturbation",
    "level",
    "unit",
    "walker",
    "trials",
    "falls",
    "fall_rate",
    "low",
    "high",
    "falls_before",
    "mean_speed_m_per_s",
]
ORBIT_COLUMNS = ["strides", "rank", "modulus", "real", "imaginary", "low", "high", "worlds", "fell", "verdict"]
NAMES = ["push_forward", "push_backward", "observation_noise", "mass", "friction"]


class CountingLog(SilentLog):
    """Remembers its progress."""

    def __init__(self) -> None:
        super().__init__()
        self.steps: list[tuple[int, int]] = []

    def progress(self, step: int, total: int, **numbers: float) -> None:
        self.steps.append((step, total))


@pytest.fixture
def inputs(smoke_config: Config, tmp_path: Path) -> dict[str, Path]:
    """Two walkers that know nothing."""
    for seed, name in enumerate(("student", "baseline")):
        (tmp_path / name).mkdir()
        write_walker(
            tmp_path / name / "policy.safetensors", seed=seed, humanoid=fingerprint(configured(smoke_config.humanoid))
        )
    (tmp_path / "teacher").mkdir()
    write_teacher(tmp_path / "teacher" / "policy.safetensors", activation=smoke_config.teacher.activation)
    return {name: tmp_path / name for name in ("teacher", "student", "baseline")}


def test_table_figure_and_progress(smoke_config: Config, inputs: dict[str, Path], tmp_path: Path) -> None:
    log = CountingLog()
    robustness.run(smoke_config, inputs, tmp_path, log)
    table = pd.read_csv(tmp_path / "robustness.csv")
    assert list(table.columns) == COLUMNS
    assert list(table.perturbation.unique()) == NAMES
    assert list(table.walker) == ["student", "baseline"] * 5
    assert (table.trials == 3).all()
    assert (table.falls == 3).all()  # untrained walkers fall in every trial
    assert (table.falls_before == 3).all()
    assert (table.fall_rate == 1.0).all()
    assert (table.high == 1.0).all()
    assert table.low.to_numpy() == pytest.approx(3 / (3 + 1.959964**2))  # Wilson's interval of 3 of 3
    assert table.mean_speed_m_per_s.isna().all()
    for suffix in ("png", "pdf"):
        assert (tmp_path / f"fall_rates.{suffix}").stat().st_size > 5000
    total = log.steps[-1][1]
    assert log.steps == [(step, total) for step in range(1, total + 1)]
    assert len(log.messages) == 6
    assert log.messages[-1] == "teacher: no multipliers, 4 of 4 worlds fell or stood"
    orbit = pd.read_csv(tmp_path / "floquet.csv")
    assert list(orbit.columns) == ORBIT_COLUMNS
    assert list(orbit.verdict) == ["no gait"]
    assert "student 100% to 100%, baseline 100% to 100%" in log.messages[0]


def test_same_seed_same_bits(
    compose_config: Composer, inputs: dict[str, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Walkers for which no posture is a fall, and too little time to sink: their speeds say where they went."""
    monkeypatch.setattr(robustness, "SETTLING_TIME", 0.1)
    monkeypatch.setattr(robustness, "STRIDE_TIME", 0.1)
    config = compose_config(
        "experiment=smoke",
        "robustness.push_impulse=[0,1]",
        "humanoid.fall_pelvis_height=0",
        "humanoid.fall_head_height=0",
        "humanoid.fall_trunk_lean=9",
    )
    one = robustness.measure(config, inputs, SilentLog())
    pd.testing.assert_frame_equal(one, robustness.measure(config, inputs, SilentLog()), check_exact=True)
    assert not one.equals(robustness.measure(replace(config, seed=1), inputs, SilentLog()))
    assert not one.falls.any()
    speed = one[one.walker == "student"].set_index(["perturbation", "level"]).mean_speed_m_per_s
    assert speed["push_backward", 1] < speed["push_backward", 0] == speed["push_forward", 0] < speed["push_forward", 1]
    assert list(one[one.perturbation == "push_forward"].level) == [0, 0, 1, 1]


def test_forces_and_times(compose_config: Composer) -> None:
    config = compose_config("robustness.push_duration=0.1")
    assert robustness.push_steps(config) == 3
    forward = robustness.Disturbance("push_forward", 0.5, "N s/kg")
    assert robustness.force(config, forward, 72.0) == pytest.approx(0.5 * 72.0 / 0.1)
    assert robustness.force(config, replace(forward, name="push_backward"), 72.0) == pytest.approx(-360.0)
    assert robustness.force(config, replace(forward, name="mass"), 72.0) == 0.0
    short = compose_config("robustness.push_duration=0.001")
    assert robustness.force(short, forward, 72.0) == pytest.approx(0.5 * 72.0 * 30)  # one control step
    delays = robustness.settling_steps(config)
    assert (delays.shape, delays.min(), delays.max()) == ((100,), 120, 149)
    assert len(np.unique(delays)) > 20  # every phase of a stride


def test_noise_is_in_units_of_both_trainings(inputs: dict[str, Path], smoke_config: Config) -> None:
    env = robustness.humanoid_env(smoke_config, num_envs=1)
    policies = [robustness.read_walker(inputs[name], env) for name in ("student", "baseline")]
    policies[0].scale[:5] = 1 / 3.0
    spread = robustness.observation_spread(policies, 358)
    np.testing.assert_allclose(spread[:5], np.sqrt((9 + 1) / 2))
    np.testing.assert_allclose(spread[5:10], 1.0)
    assert not spread[10:].any()


def test_metrics(tmp_path: Path) -> None:
    assert robustness_metrics(tmp_path) == {}
    rates = {("push_forward", "student"): (0, 0.2, 0.5, 0.4), ("push_forward", "baseline"): (0.5, 1, 1, 1)}
    rates |= {("mass", "student"): (0.1, 0.2, 0.3, 0.4)}
    lines = [
        f"{name},{level / 10},{walker},{rate}"
        for (name, walker), values in rates.items()
        for level, rate in enumerate(values)
    ]
    (tmp_path / "robustness.csv").write_text(
        "\n".join(["perturbation,level,walker,fall_rate", *lines]), encoding="utf-8"
    )
    metrics = robustness_metrics(tmp_path)
    assert metrics["push_forward/0.2/student/fall_rate"] == 0.5
    assert metrics["push_forward/student/survived"] == 0.1  # what survives more than a lethal push does not count
    assert "push_forward/baseline/survived" not in metrics
    assert "mass/student/survived" not in metrics
    assert len(metrics) == 12 + 1
    (tmp_path / "floquet.csv").write_text(
        "strides,rank,modulus,low,high\n1,1,0.9,0.8,0.95\n1,2,0.3,,\n8,1,0.88,0.87,\n", encoding="utf-8"
    )
    orbit = {name: value for name, value in robustness_metrics(tmp_path).items() if name.startswith("teacher/")}
    assert orbit == {"teacher/multiplier": 0.88, "teacher/multiplier_low": 0.87}
