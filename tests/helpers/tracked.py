"""What a store of MLflow holds after a job."""

from __future__ import annotations

from pathlib import Path

from mlflow import MlflowClient
from mlflow.entities import Run

from romgrl.tracking.recorder import default_uri


def all_runs(outputs: Path) -> list[Run]:
    """Every run of the experiment."""
    client = MlflowClient(tracking_uri=default_uri(outputs))
    return list(client.search_runs([client.get_experiment_by_name("romgrl").experiment_id], max_results=1000))
