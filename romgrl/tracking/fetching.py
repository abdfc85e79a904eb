"""The way back: what a finished stage left in a store, downloaded to this disk by the names in its manifest."""

from __future__ import annotations

from pathlib import Path

from romgrl.artifacts import MANIFEST, read_manifest
from romgrl.tracking.store import Store


def fetch(store: Store, experiment: str, stage: str, key: str, directory: Path) -> bool:
    """Download the artifact of the last finished run of a stage key to `directory`, unverified; False if there is none.

    Raises FAILURES, RefusedError, or ArtifactError where the manifest cannot be read or is not of that stage and key.
    """
    wanted = f"tags.stage = '{stage}' and tags.key = '{key}' and attributes.status = 'FINISHED'"
    newest = ["attributes.end_time DESC"]
    runs = store.request("search_runs", [store.experiment_id(experiment)], wanted, max_results=1, order_by=newest)
    for run in runs:
        directory.mkdir(parents=True)
        store.request("download_artifacts", run.info.run_id, MANIFEST, str(directory))
        for name in read_manifest(directory).files:
            store.request("download_artifacts", run.info.run_id, name, str(directory))
    return bool(runs)
