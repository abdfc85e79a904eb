"""The way back: what a finished stage left in a store, downloaded to this disk by the names in its manifest."""

from __future__ import annotations

from pathlib import Path

from romgrl.artifacts import MANIFEST, read_manifest
from romgrl.tracking.sending.files import FILES_TAG
from romgrl.tracking.sending.store import Store

LOOKED_AT = 20  # runs of one stage key


def find_run(store: Store, experiment: str, stage: str, key: str) -> str | None:
    """The last finished run of a stage key that has its files. Raises FAILURES or RefusedError."""
    wanted = f"tags.stage = '{stage}' and tags.key = '{key}' and attributes.status = 'FINISHED'"
    newest = {"max_results": LOOKED_AT, "order_by": ["attributes.end_time DESC"]}
    runs = store.request("search_runs", [store.experiment_id(experiment)], wanted, **newest)
    return next((str(run.info.run_id) for run in runs if FILES_TAG not in run.data.tags), None)


def download(store: Store, run_id: str, directory: Path) -> None:
    """Download the artifact of a run, unverified. Raises FAILURES, RefusedError, or ArtifactError for its manifest."""
    directory.mkdir(parents=True)
    store.request("download_artifacts", run_id, MANIFEST, str(directory))
    for name in read_manifest(directory).files:
        store.request("download_artifacts", run_id, name, str(directory))
