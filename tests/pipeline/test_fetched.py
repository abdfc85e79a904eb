"""What a job takes from a tracking server."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from romgrl.config.schema import Config
from romgrl.pipeline import job
from romgrl.provenance.stage_graph import STAGES


def test_all_but_what_holds_code(smoke_config: Config, monkeypatch: pytest.MonkeyPatch) -> None:
    nobody: Any = None
    monkeypatch.setattr(job, "fetch_artifact", lambda recorder, directory, say: True)
    one = job.Job(smoke_config, nobody, nobody, nobody)
    assert {stage for stage in STAGES if not one.fetched(stage, Path("there"))} == {"export"}
