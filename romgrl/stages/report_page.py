"""report.html of the report stage: what the page shows, collected from the artifacts."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from romgrl.artifacts import MANIFEST, read_manifest
from romgrl.config.schema import Config
from romgrl.errors import ArtifactError
from romgrl.gait.features import Gait, gait_from_reference, gait_from_rollouts
from romgrl.humanoid.skeleton import skeleton_of
from romgrl.report import markdown_report
from romgrl.report.page import charts, html, scene, tables, training_charts
from romgrl.report.page.intervals import error_intervals
from romgrl.report.page.strides import stride_average
from romgrl.report.style import COLORS, WALKER_LABELS
from romgrl.report.tables import null_models_table
from romgrl.stages.wiring.artifact_arrays import WALKERS, read_reference, read_table
from romgrl.stages.wiring.rom import drawn_feet

PAGE_FILE = "report.html"
SHOWN_STAGES = ("teacher", "reference", *WALKERS, "evaluation")
Sections = dict[str, list[charts.Chart]]


def write_page(
    config: Config,
    inputs: Mapping[str, Path],
    output: Path,
    *,
    model: Any,
    rollouts: Mapping[str, NDArray[Any]],
    errors: pd.DataFrame,
    gaits: pd.DataFrame,
    nulls: pd.DataFrame,
    facts: markdown_report.Facts,
) -> None:
    """Write report.html beside the other files of the report."""
    teacher = gait_from_reference(read_reference(inputs["reference"], config))
    walkers = {name: gait_from_rollouts(rollouts, name) for name in WALKERS}
    tracks = {name: scene.humanoid_track(walkers[name], rollouts[f"{name}_states"], model) for name in WALKERS}
    tracks |= {"teacher": scene.teacher_track(teacher, tracks["student"], config.evaluation.window)}
    averages = {name: stride_average(gait) for name, gait in {"teacher": teacher, **walkers}.items()}
    there = {name: average for name, average in averages.items() if average is not None}
    intervals = error_intervals(teacher, walkers, config.evaluation.window)
    known = errors.merge(intervals.assign(alignment="aligned"), on=["channel", "alignment"], how="left", sort=False)
    health = read_health(inputs["student"] / "health.json")
    sections = gait_charts(tracks, there, teacher.dt) | curves_of_training(config, inputs, health)
    sections["errors"] = [charts.error_chart(known[known.alignment == "aligned"])]
    manifests = {name: read_manifest(inputs[name]) for name in SHOWN_STAGES if (inputs[name] / MANIFEST).is_file()}
    parts = scene.segments(model, skeleton_of(model).right_side)
    html.render_page(
        output / PAGE_FILE,
        scene=scene.scene(tracks, parts, drawn_feet(config), teacher.dt),
        sections=sections,
        title=f"Gait at {config.speed:g} m/s",
        headline=markdown_report.summary(errors, gaits),
        setting=markdown_report.setup_of(facts),
        played=played(tracks, walkers, teacher.dt, config.evaluation.window),
        counted=", ".join(f"{average.strides:,} strides of the {name}" for name, average in there.items())
        or "no stride",
        colors=COLORS,
        labels=WALKER_LABELS,
        walkers=[name for name in ("student", "baseline", "teacher") if name in tracks],
        gait_walkers=[str(name) for name in gaits.walker],
        gait_rows=tables.gait_rows(gaits, config.speed),
        error_rows=tables.error_rows(known),
        nulls=null_models_table(nulls),
        nulls_said=markdown_report.NULL_MODELS_SAID,
        remarks=markdown_report.remarks(errors),
        speed=f"{config.speed:g}",
        health=health,
        origin_rows=tables.origin_rows(manifests),
        versions=tables.version_rows(manifests),
        settings=tables.setting_rows(manifests),
        definitions=markdown_report.meanings(facts),
    )


def gait_charts(tracks: Mapping[str, scene.Track], averages: Mapping[str, Any], dt: float) -> Sections:
    """Everything that the player's cursor moves over."""
    return {
        "channels": charts.channels(tracks, dt),
        "footfall": [charts.footfall(tracks, dt)],
        "portraits": charts.portraits(tracks, dt),
        "strides": charts.stride_averages(averages, tracks),
    }


def curves_of_training(config: Config, inputs: Mapping[str, Path], health: dict[str, Any] | None) -> Sections:
    """The learning curves that are there, and those of the discriminator where there was one."""
    paths = {name: inputs[name] / "curve.csv" for name in ("teacher", *WALKERS) if name in inputs}
    curves = {name: read_table(path, ("step",)) for name, path in paths.items() if path.is_file()}
    targets = {"teacher": config.teacher.speed, **dict.fromkeys(WALKERS, config.speed)}
    spells = [] if health is None else health["history"]
    return {
        "training": training_charts.learning_curves(curves, targets),
        "discriminator": training_charts.discriminator(curves["student"], spells) if "student" in curves else [],
    }


def read_health(path: Path) -> dict[str, Any] | None:
    """health.json of the student; None where it had no discriminator."""
    if not path.is_file():
        return None
    try:
        health: dict[str, Any] = json.loads(path.read_text("utf-8"))
        return {name: health[name] for name in ("verdict", "now", "history")}
    except (ValueError, KeyError, TypeError) as error:
        raise ArtifactError(f"{path}: cannot be read: {type(error).__name__}: {error}") from error


def played(tracks: Mapping[str, scene.Track], walkers: Mapping[str, Gait], dt: float, window: int) -> str:
    """Which part of what the player shows."""
    seconds = {name: dt * len(track.x) for name, track in tracks.items()}
    fallen = [name for name, gait in walkers.items() if bool(np.all(gait.fallen))]
    falls = f" The {' and the '.join(fallen)} fell in every episode; shown until then." if fallen else ""
    return (
        f"The last {seconds['student']:.1f} s of a recorded episode of the student and {seconds['baseline']:.1f} s of "
        f"the baseline; {seconds['teacher']:.1f} s of the teacher, in time with the student over its last {window} "
        f"steps.{falls}"
    )
