"""Hydra's side of the configuration: the schema it knows, what it composed, and its complaints in plain words."""

from __future__ import annotations

import difflib
import sys
from collections.abc import Iterator, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from hydra._internal.utils import get_args_parser
from hydra.core.config_store import ConfigStore
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.errors import HydraException, MissingConfigException
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from romgrl.config import MISSING, Config
from romgrl.errors import ConfigurationError
from romgrl.targets import guard
from romgrl.validation import allowed, in_range, refusal, schema_keys, unknown_key, value_of

HERE = Path(__file__).resolve().parent
CONF = HERE / "conf" if (HERE / "conf").is_dir() else HERE.parent / "conf"  # installed, or in a checkout
COMPOSITION_ERRORS = (HydraException, OmegaConfBaseException)


def register_schema() -> None:
    """Tell Hydra the schema under the name that conf/config.yaml starts from, and what it may instantiate."""
    guard()
    ConfigStore.instance().store("schema", Config)


def flags_first(arguments: Sequence[str]) -> list[str]:
    """Put options before overrides, so that -m may stand anywhere; Hydra's parser wants it so."""
    return sorted(arguments, key=lambda text: not text.startswith("-") and ("=" in text or text[:1] in ("~", "+")))


def to_config(composed: Any) -> Config:
    """Turn what Hydra composed into the typed configuration. Raises ConfigurationError for missing or added keys."""
    config = OmegaConf.to_object(composed)
    if not isinstance(config, Config):
        raise ConfigurationError("the configuration has no schema; its defaults must start with `config`")
    added = sorted(set(vars(config)) - {entry.name for entry in fields(Config)})
    problems = [unknown_key(name) for name in added]
    problems += [
        f"{name}: has no value; give it as {name}=..." for name in schema_keys() if value_of(config, name) == MISSING
    ]
    if problems:
        raise ConfigurationError("\n".join(problems))
    return config


def refuse(error: Exception) -> int:
    """Print what is wrong with this process's command line and return the exit code."""
    print("\n".join(explain(get_args_parser().parse_args().overrides, error)), file=sys.stderr)
    return ConfigurationError.exit_code


def explain(overrides: Sequence[str], error: Exception) -> list[str]:
    """One line per bad override; where none is at fault, the first line of Hydra's own message."""
    sweep_without_flag = str(error).startswith("Ambiguous value")
    lines = [line for text in overrides for line in explain_override(text, sweep_without_flag)]
    return lines or [unavailable_choice(error) or first_line(error)]


def explain_override(text: str, sweep_without_flag: bool) -> Iterator[str]:
    """Yield a line for everything that is wrong with one `key=value`."""
    try:
        override = OverridesParser.create().parse_override(text)
    except HydraException:
        yield f"{text}: cannot be read; write key=value"
        return
    key, keys = override.key_or_group, schema_keys()
    if key.startswith("hydra") or override.is_delete():
        return
    if override.is_sweep_override() and sweep_without_flag:
        yield f"{text}: is a sweep over several values; put -m before the keys"
    elif key in keys and not is_group(key):
        yield from bad_values(key, override)
    elif not is_group(key):
        yield unknown_key(key)


def is_group(key: str) -> bool:
    """Tell whether `key=choice` picks a file of a group."""
    groups = {name.partition(".")[0] for name in schema_keys() if "." in name} | {"experiment"}
    return key in groups


def bad_values(key: str, override: Override) -> Iterator[str]:
    """Yield a line for every value of an override, or of its sweep, that its key does not take."""
    entry = schema_keys()[key]
    values = list(override.sweep_iterator()) if override.is_sweep_override() else [override.value()]
    for value in values:
        config = OmegaConf.structured(Config)
        try:
            OmegaConf.update(config, key, value)
            fits = in_range(value, entry)
        except OmegaConfBaseException:
            fits = False
        if not fits:
            yield refusal(key, value, allowed(entry))


def unavailable_choice(error: Exception) -> str | None:
    """The line for a choice that its group does not have."""
    if not isinstance(error, MissingConfigException) or not error.options or not error.missing_cfg_file:
        return None
    group, _, choice = error.missing_cfg_file.rpartition("/")
    close = difflib.get_close_matches(choice, error.options, n=1)
    hint = f" (did you mean {close[0]}?)" if close else ""
    return refusal(group, choice, ", ".join(error.options) + hint)


def first_line(error: Exception) -> str:
    """What Hydra or OmegaConf says, on one line."""
    cause = error.__cause__ or error
    key = getattr(cause, "full_key", None)
    text = (str(cause).splitlines() or [type(cause).__name__])[0]
    return f"{key}: {text}" if key else text
