"""What MLflow is told: a journal, the process that sends it, the way back of artifacts."""
