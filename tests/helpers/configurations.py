"""A configuration with one value changed, and the keys of all stages."""

from __future__ import annotations

from dataclasses import replace

from romgrl.config.schema import Config
from romgrl.config.values import value_of
from romgrl.provenance.stage_graph import STAGES
from romgrl.provenance.stage_keys import stage_key


def with_value(config: Config, key: str, value: object) -> Config:
    """A copy of the configuration with another value at a dotted key."""
    group, _, leaf = key.rpartition(".")
    return replace(config, **{group: replace(value_of(config, group), **{leaf: value})} if group else {leaf: value})


def all_keys(config: Config) -> dict[str, str]:
    """The key of every stage, with the keys of the stages that it reads in the place of their digests."""
    found: dict[str, str] = {}
    for name, stage in STAGES.items():
        found[name] = stage_key(name, config, {upstream: found[upstream] for upstream in stage.upstream})
    return found
