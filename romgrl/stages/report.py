"""Report: figures, tables, films and a summary of a finished evaluation (paper section 4.2)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from numpy.typing import NDArray

from romgrl.artifacts import MANIFEST, read_manifest
from romgrl.config.schema import Config
from romgrl.gait.alignment import align, last_windows
from romgrl.gait.features import Gait, gait_from_reference, gait_from_rollouts
from romgrl.gait.null_models import NULL_COLUMNS
from romgrl.humanoid.model import configured
from romgrl.humanoid.rendering import RenderingError, SideCamera
from romgrl.humanoid.skeleton import skeleton_of
from romgrl.report import figures, film, human_band_figure, markdown_report, side_by_side_film, tables
from romgrl.report.style import save
from romgrl.rom.registry import MODELS
from romgrl.runtime.stage_log import StageLog
from romgrl.stages import report_page
from romgrl.stages.wiring.artifact_arrays import (
    DISTANCE_COLUMNS,
    ERROR_COLUMNS,
    GAIT_COLUMNS,
    WALKERS,
    read_reference,
    read_rollouts,
    read_table,
)
from romgrl.stages.wiring.rom import rom_parameters

POSES = 8
FILM_TIME = 6.0  # s at the end of the recorded episode


def run(config: Config, inputs: Mapping[str, Path], output: Path, log: StageLog) -> None:
    """Write the figures (PNG and PDF), the tables (Markdown), three films, report.md and report.html."""
    model = configured(config.humanoid)
    rollouts = read_rollouts(inputs["evaluation"], config, model.nq + model.nv)
    errors = read_table(inputs["evaluation"] / "mse.csv", ERROR_COLUMNS)
    distances = read_table(inputs["evaluation"] / "distances.csv", DISTANCE_COLUMNS)
    gaits = read_table(inputs["evaluation"] / "gait.csv", GAIT_COLUMNS)
    nulls = read_table(inputs["evaluation"] / "null_models.csv", NULL_COLUMNS)
    pictures = draw_figures(config, inputs, rollouts, errors)
    pictures["gait"] = human_band_figure.gait_bands(gaits, config.speed)
    states = {name: rollouts[f"{name}_states"] for name in WALKERS}
    rates = dict(zip(gaits.walker, gaits.stride_frequency_hz, strict=True))
    dt = float(rollouts["dt"])
    remove_films(output)  # of an attempt that was stopped
    camera = open_camera(model, log)
    try:
        pictures["filmstrip"] = draw_filmstrip(model, camera, states, rates, dt)
        films = []
        if camera is not None and config.evaluation.video:
            rom = MODELS[config.rom.model]
            teacher = side_by_side_film.FilmedTeacher(
                read_reference(inputs["reference"], config), rom_parameters(config), rom.draw, rom.ground
            )
            films = films_or_none(camera, states, teacher, dt, output, log)
    finally:
        if camera is not None:
            camera.close()
    for name, picture in pictures.items():
        save(picture, output, name)
    (output / "mse.md").write_text(tables.markdown(tables.error_table(errors)), encoding="utf-8")
    (output / "distances.md").write_text(tables.markdown(tables.distance_table(distances)), encoding="utf-8")
    (output / "gait.md").write_text(tables.markdown(tables.gait_table(gaits)), encoding="utf-8")
    (output / "null_models.md").write_text(tables.markdown(tables.null_models_table(nulls)), encoding="utf-8")
    facts = collect_facts(config, inputs)
    (output / "report.md").write_text(
        markdown_report.document(errors, distances, gaits, nulls, facts, list(pictures), films), encoding="utf-8"
    )
    report_page.write_page(
        config, inputs, output, model=model, rollouts=rollouts, errors=errors, gaits=gaits, nulls=nulls, facts=facts
    )
    log.message(markdown_report.summary(errors, gaits))


def draw_figures(
    config: Config, inputs: Mapping[str, Path], rollouts: Mapping[str, NDArray[Any]], errors: pd.DataFrame
) -> dict[str, Figure]:
    """The figures that need no simulation, by the names of their files."""
    teacher = gait_from_reference(read_reference(inputs["reference"], config))
    window = config.evaluation.window
    pairs = {name: typical_pair(gait_from_rollouts(rollouts, name), teacher, window) for name in WALKERS}
    there = {name: pair for name, pair in pairs.items() if pair is not None}
    curves = {name: path / "curve.csv" for name, path in inputs.items() if (path / "curve.csv").is_file()}
    trained = {name: read_table(path, ("step",)) for name, path in curves.items() if name in ("teacher", *WALKERS)}
    targets = {"teacher": config.teacher.speed, **dict.fromkeys(WALKERS, config.speed)}
    return {
        "paths": figures.paths(there, teacher.dt, config.speed),
        "time_series": figures.time_series(pairs["student"], teacher.dt, config.speed),
        "mse": figures.error_bars(errors, config.speed),
        "learning_curves": figures.learning_curves(trained, targets),
    }


def typical_pair(gait: Gait, teacher: Gait, window: int) -> figures.Pair | None:
    """The scored window with the median error among the episodes without a fall, over its window of the teacher."""
    upright = np.flatnonzero(~gait.fallen)
    pairs = align(last_windows(gait.upright_episodes, window), teacher.upright_episodes)
    if not len(pairs.windows):
        return None
    spread = np.maximum(teacher.features[teacher.valid].var(axis=0), 1e-8)
    order = np.argsort((pairs.mse / spread).sum(axis=1))
    chosen = int(order[len(order) // 2])
    episode, start = pairs.starts[chosen]
    return figures.Pair(
        window=pairs.windows[chosen],
        teacher=pairs.matched[chosen],
        velocity=_speeds(gait, int(upright[chosen]), slice(-window, None), window),
        teacher_velocity=_speeds(teacher, int(episode), slice(start, start + window), window),
    )


def open_camera(model: Any, log: StageLog) -> SideCamera | None:
    """An offscreen camera, or None, with one line, where the machine has no OpenGL."""
    try:
        camera = SideCamera(model)
    except RenderingError as error:
        log.message(f"no films, and stick figures for poses: {error}")
        return None
    if camera.remark:
        log.message(camera.remark)
    return camera


def draw_filmstrip(
    model: Any, camera: SideCamera | None, states: Mapping[str, NDArray[Any]], rates: Mapping[str, float], dt: float
) -> Figure:
    """One stride of each walker, at the end of its recorded episode."""
    steps = {name: film.stride_steps(values, rates[name], dt, POSES) for name, values in states.items()}
    times = {name: dt * (values - values[0]) for name, values in steps.items()}
    poses = {name: values[steps[name]] for name, values in states.items()}
    if camera is None:
        return film.strip_of_sticks(model, poses, times, far=skeleton_of(model).right_side)
    rows = {name: [crop(camera.frame(state)) for state in values] for name, values in poses.items()}
    return film.strip_of_pictures(rows, times)


def crop(frame: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The middle of a frame, where the walker is: as wide as 0.7 of its height."""
    width = int(0.7 * frame.shape[0])
    left = (frame.shape[1] - width) // 2
    return frame[:, left : left + width]


def films_or_none(
    camera: SideCamera,
    states: Mapping[str, NDArray[Any]],
    teacher: side_by_side_film.FilmedTeacher,
    dt: float,
    output: Path,
    log: StageLog,
) -> list[str]:
    """All films, or none of them, with one line, where this machine's ffmpeg makes none."""
    try:
        return shoot(camera, states, teacher, dt, output, log)
    except film.FilmError as error:
        log.message(f"no films: {error}")
        remove_films(output)
        return []


def remove_films(output: Path) -> None:
    """Leave no film that the report does not name."""
    for path in output.glob("*.mp4"):
        path.unlink()


def shoot(
    camera: SideCamera,
    states: Mapping[str, NDArray[Any]],
    teacher: side_by_side_film.FilmedTeacher,
    dt: float,
    output: Path,
    log: StageLog,
) -> list[str]:
    """One film per walker, the last FILM_TIME of the recorded episode, and one of all with the teacher beside them."""
    filmed = {name: values[-round(FILM_TIME / dt) :] for name, values in states.items()}
    total, done = sum(len(values) for values in filmed.values()), 0
    columns: dict[str, list[NDArray[np.uint8]]] = {"teacher": []}
    for name, values in filmed.items():
        columns[name] = []
        film.write_film(output / f"{name}.mp4", keeping(map(camera.frame, values), columns[name]), dt)
        done += len(values)
        log.progress(done, total)
    height, width, _ = columns["student"][0].shape
    columns["teacher"] = teacher.frames((height, width), round(FILM_TIME / dt))
    film.write_film(output / side_by_side_film.FILM, side_by_side_film.together(columns), dt)
    return [*(f"{name}.mp4" for name in filmed), side_by_side_film.FILM]


def keeping(frames: Iterator[NDArray[np.uint8]], middles: list[NDArray[np.uint8]]) -> Iterator[NDArray[np.uint8]]:
    """Pass pictures on and keep the middle of each."""
    for frame in frames:
        middles.append(crop(frame).copy())
        yield frame


def collect_facts(config: Config, inputs: Mapping[str, Path]) -> markdown_report.Facts:
    """What the report says of the run."""
    evaluation = config.evaluation
    manifests = {name: path for name, path in inputs.items() if (path / MANIFEST).is_file()}
    return markdown_report.Facts(
        speed=config.speed,
        teacher_speed=config.teacher.speed,
        eta=config.eta,
        noise=config.noise,
        seed=config.seed,
        episodes=evaluation.episodes,
        steps=evaluation.steps,
        window=evaluation.window,
        wall_times={name: read_manifest(path).wall_time for name, path in manifests.items()},
    )


def _speeds(gait: Gait, episode: int, steps: slice, window: int) -> NDArray[np.floating]:
    """Forward velocity (W,) of part of an episode; zero where it was not recorded."""
    return np.zeros(window) if gait.velocity is None else gait.velocity[episode, gait.valid[episode]][steps]
