"""A command line up to what Hydra composes of it."""

from __future__ import annotations

from romgrl.cli.arguments import read_options
from romgrl.cli.compose import register_schema
from romgrl.cli.hydra_loader import Loader

HEAD = "defaults:\n  - config\n  - _self_\n"


def composed(*arguments: str) -> Loader:
    """What loads a command line that has no faults."""
    register_schema()
    options, lines = read_options(arguments)
    assert options is not None, lines
    return Loader(options)
