"""Loads what a command line names, as Hydra would, and says in one line per fault why it cannot."""

from __future__ import annotations

import os
import warnings
from argparse import Namespace
from collections.abc import Iterator, Sequence
from pathlib import Path

from hydra.core.config_loader import ConfigLoader
from hydra.core.config_search_path import SearchPathQuery
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.errors import HydraException, MissingConfigException
from hydra.types import RunMode
from omegaconf import DictConfig
from omegaconf.errors import ConfigAttributeError, ConfigKeyError
from yaml import YAMLError

from romgrl.cli.allowlist import GuardedLoader
from romgrl.cli.compose import COMPOSITION_ERRORS, explanation
from romgrl.cli.config_files import CONF
from romgrl.cli.hydra_internals import BasicSweeper, create_config_search_path
from romgrl.cli.search_space import Scale, scale_from
from romgrl.cli.typed_text import holds, quoted
from romgrl.config.values import refusal, schema_groups, schema_keys, suggestion
from romgrl.errors import one_line

FILE_ERRORS = (YAMLError, UnicodeError, OSError)
MALFORMED = (ValueError, TypeError, AttributeError, KeyError, AssertionError, RecursionError, UserWarning)
"""What Hydra raises where a file or a defaults list has another form than it expects."""
NO_CHOICES = ("runtime", "schema")  # files beside conf/config.yaml that are no configuration by themselves


class Loader:
    """Composes configurations from the directories that the options name."""

    def __init__(self, options: Namespace) -> None:
        path = create_config_search_path(options.config_path or str(CONF))
        if options.config_dir is not None:
            directory = f"file://{os.path.abspath(options.config_dir)}"
            path.prepend("command-line", directory, anchor=SearchPathQuery(provider="schema"))  # as Hydra does
        self.name: str = options.config_name or "config"
        self._loader = GuardedLoader(path)

    def options_of(self, group: str) -> list[str]:
        """The choices of a group, none where there is no such group."""
        try:
            return self._loader.get_group_options(group)
        except FILE_ERRORS:
            return []

    def parse(self, text: str) -> Override | None:
        """One override; None for what is none."""
        try:
            (override,) = OverridesParser.create(self._loader).parse_overrides([quoted(text)])
        except (HydraException, ValueError):  # ValueError: a number of thousands of digits
            return None
        return override if override.key_or_group else None

    def jobs(self, overrides: Sequence[str]) -> list[list[str]]:
        """The overrides of every job of a sweep over them."""
        return sweep_jobs(overrides, self._loader)

    def space(self, overrides: Sequence[str]) -> dict[str, Scale]:
        """The keys that a search over these overrides varies."""
        return split_search(overrides, self._loader)[0]

    def probes(self, overrides: Sequence[str]) -> list[list[str]]:
        """The overrides of jobs that stand for those of a search: both ends of each key, or each of its choices."""
        space, fixed = split_search(overrides, self._loader)
        most = max((len(scale.probes) for scale in space.values()), default=0)
        points = [
            {key: scale.probes[min(at, len(scale.probes) - 1)] for key, scale in space.items()} for at in range(most)
        ]
        return [[*fixed, *(f"{key}={value}" for key, value in point.items())] for point in points]

    def compose(self, overrides: Sequence[str]) -> tuple[DictConfig | None, list[str]]:
        """What Hydra composes, or None and a line for every fault of a file or an override."""
        with warnings.catch_warnings():
            warnings.simplefilter("error", UserWarning)  # such as a directory of the search path that is not there
            try:
                composed = self._loader.load_configuration(
                    self.name, list(overrides), RunMode.RUN, validate_sweep_overrides=False
                )
            except COMPOSITION_ERRORS as error:
                return None, self.explain(error)
            except FILE_ERRORS as error:
                return None, [one_line(explanation(error))]
            except MALFORMED as error:
                return None, [f"{self.name}: cannot be composed: {one_line(explanation(error))}"]
        if not set(schema_groups()) & set(composed):
            return None, [without_schema(self.name)]
        return composed, []

    def explain(self, error: Exception) -> list[str]:
        """The lines for what could not be composed: a file that is not there, or the words of Hydra or its guard."""
        cause = error.__cause__
        if type(error) is HydraException:
            return str(error).splitlines()
        if isinstance(cause, ConfigKeyError | ConfigAttributeError) and str(cause.full_key) in schema_keys():
            return [without_schema(self.name)]
        if not isinstance(error, MissingConfigException) or error.missing_cfg_file is None:
            return [explanation(error)]
        group, _, choice = error.missing_cfg_file.removesuffix(".yaml").rpartition("/")
        choices = error.options or [
            name for name in self.options_of(group) if name not in NO_CHOICES and not name.startswith("_")
        ]
        key = group or ("--config-name" if choice == self.name else "defaults")
        return [refusal(key, choice, (", ".join(choices) or "a file that exists") + suggestion(choice, choices))]

    def where(self, key: str) -> str:
        """Name the file of the user's directories that has a key, as `in FILE`; nothing where none has it."""
        for source, path in self.files():
            group = path.parent.relative_to(source).parts
            parts, text = tuple(key.split(".")), path.read_text(encoding="utf-8", errors="replace")
            # a preset's keys start at the root, a choice's in its group
            if any(parts[: len(start)] == start and holds(text, parts[len(start) :]) for start in ((), group)):
                return f" in {path}"
        return ""

    def files(self) -> Iterator[tuple[Path, Path]]:
        """Yield every YAML file of the user's directories, behind its directory."""
        for source in self._loader.get_sources():
            if source.scheme() == "file" and Path(source.path) != CONF:
                paths = sorted(path for path in Path(source.path).rglob("*.yaml") if path.is_file())
                yield from ((Path(source.path), path) for path in paths)


def sweep_jobs(overrides: Sequence[str], loader: ConfigLoader) -> list[list[str]]:
    """The overrides of every job of a sweep over lists and ranges; a later one takes the place of an earlier one."""
    parsed = OverridesParser.create(loader).parse_overrides(list(overrides))
    return [list(job) for batch in BasicSweeper.split_arguments(parsed, None) for job in batch]


def split_search(overrides: Sequence[str], loader: ConfigLoader) -> tuple[dict[str, Scale], list[str]]:
    """The keys that a search varies, and the overrides that all of its jobs have; a later one takes an earlier's place.

    Raises HydraException for what is no override.
    """
    parsed = OverridesParser.create(loader).parse_overrides(list(overrides))
    last = {override.get_key_element(): override for override in parsed}
    space = {key: scale_from(override) for key, override in last.items() if override.is_sweep_override()}
    return space, [override.input_line or "" for key, override in last.items() if key not in space]


def stored_sweep(composed: DictConfig) -> list[str]:
    """The sweep that a file stores, as overrides."""
    return [f"{key}={value}" for key, value in (composed.hydra.sweeper.get("params") or {}).items()]


def without_schema(name: str) -> str:
    """The line of a configuration that does not have the project's keys."""
    return f"{one_line(name)}: has no schema; its defaults must start with `config`"
