"""The command: checks its line, lets Hydra run the jobs that it names, and ends with an exit code."""

from __future__ import annotations

import sys

import hydra
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

import romgrl
from romgrl.command_line import checked, refuse
from romgrl.composition import COMPOSITION_ERRORS, CONF, to_config
from romgrl.display import protect
from romgrl.endings import exit_code_of
from romgrl.errors import ConfigurationError, RomgrlError, StorageError
from romgrl.usage import usage

failures: list[RomgrlError] = []


@hydra.main(version_base="1.3", config_path=str(CONF), config_name="config")
def job(composed: DictConfig) -> None:
    """Run one job, named by its overrides; a failure is told at once, and the other jobs of a sweep go on."""
    from romgrl.launch import run_job

    try:
        run_job(to_config(composed), HydraConfig.get().overrides.task)
    except RomgrlError as error:
        print(error, file=sys.stderr)
        failures.append(error)
    except OSError as error:
        failures.append(told(error))


def told(error: OSError) -> RomgrlError:
    """A file that a job could not use, once it is told. Raises what names no file again: that is a bug."""
    if error.filename is None:
        raise error
    fault = StorageError(f"{error.filename}: {error.strerror}")
    print(fault, file=sys.stderr)
    return fault


def run() -> None:
    """Run, and turn what can go wrong into one line per fault and an exit code."""
    protect()
    if {"-h", "--help"} & set(sys.argv):
        return print(usage(CONF))
    if "--version" in sys.argv:
        return print(f"romgrl {romgrl.__version__}")
    try:
        sys.argv[1:] = checked(sys.argv[1:])
        job()
    except (ConfigurationError, *COMPOSITION_ERRORS) as error:
        sys.exit(refuse(error))
    except (KeyboardInterrupt, RuntimeError, OSError, RomgrlError) as error:
        sys.exit(exit_code_of(error))
    sys.exit(failures[0].exit_code if failures else 0)
