"""MLflow: the only package that imports it, and the process that romgrl.recorder starts."""
