"""Hydra callback of sweeps: all jobs share one parent run. Every job was checked before the first one starts."""

from __future__ import annotations

import atexit
import os
from pathlib import Path
from typing import Any

from hydra.core.global_hydra import GlobalHydra
from hydra.experimental.callback import Callback
from omegaconf import DictConfig

from romgrl.loading import stored_sweep, sweep_jobs
from romgrl.recorder import open_recorder

PARENT_VARIABLE = "ROMGRL_PARENT_RUN"


class SweepCallback(Callback):
    """Opens the parent run at the start of `-m` and closes it at the end; jobs find its id in the environment."""

    def on_multirun_start(self, config: DictConfig, **kwargs: Any) -> None:
        """Start the parent run."""
        tracking = config.tracking
        outputs = Path(str(config.paths.outputs)).expanduser().resolve()
        self._recorder = open_recorder(tracking.uri, str(tracking.experiment), outputs, enabled=tracking.enabled)
        overrides = [*config.hydra.overrides.task]
        name = "sweep " + " ".join(overrides) if overrides else f"sweep {config.hydra.job.config_name}"
        jobs = sweep_jobs([*stored_sweep(config), *overrides], GlobalHydra.instance().config_loader())
        self._run = self._recorder.start(name, tags={"stage": "sweep"}, params={"jobs": len(jobs)})
        atexit.register(self._end, "KILLED")
        os.environ[PARENT_VARIABLE] = self._run.local_id if tracking.enabled else ""

    def on_multirun_end(self, config: DictConfig, **kwargs: Any) -> None:
        """Close the parent run."""
        self._end("FINISHED")
        os.environ.pop(PARENT_VARIABLE, None)

    def _end(self, status: str) -> None:
        atexit.unregister(self._end)
        self._run.finish(status)
        self._recorder.close()
