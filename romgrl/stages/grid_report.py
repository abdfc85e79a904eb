"""The report of a student that follows commands: page, figures, film of the ramp and report.md of its evaluation."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path

from matplotlib.figure import Figure

from romgrl.artifacts import MANIFEST, Manifest, read_manifest
from romgrl.config.schema import Config
from romgrl.humanoid.model import configured
from romgrl.humanoid.rendering import RenderingError, SideCamera
from romgrl.humanoid.skeleton import skeleton_of
from romgrl.report import film, ramp_film
from romgrl.report.grid_figure import grid_figure, matrices_figure
from romgrl.report.grid_markdown import grid_document, grid_summary_text
from romgrl.report.library_cells import feet_of_cells
from romgrl.report.page.commands_page import GridReport, write_commands_page
from romgrl.report.page.played_cells import CellReference
from romgrl.report.ramp_strides import ramp_strides
from romgrl.report.style import save
from romgrl.runtime.stage_log import StageLog
from romgrl.stages.conditioned.cells import read_command_cells
from romgrl.stages.conditioned.grid_artifact import read_grid_tables, read_recordings

SHOWN_STAGES = ("teacher", "library", "student", "baseline", "evaluation")
GRID_NEIGHBORS = {
    "report.md": "in words and tables",
    "grid.png": "the charts as a picture",
    "matrices.png": "the heat maps",
    "ramp.png": "poses of the ramp over its curves",
    ramp_film.RAMP_FILM: "the ramp as a film",
}


def run(config: Config, inputs: Mapping[str, Path], output: Path, log: StageLog) -> None:
    """Write report.html, the figures (PNG and PDF), the film of the ramp and report.md."""
    report = report_of(config, inputs)
    tables = report.tables
    for old in output.glob("*.mp4"):  # of an attempt that was stopped
        old.unlink()
    poster, films = draw_ramp(report, output, log, filmed=config.evaluation.video)
    pictures = {"grid": grid_figure(tables), "matrices": matrices_figure(tables), "ramp": poster}
    for name, picture in pictures.items():
        save(picture, output, name)
    times = {name: manifest.wall_time for name, manifest in report.manifests.items()}
    text = grid_document(
        tables, report.strides, seed=config.seed, pictures=list(pictures), films=films, wall_times=times
    )
    (output / "report.md").write_text(text, encoding="utf-8")
    files = {name: what for name, what in GRID_NEIGHBORS.items() if (output / name).is_file()}
    write_commands_page(output / "report.html", report, film=films[0] if films else None, files=files)
    log.message(grid_summary_text(tables, report.strides))


def report_of(config: Config, inputs: Mapping[str, Path]) -> GridReport:
    """What is reported, read from the artifacts of the stages."""
    model = configured(config.humanoid)
    arrays = read_recordings(inputs["evaluation"], model.nq + model.nv, 1.0 / config.humanoid.control_frequency)
    return GridReport(
        tables=read_grid_tables(inputs["evaluation"]),
        arrays=arrays,
        strides=ramp_strides(arrays),
        references=cell_references(config, inputs["library"]),
        model=model,
        far=skeleton_of(model).right_side,
        manifests=manifests_of(inputs),
        seed=config.seed,
    )


def manifests_of(inputs: Mapping[str, Path]) -> dict[str, Manifest]:
    """Of the stages that are there."""
    there = [name for name in SHOWN_STAGES if name in inputs and (inputs[name] / MANIFEST).is_file()]
    return {name: read_manifest(inputs[name]) for name in there}


def cell_references(config: Config, library: Path) -> dict[tuple[str, float], CellReference]:
    """The references of a library that a student is asked for, by gait and speed."""
    cells = read_command_cells(library, config, span=1)
    names = ("features", "contact", "velocity", "episode")
    return {
        (cells.gaits[gait], round(float(speed), 6)): CellReference({name: arrays[name] for name in names}, feet)
        for gait, speed, arrays, feet in zip(
            cells.gait, cells.speed, cells.references, feet_of_cells(cells.table), strict=True
        )
    }


def draw_ramp(report: GridReport, output: Path, log: StageLog, *, filmed: bool) -> tuple[Figure, list[str]]:
    """The poster of the ramp, and the name of its film; none, with one line, where there is no OpenGL or no ffmpeg."""
    strides, states = report.strides, report.arrays["ramp_states"].astype(float)
    poses = states[ramp_film.pose_steps(strides)]
    poster = partial(ramp_film.ramp_poster, strides, states=poses, segments=sticks_of(report))
    try:
        camera = SideCamera(report.model, width=ramp_film.WIDTH, height=ramp_film.BODY_HEIGHT)
    except RenderingError as error:
        log.message(f"no film of the ramp, and stick figures for poses: {error}")
        return poster(None), []
    with camera:
        if camera.remark:
            log.message(camera.remark)
        picture = poster([ramp_film.middle(camera.frame(state)) for state in poses])
        if filmed and strides.upright < 2:
            log.message("no film of the ramp: it fell as it began")
        if not filmed or strides.upright < 2:
            return picture, []
        try:
            film.write_film(
                output / ramp_film.RAMP_FILM,
                ramp_film.ramp_frames(camera.frame, states, strides),
                float(report.arrays["dt"]),
            )
        except film.FilmError as error:
            log.message(f"no film of the ramp: {error}")
            return picture, []
    return picture, [ramp_film.RAMP_FILM]


def sticks_of(report: GridReport) -> ramp_film.BodySegments:
    """The body of a state as lines, for machines that cannot draw."""
    return lambda state: film.side_view(report.model, state, report.far)
