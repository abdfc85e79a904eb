"""Hydra's own settings, which it reads without a word or ends over with a traceback: what each of them takes here."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Collection, Iterator
from typing import Any, NamedTuple

from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import InterpolationToMissingValueError, MissingMandatoryValue, OmegaConfBaseException

from romgrl.cli.locations import writable_directory
from romgrl.config.values import has_type, refusal

WHOLE, TEXT = "int", "str"
FORMULA = re.compile(r"all|([1-9]\d*\s*\*\s*)?n_jobs")
MODES = ("RUN", "MULTIRUN")
DIRECTIONS = ("maximize", "minimize")
LARGEST_SEED = 2**31


class HydraSetting(NamedTuple):
    """What a setting takes, as a test and in words; `later`: also what only a job can resolve."""

    takes: Callable[[Any], bool]
    allowed: str
    later: bool = False


def counts(value: Any) -> bool:
    """Tell whether a value is a whole number from 1 on, which Hydra may have made text of."""
    return (has_type(value, WHOLE) and value >= 1) or (isinstance(value, str) and value.isdigit() and int(value) >= 1)


def is_printable(value: Any) -> bool:
    """Tell whether a value is printable text."""
    return has_type(value, TEXT) and str(value).isprintable() and str(value).strip() != ""


def is_place(value: Any) -> bool:
    """Tell whether a value names a directory that is there or can be made."""
    return os.path.isdir(str(value)) or (is_printable(value) and writable_directory(str(value)))


def is_file_place(value: Any) -> bool:
    """Tell whether a value names a file that is there or can be made."""
    if not is_printable(value) or os.path.isdir(str(value)):
        return False
    return os.access(str(value), os.W_OK) or writable_directory(os.path.dirname(os.path.abspath(str(value))))


ANYWHERE = {
    "mode": HydraSetting(lambda value: value is None or getattr(value, "name", value) in MODES, ", ".join(MODES)),
    "run.dir": HydraSetting(is_place, "a directory that can be written", later=True),
    "sweep.dir": HydraSetting(is_printable, "a directory that can be written"),
    "sweep.subdir": HydraSetting(is_printable, "printable text", later=True),
    "output_subdir": HydraSetting(lambda value: value is None or is_printable(value), "printable text, or null"),
    "sweeper.max_batch_size": HydraSetting(
        lambda value: value is None or counts(value), "a whole number >= 1, or null"
    ),
}
OF_JOBLIB = {
    "n_jobs": HydraSetting(
        lambda value: has_type(value, WHOLE) and value != 0, "a whole number >= 1, or -1 for all cores"
    ),
    "require": HydraSetting(lambda value: value is None, "null"),
    "timeout": HydraSetting(lambda value: value is None, "null; hydra/launcher=submitit_local has timeout_min"),
    "pre_dispatch": HydraSetting(
        lambda value: counts(value) or FORMULA.fullmatch(str(value)) is not None,
        "a whole number >= 1, all, n_jobs, or a multiple such as 2*n_jobs",
    ),
    "batch_size": HydraSetting(lambda value: counts(value) or value == "auto", "a whole number >= 1, or auto"),
}
OF_OPTUNA = {
    "study_name": HydraSetting(is_printable, "printable text"),
    "storage": HydraSetting(is_file_place, "a file that can be written"),
    "direction": HydraSetting(lambda value: value in DIRECTIONS, ", ".join(DIRECTIONS)),
    "n_trials": HydraSetting(counts, "a whole number >= 1"),
    "n_jobs": HydraSetting(counts, "a whole number >= 1"),
    "seed": HydraSetting(
        lambda value: has_type(value, WHOLE) and 0 <= value <= LARGEST_SEED, f"a whole number from 0 to {LARGEST_SEED}"
    ),
}


def searches(composed: DictConfig) -> bool:
    """Tell whether Optuna chooses the settings of the jobs."""
    return bool(composed.hydra.runtime.choices.get("hydra/sweeper") == "optuna")


def hydra_faults(composed: DictConfig, bad: Collection[str] = ()) -> Iterator[str]:
    """Yield a line for every setting of Hydra that ends in a traceback or runs nothing; `bad`: keys told before."""
    joblib = composed.hydra.runtime.choices.get("hydra/launcher") == "joblib"
    settings = ANYWHERE | {f"launcher.{name}": setting for name, setting in OF_JOBLIB.items() if joblib}
    settings |= {f"sweeper.{name}": setting for name, setting in OF_OPTUNA.items() if searches(composed)}
    for name, setting in settings.items():
        if name in ("sweep.dir", "sweeper.storage") and "paths.outputs" in bad:  # which it lies below
            continue
        try:
            value = OmegaConf.select(composed.hydra, name, throw_on_missing=True)
        except (MissingMandatoryValue, InterpolationToMissingValueError):
            if setting.later:
                continue
            value = "???"
        except OmegaConfBaseException:
            continue  # the loader says which interpolation leads nowhere
        plain = OmegaConf.to_container(value) if OmegaConf.is_config(value) else value
        if not setting.takes(plain):
            yield refusal(f"hydra.{name}", plain, setting.allowed)
