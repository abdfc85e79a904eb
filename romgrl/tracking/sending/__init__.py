"""The process of MLflow, and the only package that imports it; romgrl.tracking.recorder starts it."""
