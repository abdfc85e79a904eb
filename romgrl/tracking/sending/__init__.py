"""The process of MLflow, and the only package that imports it; romgrl.tracking.recorder starts it."""

import os

os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")  # all of these before MLflow is imported
os.environ.setdefault("MLFLOW_HTTP_REQUEST_TIMEOUT", "5")
os.environ.setdefault("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "0")  # what failed is sent again from the journal
os.environ.setdefault("MLFLOW_ENABLE_ARTIFACTS_PROGRESS_BAR", "false")
