"""Hydra callback of sweeps: every job is checked before the first starts, and all of them share one parent run."""

from __future__ import annotations

import atexit
import os
import sys
from pathlib import Path
from typing import Any

from hydra import compose
from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.experimental.callback import Callback
from omegaconf import DictConfig

from romgrl.composition import COMPOSITION_ERRORS, explain, to_config
from romgrl.errors import ConfigurationError
from romgrl.recorder import open_recorder
from romgrl.validation import validate

PARENT_VARIABLE = "ROMGRL_PARENT_RUN"


def sweep_jobs(config: DictConfig) -> list[list[str]]:
    """The overrides of every job of a sweep over lists and ranges."""
    parameters = [f"{key}={value}" for key, value in (config.hydra.sweeper.get("params") or {}).items()]
    overrides = OverridesParser.create().parse_overrides([*parameters, *config.hydra.overrides.task])
    return [list(job) for batch in BasicSweeper.split_arguments(overrides, None) for job in batch]


def check_jobs(config: DictConfig) -> None:
    """Raise ConfigurationError with one line per bad value of any job."""
    problems: dict[str, None] = {}
    for overrides in sweep_jobs(config):
        try:
            validate(to_config(compose(config.hydra.job.config_name, overrides=overrides)))
        except ConfigurationError as error:
            problems |= dict.fromkeys(str(error).splitlines())
        except COMPOSITION_ERRORS as error:
            problems |= dict.fromkeys(explain(overrides, error))
    if problems:
        raise ConfigurationError("\n".join(problems))


class SweepCallback(Callback):
    """Opens the parent run at the start of `-m` and closes it at the end; jobs find its id in the environment."""

    def on_multirun_start(self, config: DictConfig, **kwargs: Any) -> None:
        """Check all jobs and start the parent run."""
        try:
            check_jobs(config)
        except ConfigurationError as error:
            print(error, file=sys.stderr)
            sys.exit(error.exit_code)
        tracking = config.tracking
        outputs = Path(config.paths.outputs).expanduser().resolve()
        self._recorder = open_recorder(tracking.uri, tracking.experiment, outputs, enabled=tracking.enabled)
        overrides = [*config.hydra.overrides.task]
        name = "sweep " + " ".join(overrides) if overrides else f"sweep {config.hydra.job.config_name}"
        self._run = self._recorder.start(name, tags={"stage": "sweep"}, params={"jobs": len(sweep_jobs(config))})
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
