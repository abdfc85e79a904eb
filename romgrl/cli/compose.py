"""Hydra's side of the configuration: the keys it knows, what it composed, and its complaints in plain words."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import Any

from hydra.core.config_store import ConfigStore
from hydra.core.plugins import Plugins
from hydra.errors import HydraException
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf, open_dict
from omegaconf.errors import MissingMandatoryValue, OmegaConfBaseException

from romgrl.cli import resolvers
from romgrl.cli.allowlist import GuardedLoader, chosen, guard_hydra
from romgrl.cli.config_files import CONF
from romgrl.cli.consistency import misfits, objective_faults
from romgrl.cli.hydra_internals import create_config_search_path
from romgrl.cli.hydra_settings import hydra_faults, searches
from romgrl.config.fields import MISSING
from romgrl.config.schema import Config
from romgrl.config.values import (
    allowed,
    bad_value,
    convert,
    fits,
    foreign_keys,
    key_groups,
    kind_key,
    of_no_kind,
    refusal,
    schema_keys,
    suggestion,
    unknown_key,
)
from romgrl.errors import ConfigurationError, one_line

COMPOSITION_ERRORS = (HydraException, OmegaConfBaseException)
ABSENT = object()
MOST_TOLD = 5  # keys of a group without a value that get a line each


def register_schema() -> None:
    """Tell Hydra the keys, without values or types, under the name that conf/config.yaml starts from; guard it.

    `read_composed` holds the types: Hydra would stop at the first value that does not have its own.
    """
    guard_hydra()
    resolvers.register()
    store_schema()


@cache
def store_schema() -> None:
    """Store the keys, once in a process."""
    keys = OmegaConf.create()
    for name in schema_keys():
        OmegaConf.update(keys, name, MISSING)
    ConfigStore.instance().store("schema", keys)
    rename_launcher_schemas()


def rename_launcher_schemas() -> None:
    """Move the schemas of installed launchers to a group of their own: conf's files of the same names extend them."""
    Plugins.instance()  # finds what is installed
    repository = ConfigStore.instance().repo
    for path in (CONF / "hydra" / "launcher").glob("*.yaml"):
        if path.name in repository["hydra"]["launcher"]:
            schemas = repository.setdefault("launcher_schema", {})
            schemas[path.name] = repository["hydra"]["launcher"].pop(path.name)


def compose_config(*overrides: str) -> Config:
    """The configuration of conf/ with overrides. Raises ConfigurationError or one of COMPOSITION_ERRORS."""
    register_schema()
    composed = conf_loader(CONF).load_configuration("config", overrides, RunMode.RUN, from_shell=False)
    with open_dict(composed):
        del composed["hydra"]
    return to_config(composed)


@cache
def conf_loader(directory: Path) -> GuardedLoader:
    """One loader of conf/ for a process, which composes once what its files give."""
    return GuardedLoader(create_config_search_path(str(directory)))


def nowhere(key: str) -> str:
    """Say nothing about the place of a key."""
    return ""


def to_config(composed: Any) -> Config:
    """Turn what Hydra composed into the typed configuration. Raises ConfigurationError for what is no such thing."""
    config, bad = read_composed(composed)
    if bad:
        raise ConfigurationError("\n".join(line for line in bad.values() if line))
    return config


def problems(composed: DictConfig, where: Callable[[str], str] = nowhere) -> list[str]:
    """One line for everything that is wrong with what Hydra composed; `where`: " in FILE" for a key of a file."""
    config, bad = read_composed(composed, where)
    lines = [*(line for line in bad.values() if line), *misfits(config, bad), *hydra_faults(composed, bad)]
    return [*lines, *(objective_faults(config, bad) if searches(composed) else ())]


def read_composed(composed: DictConfig, where: Callable[[str], str] = nowhere) -> tuple[Config, dict[str, str]]:
    """The configuration, and by key what is wrong with it: values that are bad are missing in the configuration."""
    bad = {name: unknown_key(name, where(name)) for name in added_keys(composed)}
    bad |= broken_groups(composed)
    foreign = foreign_keys(lambda key: chosen(composed, key))
    undecided = of_no_kind(lambda key: chosen(composed, key))
    values: dict[str, Any] = {}
    absent: list[str] = []
    misplaced: list[str] = []
    for key, entry in schema_keys().items():
        if key not in foreign:
            values[key] = MISSING
        if key.partition(".")[0] in bad or key in undecided:
            bad[key] = ""  # the line of its group or of its kind says it
            continue
        try:
            value = as_python(OmegaConf.select(composed, key, default=ABSENT, throw_on_missing=True))
        except MissingMandatoryValue:
            value = ABSENT
        except (OmegaConfBaseException, RecursionError) as error:
            bad[key] = unresolved(composed, key, error)
            continue
        if key in foreign:
            if value is not ABSENT:
                kind = chosen(composed, foreign[key])
                bad[key] = f"{key}: {foreign[key]}={kind} has no such key"
                misplaced.append(key)
        elif value is ABSENT:
            bad[key] = f"{key}: has no value; give it as {key}=...; allowed: {allowed(entry)}"
            absent.append(key)
        elif fits(value, entry):
            values[key] = convert(value, entry)
        else:
            bad[key] = bad_value(key, value)
    if len(misplaced) > MOST_TOLD:  # of a preset of another kind, which lacks what this one needs
        key, group = foreign[misplaced[0]], misplaced[0].partition(".")[0]
        line = f"{key}: {chosen(composed, key)} does not go with the rest of `{group}`, which has {misplaced[0]}"
        bad |= dict.fromkeys((*misplaced, *absent), "") | {key: f"{line} and others; choose {group}=NAME of that model"}
        return assemble_config(values), bad
    return assemble_config(values), bad | gathered(absent)


def gathered(absent: Sequence[str]) -> dict[str, str]:
    """One line instead of many for a group of which many keys have no value."""
    lines: dict[str, str] = {}
    groups = Counter(key.partition(".")[0] for key in absent)
    for group in (group for group, count in groups.items() if count > MOST_TOLD):
        keys = [key for key in absent if key.startswith(f"{group}.")]
        others = f"as {groups[group] - 1} others of `{group}`"
        start = "a file that says only what differs starts with `defaults: [NAME, _self_]`"
        lines |= dict.fromkeys(keys, "") | {keys[0]: f"{keys[0]}: has no value, {others}; {start}"}
    return lines


def as_python(value: Any) -> Any:
    """Lists and mappings of Python, with every interpolation in them resolved."""
    return OmegaConf.to_container(value, resolve=True) if OmegaConf.is_config(value) else value


def plain_unresolved(composed: DictConfig) -> Any:
    """What Hydra composed in mappings of Python, interpolations as they were written."""
    return OmegaConf.to_container(composed, resolve=False)


def added_keys(composed: DictConfig, prefix: str = "") -> Iterator[str]:
    """Yield the keys that the schema does not have, the outermost of a branch."""
    keys = schema_keys()
    for name in composed:
        key = prefix + str(name)
        if key in branches():
            node = composed._get_node(name)
            if isinstance(node, DictConfig) and not node._is_none() and not node._is_interpolation():
                yield from added_keys(node, f"{key}.")
        elif key not in keys and key != "hydra":
            yield key


@cache
def branches() -> frozenset[str]:
    """The keys that have others below them."""
    parts = (key.split(".") for key in schema_keys())
    return frozenset(".".join(names[:depth]) for names in parts for depth in range(1, len(names)))


def broken_groups(composed: DictConfig) -> dict[str, str]:
    """A line for every group that is no group of keys any more."""
    lines = {}
    for group in key_groups():
        node = composed._get_node(group)
        if not isinstance(node, DictConfig) or node._is_none() or node._is_missing():
            value = None if node is None else plain_unresolved(composed)[group]
            lines[group] = refusal(group, value, f"the keys of the group, such as {group}.{first_key(group)}: ...")
    return lines


def first_key(group: str) -> str:
    """The first key of a group, without the group's name."""
    return next(name for name in schema_keys() if name.startswith(f"{group}.")).partition(".")[2]


def unresolved(composed: DictConfig, key: str, error: Exception) -> str:
    """The line of an interpolation that leads nowhere, with the key that it may have meant."""
    written = plain_unresolved(composed)
    for part in key.split("."):
        written = written[part]
    text, entry = str(written), schema_keys()[key]
    meant = suggestion(text[text.find("${") + 2 :].partition("}")[0], schema_keys())
    return f"{key}: {one_line(text)} cannot be resolved: {explanation(error)}{meant}; allowed: {allowed(entry)}"


def explanation(error: Exception) -> str:
    """What Hydra or OmegaConf says, on one line: its first sentence, and where that ends in a colon the next."""
    cause = error.__cause__ or error
    key = getattr(cause, "full_key", None)
    lines = [" ".join(line.split()) for line in str(cause).splitlines() if line.strip()] or [type(cause).__name__]
    text = " ".join(lines[: 2 if lines[0].endswith(":") else 1])
    if key and text.endswith("is not Optional"):
        return refusal(str(key), None, "a value, as the key has it in conf/")
    return f"{key}: {text}" if key and key not in text else text


def assemble_config(values: Mapping[str, Any], schema: Any = Config, prefix: str = "") -> Any:
    """The dataclass of the schema with the values of all dotted keys."""
    parts = {}
    for entry in fields(schema):
        name = prefix + entry.name
        kinds = entry.metadata.get("kinds", {})
        group = kinds.get(values.get(kind_key(entry)), entry.default_factory)
        parts[entry.name] = values[name] if name in values else assemble_config(values, group, f"{name}.")
    return schema(**parts)
