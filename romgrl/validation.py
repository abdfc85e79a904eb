"""Checks of a composed configuration: the range of every key, and what must fit together."""

from __future__ import annotations

import difflib
import math
import os
from collections.abc import Iterator
from dataclasses import Field, fields, is_dataclass
from pathlib import Path
from typing import Any

from romgrl.config import Config
from romgrl.errors import ConfigurationError

NAMES = {"int": "a whole number", "float": "a number", "str": "text", "bool": "true or false"}


def schema_keys(schema: type = Config, prefix: str = "") -> dict[str, Field[Any]]:
    """Map every dotted key of the schema to its field; groups are walked, not listed."""
    keys: dict[str, Field[Any]] = {}
    for entry in fields(schema):
        factory = entry.default_factory
        if isinstance(factory, type) and is_dataclass(factory):
            keys |= schema_keys(factory, f"{prefix}{entry.name}.")
        else:
            keys[prefix + entry.name] = entry
    return keys


def value_of(config: Any, key: str) -> Any:
    """Value at a dotted key."""
    for part in key.split("."):
        config = getattr(config, part)
    return config


def allowed(entry: Field[Any]) -> str:
    """Describe the values that a key takes, as in `0 <= number <= 1` or `cpu, cuda`."""
    if entry.metadata["choices"]:
        return ", ".join(entry.metadata["choices"])
    kind = str(entry.type)
    optional = kind.endswith("| None")
    kind = kind.removesuffix("| None").strip()
    item = kind.removeprefix("list[").removesuffix("]")
    text = NAMES[item] if item == kind else f"a list, each {NAMES[item]}"
    low, high, above = (entry.metadata[name] for name in ("low", "high", "above"))
    bounds = [f"> {above:g}"] if above is not None else [f">= {low:g}"] if low is not None else []
    bounds += [f"<= {high:g}"] if high is not None else []
    text += f" {' and '.join(bounds)}" if bounds else ""
    text += f" {entry.metadata['unit']}" if entry.metadata["unit"] and bounds else ""
    return f"{text}, or null" if optional else text


def show(value: Any) -> str:
    """Write a value as YAML would."""
    if value is None:
        return "null"
    return str(value).lower() if isinstance(value, bool) else str(value)


def refusal(key: str, value: Any, permitted: str) -> str:
    """Write the one line that every bad value gets."""
    shown = " ".join(show(value).split())
    return f"{key}: {shown} is not allowed; allowed: {permitted}"


def unknown_key(key: str) -> str:
    """Write the one line that an unknown key gets, with the nearest known one."""
    known = list(schema_keys())
    group, _, leaf = key.rpartition(".")
    siblings = {name.rpartition(".")[2]: name for name in known if name.rpartition(".")[0] == group}
    anywhere = {name.rpartition(".")[2]: name for name in reversed(known)}
    near = difflib.get_close_matches(leaf, siblings, n=1, cutoff=0.6)
    elsewhere = difflib.get_close_matches(leaf, anywhere, n=1, cutoff=0.75)
    close = [siblings[name] for name in near] or [anywhere[name] for name in elsewhere]
    hint = f"did you mean {close[0]}?" if close else "docs/configuration.md lists all keys"
    return f"{key}: unknown key; {hint}"


def in_range(value: Any, entry: Field[Any]) -> bool:
    """Tell whether one value (or every entry of a list) lies in the key's range and choices."""
    if isinstance(value, list):
        return all(in_range(item, entry) for item in value)
    if value is None or isinstance(value, bool):
        return True
    low, high, above, choices = (entry.metadata[name] for name in ("low", "high", "above", "choices"))
    if isinstance(value, str):
        return not choices or value in choices
    return (
        math.isfinite(value)
        and (low is None or value >= low)
        and (high is None or value <= high)
        and (above is None or value > above)
    )


def out_of_range(config: Config) -> Iterator[str]:
    """Yield a line for every value outside its own range."""
    for key, entry in schema_keys().items():
        value = value_of(config, key)
        if not in_range(value, entry):
            yield refusal(key, value, allowed(entry))
        elif str(entry.type).startswith("list[int]") and not all(size >= 1 for size in value):
            yield refusal(key, value, "a list of whole numbers >= 1")


def misfits(config: Config) -> Iterator[str]:
    """Yield a line for every pair of keys that do not fit together, and for what this machine lacks."""
    for key in ("rom.reset_hip_angle", "rom.reset_speed", "humanoid.reset_speed"):
        value = value_of(config, key)
        if len(value) != 2 or not value[0] <= value[1]:
            yield refusal(key, value, "two numbers, the lower one first")
    limits = (
        ("student.batch_size", "student.buffer_size"),
        ("student.num_envs", "student.buffer_size"),
        ("student.learning_starts", "student.total_steps"),
        ("evaluation.window", "evaluation.steps"),
        ("reference.warmup_steps", "teacher.episode_steps"),
        ("reference.episodes", "reference.steps"),
    )
    for key, bound in limits:
        if value_of(config, key) > value_of(config, bound):
            yield refusal(key, value_of(config, key), f"at most {bound} = {value_of(config, bound)}")
    rollout = config.teacher.num_envs * config.teacher.rollout_steps
    if config.teacher.minibatch_size > rollout:
        permitted = f"at most teacher.num_envs x teacher.rollout_steps = {rollout}"
        yield refusal("teacher.minibatch_size", config.teacher.minibatch_size, permitted)
    if config.discriminator.name != "none" and config.discriminator.window > config.reference.steps:
        permitted = f"at most reference.steps = {config.reference.steps}"
        yield refusal("discriminator.window", config.discriminator.window, permitted)
    if config.humanoid.name == "humenv" and config.humanoid.xml is None:
        yield refusal("humanoid.xml", None, "the path of HumEnv's robot.xml")
    if config.humanoid.xml is not None and not Path(config.humanoid.xml).expanduser().is_file():
        yield refusal("humanoid.xml", config.humanoid.xml, "a MuJoCo file that exists")
    outputs = Path(config.paths.outputs).expanduser().absolute()
    nearest = next(path for path in (outputs, *outputs.parents) if path.exists())
    if not nearest.is_dir() or not os.access(nearest, os.W_OK):
        yield refusal("paths.outputs", config.paths.outputs, "a directory that can be written")
    if config.device == "cuda" and not cuda_available():
        yield refusal("device", "cuda", "cpu (no CUDA device was found)")


def cuda_available() -> bool:
    """Ask torch for a CUDA device; imported only when one is asked for."""
    import torch

    return torch.cuda.is_available()


def validate(config: Config) -> None:
    """Raise ConfigurationError with one line per bad key; called before any directory, run or training is made."""
    problems = list(out_of_range(config)) or list(misfits(config))
    if problems:
        raise ConfigurationError("\n".join(problems))
