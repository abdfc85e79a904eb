"""A value that is bad is no value: what checks how keys fit together does not read it."""

from __future__ import annotations

import pytest

from romgrl.cli.consistency import CHECKS
from romgrl.config.fields import MISSING
from romgrl.config.values import keys_of
from tests.conftest import Composer
from tests.helpers.configurations import with_value

BASES = (
    "stage=all",
    "stage=library teacher=variable_walking",
    "stage=library teacher=jumping",
    "teacher=variable_running",
    "experiment=every_speed",
    "experiment=paper",
    "student=pretrained",
)


@pytest.mark.parametrize("base", BASES)
def test_no_check_reads_a_key_that_is_bad(base: str, compose_config: Composer) -> None:
    config = compose_config(*base.split())
    for key in keys_of(config):
        bad = with_value(config, key, MISSING)
        lines = [line for keys, check in CHECKS if key not in keys for line in check(bad)]
        assert not any(line.startswith(f"{key}:") for line in lines), key
