"""Names and values as short as every store of MLflow takes them: SQLite would take any length, PostgreSQL does not."""

from __future__ import annotations

import re

from mlflow.utils.validation import (
    MAX_ENTITY_KEY_LENGTH,
    MAX_METRICS_PER_BATCH,
    MAX_PARAM_VAL_LENGTH,
    MAX_PARAMS_TAGS_PER_BATCH,
    MAX_TAG_VAL_LENGTH,
)

NAME_LENGTH = MAX_ENTITY_KEY_LENGTH  # of keys; the columns of runs and experiments take as much
PARAM_LENGTH, TAG_LENGTH = MAX_PARAM_VAL_LENGTH, MAX_TAG_VAL_LENGTH
METRICS_PER_BATCH, ENTITIES_PER_BATCH = MAX_METRICS_PER_BATCH, MAX_PARAMS_TAGS_PER_BATCH
NOT_IN_KEYS = re.compile(r"[^\w\-. :/]")
CUT = "..."


def shortened(text: str, length: int = NAME_LENGTH) -> str:
    """A text of at most `length` characters, with dots where some are missing."""
    return text if len(text) <= length else text[: length - len(CUT)] + CUT


def key_of(name: str) -> str:
    """The name of a parameter, a metric or a tag."""
    return shortened(NOT_IN_KEYS.sub("_", name))
