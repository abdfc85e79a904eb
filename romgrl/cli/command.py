"""The command: checks its line, lets Hydra run the jobs that it names, and ends with an exit code."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence

import hydra
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

import romgrl
from romgrl.cli.arguments import checked, refuse
from romgrl.cli.compose import COMPOSITION_ERRORS, to_config
from romgrl.cli.config_files import CONF
from romgrl.cli.exit_codes import exit_code_of
from romgrl.cli.help import usage
from romgrl.config.schema import Config
from romgrl.errors import ConfigurationError, DivergenceError, RomgrlError, StorageError
from romgrl.runtime.display import protect

RunJob = Callable[[Config, Sequence[str]], float | None]


def told(error: OSError) -> RomgrlError:
    """A file that a job could not use, once it is told. Raises what names no file again: that is a bug."""
    if error.filename is None:
        raise error
    fault = StorageError(f"{error.filename}: {error.strerror}")
    print(fault, file=sys.stderr)
    return fault


def objective_after(error: RomgrlError) -> float | None:
    """What a search learns from a job that failed: nan where its settings are to blame, nothing where a disk may be."""
    return math.nan if isinstance(error, DivergenceError | ConfigurationError) else None


def run(job: RunJob) -> None:
    """Run every job that the command line names, and end with an exit code, one line for each fault.

    A job is called with its configuration and overrides, and returns what a search is after. One that fails says why
    at once; the others of a sweep go on.
    """
    failures: list[RomgrlError] = []

    @hydra.main(version_base="1.3", config_path=str(CONF), config_name="config")
    def run_composed(composed: DictConfig) -> float | None:
        try:
            return job(to_config(composed), HydraConfig.get().overrides.task)
        except RomgrlError as error:
            print(error, file=sys.stderr)
            failures.append(error)
        except OSError as error:
            failures.append(told(error))
        return objective_after(failures[-1])

    protect()
    if {"-h", "--help"} & set(sys.argv):
        return print(usage(CONF))
    if "--version" in sys.argv:
        return print(f"romgrl {romgrl.__version__}")
    try:
        sys.argv[1:] = checked(sys.argv[1:])
        run_composed()
    except (ConfigurationError, *COMPOSITION_ERRORS) as error:
        sys.exit(refuse(error))
    except (KeyboardInterrupt, RuntimeError, OSError, RomgrlError) as error:
        sys.exit(exit_code_of(error))
    sys.exit(failures[0].exit_code if failures else 0)
