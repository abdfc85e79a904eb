"""One job: its stages in order, their workers, its run in MLflow."""
