"""The files of a run: copied to where its store keeps them, tables for the UI among them, or said to be missing."""

from __future__ import annotations

import socket
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd

from romgrl.provenance.stage_graph import STAGES
from romgrl.tracking.sending.failures import FAILURES, FilesError, RefusedError, first_line, of_files, why_no_files

if TYPE_CHECKING:
    from romgrl.tracking.sending.store import Store

TABLES = "tables"  # the folder of a run that has them
TABULATED = {"jobs.csv": (), "cells.csv": ()} | {
    name: columns for stage in STAGES.values() for name, columns in stage.tables.items()
}  # CSV files that are shown, with the columns that name a row
STUDENT = "student"
FILES_TAG = "romgrl.files_missing"  # where the files of a run are that could not be stored with it


def send_files(store: Store, run_id: str, directory: Path) -> None:
    """Copy every file of a directory to a run, one after the other: each is an answer.

    Raises FilesError where the store answers, but the files have no place; one that took none is not tried again.
    """
    if not directory.is_dir():
        raise RefusedError(f"{directory} is gone")
    if store.closed and (why := store.closed.get(place_of(store, run_id))):
        raise FilesError(why)
    for file in sorted(path for path in directory.rglob("*") if path.is_file()):
        folder = file.parent.relative_to(directory)
        send_file(store, run_id, file, None if folder == Path() else folder.as_posix())
        if file.name in TABULATED and folder == Path():
            send_table(store, run_id, file)


def send_file(store: Store, run_id: str, file: Path, folder: str | None) -> None:
    """Copy a file to a run."""
    try:
        store.request("log_artifact", run_id, str(file), folder)
    except RefusedError:
        raise
    except Exception as error:  # each kind of place has exceptions of its own, of libraries that may be missing
        if not file.exists():
            raise RefusedError(f"{file} is gone") from error
        if isinstance(error, FAILURES) and not of_files(error):
            raise
        why = explain_files(store, run_id, error)
        store.closed[place_of(store, run_id)] = why
        raise FilesError(why) from error


def root_of(store: Store, run_id: str) -> str:
    """Where the store keeps the files of a run."""
    return str(store.request("get_run", run_id).info.artifact_uri)


def place_of(store: Store, run_id: str) -> str:
    """Where the store keeps the files of all runs of an experiment."""
    return root_of(store, run_id).partition(run_id)[0]


def explain_files(store: Store, run_id: str, error: BaseException) -> str:
    """Why the files of a run cannot be stored. Raises FAILURES where the store is away."""
    return why_no_files(error, root_of(store, run_id), served=store.uri.startswith("http"))


def mark_missing(store: Store, run_id: str, directory: Path) -> None:
    """Let a run say where its files are."""
    store.tags(run_id, {FILES_TAG: f"{directory} on {socket.gethostname()}"})


def mark_found(store: Store, run_id: str) -> None:
    """A run has its files after all."""
    if FILES_TAG in store.request("get_run", run_id).data.tags:
        store.request("delete_tag", run_id, FILES_TAG)


def send_table(store: Store, run_id: str, file: Path) -> None:
    """Log a CSV file as a table of the UI, too; one that is there already stays, as MLflow would add to it."""
    name = f"{TABLES}/{file.stem}.json"
    if any(known.path == name for known in store.request("list_artifacts", run_id, TABLES)):
        return
    try:
        rows = pd.read_csv(file)
    except ValueError as error:
        raise RefusedError(f"{file}: {first_line(error)}") from error
    store.request("log_table", run_id, table_for_ui(rows, TABULATED[file.name]), name)


def table_for_ui(rows: pd.DataFrame, labels: Sequence[str]) -> pd.DataFrame:
    """A table as MLflow's comparison of tables shows it best: what names a row in one column, the student next to it.

    The UI groups by the first column and compares the second one; it shows ten digits of a number, so four are left.
    """
    names = [name for name in labels if name in rows]
    rows = rows.map(lambda cell: float(f"{cell:.4g}") if isinstance(cell, float) else cell)
    if len(names) > 1:
        rows.insert(0, ", ".join(names), rows[names].astype(str).agg(", ".join, axis=1))
        rows = rows.drop(columns=names)
    if len(names) > 0 and STUDENT in rows:
        rows.insert(1, STUDENT, rows.pop(STUDENT))
    return rows
