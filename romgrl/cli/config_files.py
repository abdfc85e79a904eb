"""A file of a configuration, read as Hydra reads it; one line names a file that is none and says why."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hydra.errors import HydraException
from hydra.plugins.config_source import ConfigResult
from omegaconf import DictConfig, ListConfig
from yaml import YAMLError
from yaml.error import MarkedYAMLError

from romgrl.cli import hydra_internals
from romgrl.cli.typed_text import put_back
from romgrl.errors import one_line

HERE = Path(__file__).resolve().parents[1]
CONF = HERE / "conf" if (HERE / "conf").is_dir() else HERE.parent / "conf"  # installed, or in a checkout
HEADER_FAULTS = ("Expected header format", "Too many components")  # as Hydra begins to say them
HEADER = re.compile(r"\s*#\s*@\s*package\b", re.IGNORECASE)
MARK = "\N{ZERO WIDTH NO-BREAK SPACE}"  # of the byte order, where a file begins


class FileConfigSource(hydra_internals.FileConfigSource):
    """A directory of YAML files, in which keys of text have the text of the file.

    It has the name of Hydra's own, for which Hydra then takes it in the processes of launchers, too.
    """

    def load_config(self, config_path: str) -> ConfigResult:
        """Load a file as Hydra does. Raises HydraException, one line, for a file that is no configuration."""
        path = Path(os.path.join(self.path, self._normalize_file_name(config_path)))
        try:
            result = super().load_config(config_path)
        except (YAMLError, UnicodeError, OSError) as error:
            raise HydraException(unreadable(path, error)) from error
        except ValueError as error:
            of_header = str(error).startswith(HEADER_FAULTS)
            hint = "; write `# @package NAME` and no more on that line" if of_header else ""
            raise HydraException(f"{path}: {one_line(str(error))}{hint}") from error
        text = path.read_text(encoding="utf-8")
        if result.header["package"] is None:
            check_header(path, text)
        if isinstance(result.config, DictConfig):
            check_form(path, result.config, headed=result.header["package"] is not None)
            group = config_path.rpartition("/")[0].replace("/", ".")
            package = group if (named := result.header["package"]) is None else named
            put_back(result.config, package.replace("_global_", "").replace("_group_", group), text)
        else:
            raise HydraException(f"{path}: is a list; a configuration has keys: `key: value`")
        return result


def use_text_source() -> None:
    """Have Hydra read files through the class above."""
    hydra_internals.use_file_source(FileConfigSource)


def unreadable(path: Path, error: Exception) -> str:
    """The line of a file that cannot be read or is not YAML, with the line of the fault where there is one."""
    if isinstance(error, MarkedYAMLError):
        mark = error.problem_mark or error.context_mark
        place = f":{mark.line + 1}" if mark is not None else ""
        return f"{path}{place}: is not YAML: {one_line(error.problem or str(error))}"
    if isinstance(error, UnicodeError):
        return f"{path}: is not UTF-8: {one_line(str(error))}"
    reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return f"{path}: cannot be read: {one_line(' '.join(reason.split()))}"


def check_form(path: Path, config: DictConfig, *, headed: bool) -> None:
    """Raise HydraException for a file without keys, but one that names its package, or with defaults that are none."""
    if not config and not headed:
        raise HydraException(f"{path}: is empty; a configuration has keys: `key: value`")
    defaults: Any = config._get_node("defaults")
    if defaults is not None and not isinstance(defaults, ListConfig):
        written = "a mapping" if isinstance(defaults, DictConfig) else one_line(str(defaults))
        raise HydraException(f"{path}: defaults: {written} is not allowed; allowed: a list, such as [running, _self_]")


def check_header(path: Path, text: str) -> None:
    """Raise HydraException for a file that names its package where Hydra does not look for it."""
    lines = text.removeprefix(MARK).splitlines()
    number = next((number for number, line in enumerate(lines) if HEADER.match(line)), None)
    if number is None:
        return
    above = next((place for place, line in enumerate(lines[:number]) if line.strip()), None)
    cause = "write `# @package NAME`"
    if text.startswith(MARK):
        cause = "the file starts with a byte order mark; save it without one"
    elif above is not None:
        cause = f"line {above + 1} stands above it; make it the first line"
    raise HydraException(f"{path}:{number + 1}: {' '.join(lines[number].split())[:80]} does not count: {cause}")


def circle(names: Sequence[str]) -> list[str]:
    """The names from the first one that comes again to where it does; none where no name comes again."""
    for end, name in enumerate(names):
        if name in names[:end]:
            return [*names[names.index(name) : end + 1]]
    return []
