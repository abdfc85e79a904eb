"""Artifacts that another machine made, or that are gone from this disk, taken from MLflow."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

from romgrl.artifacts import open_artifact, publish
from romgrl.errors import ArtifactError
from romgrl.tracking.recorder import Recorder


def fetch_artifact(recorder: Recorder, directory: Path, say: Callable[[str], None]) -> bool:
    """Download `<stage>/<key>`, verify every byte and publish it; False where there is none or it is refused."""
    stage, key = directory.parent.name, directory.name
    downloaded = directory.with_name(f".{key}.fetched-{os.getpid()}")
    shutil.rmtree(downloaded, ignore_errors=True)
    try:
        if not recorder.fetch(stage, key, downloaded):
            return False
        open_artifact(downloaded, stage=stage, key=key)
        publish(downloaded, directory)
    except ArtifactError as error:
        say(f"{stage}: what the tracking server has is refused: {error}")
        return False
    finally:
        shutil.rmtree(downloaded, ignore_errors=True)
    say(f"{stage}: fetched from the tracking server")
    return True
