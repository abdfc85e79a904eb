"""The command line of romgrl with fake stages also in the processes that a launcher starts."""

from __future__ import annotations

import sys
from typing import Any

from hydra.experimental.callback import Callback
from omegaconf import DictConfig

from romgrl.cli import allowlist
from tests.helpers import fake_stages

TARGET = "tests.helpers.fake_jobs.Fakes"
allowlist.TARGETS = (*allowlist.TARGETS, TARGET)


class Fakes(Callback):
    """Callback of Hydra that goes with each job and installs the fakes where it runs."""

    def on_job_start(self, config: DictConfig, **kwargs: Any) -> None:
        """Called in the process of the job."""
        fake_stages.install()
        fake_stages.do_without_torch()


if __name__ == "__main__":
    sys.argv.append(f"+hydra.callbacks.fakes._target_={TARGET}")
    fake_stages.main()
