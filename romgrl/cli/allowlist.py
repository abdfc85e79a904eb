"""What a configuration may have Hydra make and run: nothing outside the lists of this file, whoever wrote the YAML.

Hydra instantiates callbacks, launcher and sweeper, sets up logging and imports packages before any code of a job runs.
Hence the place of the check: the loader, which every composition comes out of, those of a sweep's jobs included.
"""

from __future__ import annotations

import copy
import os
import re
import traceback
from collections.abc import Collection, Iterator, Sequence
from dataclasses import fields
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override, OverrideType
from hydra.core.utils import setup_globals
from hydra.errors import HydraException
from hydra.types import RunMode
from omegaconf import DictConfig, ListConfig, OmegaConf, open_dict
from omegaconf.errors import InterpolationToMissingValueError, MissingMandatoryValue, OmegaConfBaseException

from romgrl.cli.config_files import circle, use_text_source
from romgrl.cli.hydra_internals import (
    SEARCH_TARGET,
    Callbacks,
    ConfigLoaderImpl,
    defaults_on_the_way,
    get_overrides_dirname,
    use_callbacks,
    use_loader,
    validate_no_batch,
)
from romgrl.cli.typed_text import quote_stored_sweep, quoted
from romgrl.cli.whole_paths import make_whole
from romgrl.config.schema import PRESETS, Config
from romgrl.config.values import first_kind, foreign_keys, kind_key
from romgrl.errors import one_line

TARGETS = (
    "romgrl.sweeps.callback.SweepCallback",
    "hydra._internal.core_plugins.basic_launcher.BasicLauncher",
    "hydra._internal.core_plugins.basic_sweeper.BasicSweeper",
    SEARCH_TARGET,
    "hydra_plugins.hydra_joblib_launcher.joblib_launcher.JoblibLauncher",
    "hydra_plugins.hydra_submitit_launcher.submitit_launcher.LocalLauncher",
    "hydra_plugins.hydra_submitit_launcher.submitit_launcher.SlurmLauncher",
)
LOGGING = ("logging.StreamHandler", "logging.FileHandler", "logging.NullHandler", "logging.Formatter")
LOG_STREAMS = ("ext://sys.stdout", "ext://sys.stderr")
VARIABLES = re.compile(r"(OMP|MKL|OPENBLAS|CUDA|MUJOCO|MLFLOW|ROMGRL)_[A-Z0-9_]+")
INSTANTIATED = re.compile(r"hydra\.(callbacks|launcher|sweeper)(\.|$)")
DEEPEST = 40
UNRESOLVED = object()


def guard_hydra() -> None:
    """Have Hydra load every configuration through the check, which needs its resolvers, and pass on every error."""
    setup_globals()
    os.environ["HYDRA_FULL_ERROR"] = "1"  # errors come to `main` instead of into Hydra's own report
    use_text_source()
    use_loader(GuardedLoader)
    use_callbacks(LoudCallbacks)
    validate_no_batch()


class LoudCallbacks(Callbacks):
    """Hydra's callbacks; but what one of them raises goes on, where Hydra makes a warning of it and ends with 0."""

    def _notify(self, function_name: str, reverse: bool = False, **keywords: Any) -> None:
        for callback in [*self.callbacks][:: -1 if reverse else 1]:
            getattr(callback, function_name)(**keywords)


class GuardedLoader(ConfigLoaderImpl):
    """Hydra's loader, which hands out no configuration that makes anything foreign.

    The jobs of a sweep mostly differ in values: what their files give is composed once, and each sets its values in a
    copy of that. Hydra would read and merge thirty files for each job, twice.
    """

    def __init__(self, *arguments: Any, **keywords: Any) -> None:
        super().__init__(*arguments, **keywords)
        self._asked: set[tuple[Any, ...]] = set()
        self._composed: dict[tuple[Any, ...], DictConfig] = {}

    def load_configuration(
        self, config_name: str | None, overrides: Sequence[str], run_mode: RunMode, *arguments: Any, **keywords: Any
    ) -> DictConfig:
        """Compose as Hydra does, text as it was typed, paths whole. Raises HydraException, a line per foreign thing."""
        use_text_source()
        typed = [quoted(text) for text in overrides]
        config = self._copied(config_name, typed) if run_mode == RunMode.RUN else None
        if config is None:
            config = self._composed_anew(config_name, typed, run_mode, *arguments, **keywords)
            require_allowed(config)
        name_choices(config)
        settle_kinds(config)
        quote_stored_sweep(config)
        make_whole(config)
        return config

    def _composed_anew(self, *arguments: Any, **keywords: Any) -> DictConfig:
        try:
            return super().load_configuration(*arguments, **keywords)
        except KeyError as error:  # that of a variable, which Hydra lets through
            *_, (frame, _) = traceback.walk_tb(error.__traceback__)
            if frame.f_globals.get("__name__") != os.__name__:
                raise
            name = one_line(str(error.args[0]))
            raise HydraException(f"hydra.job.env_copy: {name} is not a variable of the environment") from error
        except RecursionError as error:
            if not (names := circle([*defaults_on_the_way(error)])):
                raise
            read: Any = self.repository.load_config(names[0])
            path = f"{read.path.removeprefix('file://')}/{names[0]}.yaml"
            raise HydraException(f"{path}: its defaults come back to it: {one_line(' -> '.join(names))}") from error

    def _copied(self, config_name: str | None, overrides: list[str]) -> DictConfig | None:
        """What the files give, as composed before, with the values of these overrides; None where that is not known."""
        try:
            parsed = OverridesParser.create().parse_overrides(list(overrides))
        except (HydraException, ValueError):
            return None  # Hydra says why
        values = [override for override in parsed if self._is_value(override)]
        choices = [override.input_line or "" for override in parsed if override not in values]
        what = (config_name, *choices)
        if what not in self._asked or any(override.is_sweep_override() for override in parsed):
            self._asked.add(what)
            return None
        try:
            if what not in self._composed:
                self._composed[what] = self._composed_anew(config_name, choices, RunMode.RUN)
                require_allowed(self._composed[what])
            config = copy.deepcopy(self._composed[what])
            if config.hydra.searchpath:  # may have groups of its own
                return None
            self._apply_overrides_to_config(values, config)
        except (HydraException, OmegaConfBaseException):
            return None
        require_allowed(config, {override.key_or_group.partition(".")[0] for override in values})
        own = [override for override in parsed if not override.is_hydra_override()]
        config.hydra.overrides.task = [override.input_line for override in own]
        form = config.hydra.job.config.override_dirname
        config.hydra.job.override_dirname = get_overrides_dirname(
            own, exclude_keys=form.exclude_keys, item_sep=form.item_sep, kv_sep=form.kv_sep
        )
        return config

    def _is_value(self, override: Override) -> bool:
        """Tell whether an override sets a value and chooses no file."""
        key = override.key_or_group
        sets = override.type == OverrideType.CHANGE and override.package is None and not key.startswith("hydra")
        return sets and not self.repository.group_exists(key)

    def _process_config_searchpath(self, config_name: str | None, parsed_overrides: Any, repo: Any) -> None:
        loaded: Any = repo.load_config(config_path=config_name) if config_name is not None else None
        given = [override.value() for override in parsed_overrides if override.key_or_group == "hydra.searchpath"]
        primary = loaded.config if loaded is not None else None
        if isinstance(primary, DictConfig):  # Hydra says what is wrong with a list
            given.append(OmegaConf.select(primary, "hydra.searchpath"))
        for path in (path for paths in given for path in paths or ()):
            if "://" in str(path) and not str(path).startswith("file://"):
                raise HydraException(f"hydra.searchpath: {path} is not allowed; allowed: file://DIRECTORY")
        super()._process_config_searchpath(config_name, parsed_overrides, repo)


def settle_kinds(config: DictConfig) -> None:
    """Say which kind a group is that does not say it, the first, and leave out the keys of the others."""
    for group in (entry for entry in fields(Config) if "kinds" in entry.metadata):
        place = chosen(config, group.name)
        if not isinstance(place, DictConfig):
            continue
        if OmegaConf.is_missing(place, group.metadata["by"]):
            place[group.metadata["by"]] = first_kind(kind_key(group))
        for key in foreign_keys(lambda key: chosen(config, key)):
            owner, _, name = key.partition(".")
            if owner == group.name and OmegaConf.is_missing(place, name):
                with open_dict(place):
                    del place[name]


def chosen(config: DictConfig, key: str) -> Any:
    """What a key says; None where that cannot be resolved, which is told elsewhere."""
    try:
        return OmegaConf.select(config, key, default=None)
    except OmegaConfBaseException:
        return None


def name_choices(config: DictConfig) -> None:
    """Give every choice that does not say its name that of its file."""
    for group, choice in config.hydra.runtime.choices.items():
        place, key = (config, group) if group in PRESETS else (config.get(group), "name")
        if isinstance(place, DictConfig) and choice is not None and OmegaConf.is_missing(place, key):
            place[key] = choice


def require_allowed(config: DictConfig, changed: Collection[str] | None = None) -> None:
    """Raise HydraException with one line per foreign thing in a composed configuration.

    `changed`: the groups to look at, beside Hydra's own, where the others were looked at before.
    """
    names = None if changed is None else sorted({"hydra", *changed} & config.keys())
    lines = list(
        dict.fromkeys(line for path, value in walk_entries(config, names) if (line := refused_entry(path, value)))
    )
    if lines:
        raise HydraException("\n".join(lines))


def walk_entries(
    node: DictConfig | ListConfig, names: Sequence[str] | None = None, path: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Path and value of every entry, or those below `names`, interpolations resolved; UNRESOLVED for what cannot be."""
    if len(path) > DEEPEST:
        yield path, UNRESOLVED
        return
    entries: Any = node
    for key in names or (list(entries.keys()) if isinstance(node, DictConfig) else range(len(node))):
        try:
            value = entries[key]
        except (MissingMandatoryValue, InterpolationToMissingValueError):
            value = None  # Hydra fills in numbers and names of jobs
        except OmegaConfBaseException:
            value = UNRESOLVED
        here = (*path, str(key))
        yield here, value
        if isinstance(value, DictConfig | ListConfig):
            yield from walk_entries(value, None, here)


def refused_entry(path: tuple[str, ...], value: Any) -> str | None:
    """The line that refuses an entry; None for one that makes nothing foreign."""
    dotted, allowed = ".".join(path), None
    if path[-1] == "_target_" and value not in TARGETS:
        allowed = ", ".join(TARGETS)
    elif value is UNRESOLVED and INSTANTIATED.match(dotted):
        allowed = "what can be resolved before anything runs"
    elif path[:2] in (("hydra", "job_logging"), ("hydra", "hydra_logging")):
        if path[-1] == "()" or (path[-1] == "class" and value not in LOGGING):
            allowed = f"class: {', '.join(LOGGING)}"
        elif isinstance(value, str) and value.startswith("ext:") and value not in LOG_STREAMS:
            allowed = ", ".join(LOG_STREAMS)
    elif path[:3] == ("hydra", "job", "env_set") and len(path) == 4 and not VARIABLES.fullmatch(path[3]):
        allowed = VARIABLES.pattern
    if allowed is None:
        return None
    shown = "what it refers to" if value is UNRESOLVED else " ".join(str(value).split())
    return f"{dotted}: {shown} is not allowed; allowed: {allowed}"
