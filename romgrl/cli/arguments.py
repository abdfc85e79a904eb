"""Checks a command line, and the files that it names, before Hydra or anything else acts on it."""

from __future__ import annotations

import os
import sys
from argparse import ArgumentError, Namespace
from collections.abc import Iterator, Sequence
from typing import Any

from hydra.core.override_parser.types import IntervalSweep, Override, ValueType
from hydra.types import RunMode
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from romgrl.cli.compose import explanation, problems, register_schema
from romgrl.cli.hydra_internals import get_args_parser
from romgrl.cli.hydra_loader import Loader, stored_sweep
from romgrl.cli.hydra_settings import searches
from romgrl.cli.typed_text import is_any_text
from romgrl.config.addresses import as_typed
from romgrl.config.values import (
    allowed,
    bad_value,
    fits,
    kind_of,
    refusal,
    schema_groups,
    schema_keys,
    suggestion,
    unknown_key,
)
from romgrl.errors import ConfigurationError, one_line
from romgrl.runtime.surroundings import adapt_environment

LONGEST_MESSAGE = 300  # characters of what argparse says
LONGEST_QUOTED = 200  # characters of a value that a line repeats in quotes
OPTIONS = ("--cfg", "--config-dir", "--config-name", "--config-path", "--help", "--info", "--multirun", "--package")
NOTHING_TO_SEARCH = "hydra/sweeper=optuna: there is nothing to search; give a key an interval: eta=interval(0.1,0.9)"

NAMING = {option: option for option in ("--config-dir", "--config-name", "--config-path", "--package")}
NAMING |= {"-cd": "--config-dir", "-cn": "--config-name", "-cp": "--config-path", "-p": "--package"}


def flags_first(arguments: Sequence[str]) -> list[str]:
    """Put options before overrides, so that -m may stand anywhere; Hydra's parser wants it so."""
    return sorted(
        joined_options(arguments), key=lambda text: not text.startswith("-") and ("=" in text or text[:1] in ("~", "+"))
    )


def joined_options(arguments: Sequence[str]) -> Iterator[str]:
    """Yield the arguments, each option that names something in one piece with it, and directories with ~ expanded."""
    rest = iter(arguments)
    for text in rest:
        name, equals, value = text.partition("=")
        option = NAMING.get(name)
        named = value if equals or option is None else next(rest, None)
        if option is None or named is None:
            yield text
        else:
            yield f"{option}={os.path.expanduser(named) if option == '--config-dir' else named}"


def faults(arguments: Sequence[str]) -> list[str]:
    """One line for everything that is wrong with a command line and its files; none where it can run."""
    options, lines = read_options(arguments)
    if options is None or options.shell_completion or options.hydra_help:
        return lines
    register_schema()
    loader = Loader(options)
    read = {text: loader.parse(text) for text in options.overrides}
    lines += [unreadable_override(text) for text, override in read.items() if override is None]
    overrides = [override for override in read.values() if override is not None]
    lines += given_twice(options.overrides)
    found = [[*override_faults(override, loader)] for override in overrides]
    lines += [line for some in found for line in some]
    sound = [override for override, some in zip(overrides, found, strict=True) if not some]
    told = composed_faults(sound, loader, multirun=options.multirun)
    lines += [line for line in told if line != NOTHING_TO_SEARCH or not lines]  # its keys may be those that are told
    return [*dict.fromkeys(lines or package_faults(options, loader))]


def checked(arguments: Sequence[str]) -> list[str]:
    """The arguments as Hydra's parser wants them; ConfigurationError where something is wrong with them."""
    adapt_environment()
    if lines := faults(arguments):
        raise ConfigurationError("\n".join(lines))
    return flags_first(arguments)


def refuse(error: Exception) -> int:
    """Print what is wrong with this process's command line and return the exit code."""
    print(error if isinstance(error, ConfigurationError) else explanation(error), file=sys.stderr)
    return ConfigurationError.exit_code


def read_options(arguments: Sequence[str]) -> tuple[Namespace | None, list[str]]:
    """Hydra's options, and a line for each that is unknown or does not fit; None where they cannot be read at all."""
    parser = get_args_parser()
    parser.exit_on_error = parser.allow_abbrev = False
    try:
        options, unknown = parser.parse_known_args(flags_first(arguments))
    except ArgumentError as error:
        return None, [one_line(str(error), LONGEST_MESSAGE)]
    lines = [f"{one_line(text)}: unknown option{suggestion(text, OPTIONS)}; --help lists them" for text in unknown]
    if options.experimental_rerun is not None:
        lines.append("--experimental-rerun: is not available; it would run what a file says")
    directory, path = options.config_dir, options.config_path
    if directory is not None and not os.path.isdir(directory):
        lines.append(refusal("--config-dir", directory, "a directory that exists"))
    if path is not None and not (os.path.isabs(path) and os.path.isdir(path)):
        lines.append(refusal("--config-path", path, "the absolute path of a directory that exists"))
    if options.resolve and options.cfg is None:
        lines.append("--resolve: goes with --cfg")
    if options.package is not None and options.cfg is None:
        lines.append("--package: goes with --cfg")
    modes = ("run", "cfg", "multirun", "info", "shell_completion")
    chosen = [f"--{mode.replace('_', '-')}" for mode in modes if getattr(options, mode)]
    if len(chosen) > 1:
        lines.append(f"{' '.join(chosen)}: only one of them at a time")
    return (None if lines else options), lines


def unreadable_override(text: str) -> str:
    """The line of an argument that is no override, with what its key takes where it has one."""
    key, _, value = text.partition("=")
    key = key.lstrip("+~")
    line = f"{one_line(text)}: cannot be read; write key=value"
    if "=" not in text or not key:
        return line
    if is_any_text(key):
        return f"{one_line(text)}: cannot be read; {quoting_hint(key, value)}"
    entry = schema_keys().get(key)
    return f"{line}; {unknown_key(key)}" if entry is None else f"{line}; allowed: {allowed(entry)}"


def quoting_hint(key: str, value: str) -> str:
    """How text is written that Hydra reads as something else, to be pasted into a shell."""
    whole = len(value) <= LONGEST_QUOTED and value.isprintable() and not value.startswith(("'", '"'))
    example = as_typed(key, value) if whole else f"\"{key}='...'\""
    return f"put it in quotes, for the shell too: {example}"


def given_twice(overrides: Sequence[str]) -> Iterator[str]:
    """Yield a line for every key that a command line gives more than once."""
    values: dict[str, list[str]] = {}
    for text in overrides:
        key, _, value = text.partition("=")
        values.setdefault(key.lstrip("+~"), []).append(value)
    for key, several in values.items():
        if len(several) > 1:
            yield f"{one_line(key)}: has {len(several)} values, {one_line(' and '.join(several))}; give it one"


def override_faults(override: Override, loader: Loader) -> Iterator[str]:
    """Yield a line for everything that keeps Hydra from applying one override to the schema, whatever its value is."""
    text, key = one_line(override.input_line or ""), override.key_or_group
    if key.startswith("hydra."):
        return
    choices = loader.options_of(key)
    known = key in schema_keys() or key in schema_groups()
    if not choices and not known:
        yield unknown_key(key)
    elif override.package is not None:
        yield f"{text}: a choice goes where its group is; write {key}=..."
    elif override.is_delete():
        yield f"{key}: has no value; give it as {key}=...; allowed: {permitted(key, choices)}"
    elif known and override.is_add():
        yield f"{text}: {key} is there already; write {text[1:]}"
    elif override.is_interval_sweep():
        yield from interval_faults(override, choices)
    elif is_any_text(key) and any(isinstance(value, list | dict) for value in values_of(override)):
        yield f"{bad_value(key, override.value())}; {quoting_hint(key, (override.input_line or '').partition('=')[2])}"
    elif not values_of(override):
        yield f"{text}: names no value of {key}; allowed: {permitted(key, choices)}"
    elif choices:
        for choice in values_of(override):
            if choice not in choices:
                yield refusal(key, choice, permitted(key, choices) + suggestion(str(choice), choices))


def interval_faults(override: Override, choices: Sequence[str]) -> Iterator[str]:
    """Yield a line for an interval that no search can draw from."""
    key, interval = override.key_or_group, override.value()
    text = one_line(override.input_line or "")
    assert isinstance(interval, IntervalSweep)
    low, high, tags = interval.start, interval.end, interval.tags
    if key not in schema_keys() or kind_of(schema_keys()[key]).item not in ("int", "float"):
        yield f"{text}: {key} is no number; allowed: {permitted(key, choices)}"
    elif low is None or high is None or not low < high or not tags <= {"log"} or ("log" in tags and low <= 0):
        yield f"{text}: is no interval; write interval(LOW,HIGH) or, with LOW above 0, tag(log,interval(LOW,HIGH))"


def endless(override: Override) -> str:
    """The line of an interval where values are to be listed."""
    key = override.key_or_group
    line = f"{one_line(override.input_line or '')}: has no end; list the values of {key}, or add hydra/sweeper=optuna"
    return f"{line}; allowed: {permitted(key, ())}"


def permitted(key: str, choices: Sequence[str]) -> str:
    """What a key or a group takes."""
    return ", ".join(choices) if choices else allowed(schema_keys()[key])


def values_of(override: Override) -> list[Any]:
    """The values of an override; one where it is no sweep, and the ends of an interval."""
    if override.is_interval_sweep():
        interval: Any = override.value()
        return [interval.start, interval.end]
    return [*override.sweep_iterator()] if override.is_sweep_override() else [override.value()]


def composed_faults(overrides: Sequence[Override], loader: Loader, *, multirun: bool) -> list[str]:
    """One line for everything that is wrong with what Hydra composes, in any job of a sweep."""
    fixed = [override.input_line or "" for override in overrides if not override.is_sweep_override()]
    sweeps = [override for override in overrides if override.is_sweep_override()]
    composed, lines = loader.compose(fixed)
    if composed is None:
        bad = {override.key_or_group: [*value_faults(override)] for override in overrides}
        rest = [override for override in overrides if not bad[override.key_or_group]]
        told = [line for found in bad.values() for line in found]
        return [*told, *(composed_faults(rest, loader, multirun=multirun) if told else lines)]
    if multirun and composed.hydra.mode == RunMode.RUN:
        return [refusal("hydra.mode", "RUN", "MULTIRUN, or nothing, with -m")]
    if not multirun and composed.hydra.mode != RunMode.MULTIRUN:
        lines = [sweep_without_flag(sweep) for sweep in sweeps]
        return [*lines, *problems(composed, loader.where)]
    parameters = stored_sweep(composed)
    lines = [line for text in parameters for line in parameter_faults(text, loader)]
    stored = [override for text in parameters if (override := loader.parse(text))]
    searched = searches(composed)
    if not searched:
        lines += [endless(override) for override in (*overrides, *stored) if override.is_interval_sweep()]
    if lines:
        return [*lines, *problems(composed, loader.where)]
    asked = [*parameters, *(override.input_line or "" for override in overrides)]
    if searched and not loader.space(asked):
        lines = [NOTHING_TO_SEARCH]
    for job in loader.probes(asked) if searched else loader.jobs(asked):
        composed, failures = loader.compose(job)
        lines += failures if composed is None else problems(composed, loader.where)
    return lines


def package_faults(options: Namespace, loader: Loader) -> Iterator[str]:
    """Yield the line of a part of the configuration that is asked for and is not there."""
    name = options.package
    if name in (None, "_global_"):
        return
    composed, _ = loader.compose(options.overrides)
    own = name.partition(".")[0] != "hydra"
    try:
        found = None if composed is None else OmegaConf.select(composed, name)
    except OmegaConfBaseException:
        found = None
    if found is None or options.cfg == ("hydra" if own else "job"):
        groups = [] if options.cfg == "hydra" else schema_groups()
        permitted = ", ".join(["_global_", *groups, *(["hydra"] if options.cfg != "job" else [])])
        near = suggestion(name, [key for key in (*groups, *schema_keys()) if key != name]) if groups else ""
        yield refusal("--package", name, f"{permitted}, or a key of them that has a value{near}")


def sweep_without_flag(override: Override) -> str:
    """The line of several values where one is wanted; those of text may be one with a comma in it."""
    text, key = override.input_line or "", override.key_or_group
    line = f"{one_line(text)}: is a sweep over several values; put -m before the keys"
    comma = override.value_type == ValueType.SIMPLE_CHOICE_SWEEP and is_any_text(key)
    return f"{line}, or where it is one value, {quoting_hint(key, text.partition('=')[2])}" if comma else line


def parameter_faults(text: str, loader: Loader) -> list[str]:
    """One line for everything that keeps a sweep that a file stores from being applied."""
    override = loader.parse(text)
    return [unreadable_override(text)] if override is None else [*override_faults(override, loader)]


def value_faults(override: Override) -> Iterator[str]:
    """Yield a line for every value that does not fit its key, where nothing could be composed."""
    key, keys = override.key_or_group, schema_keys()
    for value in values_of(override) if key in keys else ():
        if not (isinstance(value, str) and "${" in value) and not fits(value, keys[key]):
            yield bad_value(key, value)
