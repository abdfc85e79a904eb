"""All that is imported of hydra._internal, in one place: pyproject.toml bounds Hydra's version for its sake.

tests/cli/test_hydra_internals.py says of each what breaks where Hydra has changed it.
"""

from __future__ import annotations

import traceback
from collections.abc import Iterator, Sequence

import hydra._internal.defaults_list as defaults
import hydra._internal.hydra as engine
from hydra._internal.callbacks import Callbacks
from hydra._internal.config_loader_impl import ConfigLoaderImpl, get_overrides_dirname
from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra._internal.core_plugins.file_config_source import FileConfigSource
from hydra._internal.sources_registry import SourcesRegistry
from hydra._internal.utils import create_config_search_path, get_args_parser
from hydra.core.plugins import Plugins
from hydra.plugins.sweeper import Sweeper

__all__ = [
    "SEARCH_TARGET",
    "BasicSweeper",
    "Callbacks",
    "ConfigLoaderImpl",
    "FileConfigSource",
    "create_config_search_path",
    "defaults_on_the_way",
    "get_args_parser",
    "get_overrides_dirname",
    "use_callbacks",
    "use_file_source",
    "use_loader",
    "use_sweeper",
    "validate_no_batch",
]
SEARCH_TARGET = "hydra_plugins.romgrl.OptunaSweeper"


def use_loader(loader: type[ConfigLoaderImpl]) -> None:
    """Have Hydra load every configuration through a class. It makes its loader by this name, and asks nobody."""
    engine.ConfigLoaderImpl = loader  # type: ignore[attr-defined]  # a name that it imports but does not export


def use_callbacks(callbacks: type[Callbacks]) -> None:
    """Have Hydra call its callbacks through a class, made by this name likewise."""
    engine.Callbacks = callbacks  # type: ignore[attr-defined]  # the same


def use_file_source(source: type[FileConfigSource]) -> None:
    """Have Hydra read YAML files through a class, which launchers find by the name of Hydra's own."""
    Plugins.instance()  # finds Hydra's own first
    SourcesRegistry.instance().types["file"] = source


def use_sweeper(sweeper: type[Sweeper]) -> None:
    """Have Hydra make this sweeper for SEARCH_TARGET, as a plugin by a name that it knows."""
    Plugins.instance().class_name_to_class[SEARCH_TARGET] = sweeper


def validate_no_batch() -> None:
    """Have sweepers not compose every job before they launch the first: each was composed and checked before.

    On their base class: Hydra runs the modules of its plugins again to find them, which leaves a subclass without a
    base, and no option turns the composing off.
    """
    Sweeper.validate_batch_is_legal = leave_batch  # type: ignore[assignment, method-assign]  # a method replaced


def leave_batch(sweeper: Sweeper, batch: Sequence[Sequence[str]]) -> None:
    """Do nothing about a batch."""


def defaults_on_the_way(error: Exception) -> Iterator[str]:
    """Yield the name of every file whose defaults Hydra was reading when it raised this, the outermost first."""
    for frame, _ in traceback.walk_tb(error.__traceback__):
        if frame.f_code is defaults._create_defaults_tree_impl.__code__ and "path" in frame.f_locals:
            yield frame.f_locals["path"]
