"""The directory of a sweep: its own while it runs, and where a sweep that is started again goes on if told to."""

from __future__ import annotations

from itertools import count
from pathlib import Path

from filelock import FileLock, Timeout
from omegaconf import DictConfig

from romgrl.config.addresses import in_quotes
from romgrl.config.values import refusal
from romgrl.errors import ConfigurationError
from romgrl.sweeps.launch import FAILURES_FILE, RUNNING_SUFFIX, STOPPING

KEY = "hydra.sweep.dir"
LOCK = ".sweep.lock"  # the system frees it when the sweep's process dies
LEFT_BEHIND = (STOPPING, FAILURES_FILE, f"*{RUNNING_SUFFIX}")  # by a sweep that was stopped here


def claim(config: DictConfig) -> tuple[Path, FileLock]:
    """Make the directory of a sweep its own, and tell its jobs which it is. Raises ConfigurationError.

    Sweeps of the same second, or of the hour that summer time repeats, get a number behind their names.
    """
    wanted = Path(str(config.hydra.sweep.dir)).absolute()
    named_by_time = "${now:" in str(config.hydra.sweep._get_node("dir")._value())
    try:
        directory = made_anew(wanted) if named_by_time else wanted
        directory.mkdir(parents=True, exist_ok=True)
        lock = FileLock(directory / LOCK)
        lock.acquire(blocking=False)
        for path in [path for pattern in LEFT_BEHIND for path in directory.glob(pattern)]:
            path.unlink(missing_ok=True)
    except Timeout:
        raise ConfigurationError(refusal(KEY, str(wanted), "a directory that no other sweep is using now")) from None
    except OSError:
        raise ConfigurationError(refusal(KEY, str(wanted), "a directory that can be written")) from None
    config.hydra.sweep.dir = str(directory)
    config.hydra.overrides.hydra.append(f"{KEY}={in_quotes(str(directory))}")  # composes the jobs
    return directory, lock


def made_anew(directory: Path) -> Path:
    """Make a directory that is not there yet, under this name or with a number behind it."""
    directory.parent.mkdir(parents=True, exist_ok=True)
    path, numbers = directory, count(2)
    while True:
        try:
            path.mkdir()
        except FileExistsError:
            path = directory.with_name(f"{directory.name}_{next(numbers)}")
        else:
            return path
