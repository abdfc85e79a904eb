"""Text as it was typed: 1.10, 1_000, 1e3, yes or true, which Hydra and YAML read as something else.

Overrides get quotes before Hydra reads them, files their own words after YAML has read them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache, lru_cache
from typing import Any

import yaml
from antlr4 import InputStream, Token
from hydra.core.override_parser.overrides_visitor import HydraErrorListener
from hydra.errors import HydraException
from hydra.grammar.gen.OverrideLexer import OverrideLexer
from omegaconf import DictConfig, OmegaConf
from omegaconf._utils import get_yaml_loader

from romgrl.config.addresses import in_quotes
from romgrl.config.schema import PRESETS
from romgrl.config.values import RENAMED, kind_of, schema_groups, schema_keys

OF_HYDRA = ("run.dir", "sweep.dir", "sweep.subdir", "job.name", "sweeper.study_name", "sweeper.storage")
OF_LAUNCHERS = ("account", "comment", "constraint", "name", "nodelist", "partition", "qos", "submitit_folder")
TEXT_OF_HYDRA = {*(f"hydra.{name}" for name in OF_HYDRA), *(f"hydra.launcher.{name}" for name in OF_LAUNCHERS)}
LOSSY = (OverrideLexer.INT, OverrideLexer.FLOAT, OverrideLexer.BOOL, OverrideLexer.NULL)
BETWEEN = (OverrideLexer.COMMA, OverrideLexer.EQUAL)
OPENING = (OverrideLexer.POPEN, OverrideLexer.BRACKET_OPEN, OverrideLexer.BRACE_OPEN)
CLOSING = (OverrideLexer.PCLOSE, OverrideLexer.BRACKET_CLOSE, OverrideLexer.BRACE_CLOSE)
OF_TEXT = ("choice", "shuffle")  # functions whose arguments are values; those of `range` are numbers
NULL = "null"  # a value of its own, in this spelling
MERGE = "tag:yaml.org,2002:merge"
LOSSY_TAGS = tuple(f"tag:yaml.org,2002:{name}" for name in ("int", "float", "bool"))
PARAMETERS = ("hydra", "sweeper", "params")


@cache
def is_text(key: str) -> bool:
    """Tell whether a key takes text: a name, a path, an address, or a choice of a group."""
    entry = schema_keys().get(key)
    if entry is None:
        return key in TEXT_OF_HYDRA or key in schema_groups() or "/" in key
    return kind_of(entry).item == "str" and not kind_of(entry).many


def is_any_text(key: str) -> bool:
    """Tell whether a key takes any text, not one of a few choices."""
    entry = schema_keys().get(key)
    chosen = key in schema_groups() or "/" in key if entry is None else entry.metadata["choices"] or key in PRESETS
    return is_text(key) and not chosen


def current_name(override: str) -> str:
    """An override of a key that was called otherwise, with the name that it has now."""
    key, sign, value = override.partition("=")
    return RENAMED.get(key, key) + sign + value


def quoted(override: str) -> str:
    """An override, with quotes around each value that a key of text would lose; what cannot be read stays."""
    override = current_name(override)
    key, _, value = override.partition("=")
    if not value or not is_text(key.lstrip("+").partition("@")[0]):
        return override
    lexer: Any = OverrideLexer(InputStream(override))
    lexer.removeErrorListeners()
    lexer.addErrorListener(HydraErrorListener())
    try:
        lost = [*lossy(lexer.getAllTokens())]
    except HydraException:
        return override
    for token in reversed(lost):
        override = override[: token.start] + in_quotes(token.text) + override[token.stop + 1 :]
    return override


def lossy(tokens: Sequence[Any]) -> Iterator[Any]:
    """Yield the token of each value that is no text to Hydra, where text is wanted: alone, in a sweep, in `choice`."""
    opened: list[str] = []
    element: list[Any] = []
    previous, value = "", False
    for token in [*tokens, None]:
        kind = Token.EOF if token is None else token.type
        if kind in (*BETWEEN, *OPENING, *CLOSING, Token.EOF):
            lost = len(element) == 1 and element[0].type in LOSSY and element[0].text != NULL
            if value and lost and set(opened) <= set(OF_TEXT):
                yield element[0]
            opened += [previous] if kind in OPENING else []
            opened = opened[:-1] if kind in CLOSING else opened
            element, value = [], value or kind == OverrideLexer.EQUAL
        elif kind != OverrideLexer.WS:
            element.append(token)
        previous = token.text if token is not None else ""


def quote_stored_sweep(config: DictConfig) -> None:
    """Put the quotes into the sweep that a file stores, where Hydra's sweeper finds it."""
    parameters = OmegaConf.select(config, "hydra.sweeper.params") or {}
    for key, value in parameters.items():
        parameters[key] = quoted(f"{key}={value}").partition("=")[2]


def put_back(config: DictConfig, package: str, text: str) -> None:
    """Give the keys of text in what YAML read the words of the file."""
    prefix = tuple(part for part in package.split(".") if part)
    for path, written in unread(text):
        whole = (*prefix, *path)
        if is_text(whole[-1] if whole[:-1] == PARAMETERS else ".".join(whole)):
            node: Any = config
            for part in path[:-1]:
                node = node[part]
            node[path[-1]] = written


def holds(text: str, path: Sequence[str]) -> bool:
    """Tell whether a file has a key; one that is not YAML has none."""
    try:
        node = yaml.compose(text, Loader=get_yaml_loader())
    except yaml.YAMLError:
        return False
    for part in path:
        if not isinstance(node, yaml.MappingNode) or part not in (held := entries(node)):
            return False
        node = held[part]
    return True


@lru_cache(maxsize=256)
def unread(text: str) -> list[tuple[tuple[str, ...], str]]:
    """Where YAML reads a number or a truth value in a file, and how it is written there."""
    return [*plain_scalars(yaml.compose(text, Loader=get_yaml_loader()))]


def entries(mapping: yaml.MappingNode) -> dict[str, yaml.Node]:
    """What a mapping holds: its own entries, and those of the mappings that it merges with `<<`."""
    merged = [value for key, value in mapping.value if key.tag == MERGE]
    sources = [source for value in merged for source in (value.value if value.id == "sequence" else [value])]
    held = {name: node for source in reversed(sources) for name, node in entries(source).items()}
    own = {key.value: value for key, value in mapping.value if key.id == "scalar" and key.tag != MERGE}
    return held | own


def plain_scalars(node: yaml.Node | None, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], str]]:
    """Path and words of every number and truth value without quotes under a node, lists left out."""
    if isinstance(node, yaml.MappingNode):
        for key, value in entries(node).items():
            yield from plain_scalars(value, (*path, key))
    elif isinstance(node, yaml.ScalarNode) and node.style is None and node.tag in LOSSY_TAGS:
        yield path, node.value
