"""Paths of a composed configuration from the root on, as seen from where the command was started.

No later change of the working directory moves them, and ~ is expanded once, here. A file that is not there may lie
beside the presets of its group.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Any

from omegaconf import DictConfig, ListConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from romgrl.config.addresses import absolute, absolute_address

PATHS = (
    "paths.outputs",
    "humanoid.xml",
    "teacher.cycles",
    "library.others",
    "evaluation.specialists",
    "hydra.run.dir",
    "hydra.sweep.dir",
    "hydra.sweeper.storage",
)
ADDRESSES = ("tracking.uri",)
BESIDE_PRESETS = ("humanoid.xml",)  # files that a preset may bring


def make_whole(config: DictConfig) -> None:
    """Rewrite every path in a configuration that Hydra has just composed, in place."""
    for key in (*PATHS, *ADDRESSES):
        group, _, leaf = key.rpartition(".")
        try:
            node: Any = OmegaConf.select(config, group)
        except OmegaConfBaseException:  # whoever reads the key says what is wrong with it
            continue
        for holder, place in written_at(node, leaf):
            text = holder._get_node(place)._value()
            if isinstance(text, str) and text.isprintable() and text.strip() and not text.startswith("???"):
                rewritten = absolute_address(text) if key in ADDRESSES else whole_path(text, holder, place)
                if key in BESIDE_PRESETS and not os.path.exists(rewritten):  # which knows of names that are too long
                    rewritten = next(beside_presets(config, group, text), rewritten)
                if rewritten != text:
                    holder[place] = rewritten


def written_at(node: Any, leaf: str) -> Iterator[tuple[Any, Any]]:
    """Yield where the value of a key stands: its group and name, or its list and each place in it."""
    written = node._get_node(leaf) if isinstance(node, DictConfig) and leaf in [*node] else None
    if isinstance(written, ListConfig) and isinstance(written._value(), list):
        yield from ((written, place) for place in range(len(written)))
    elif written is not None:
        yield node, leaf


def beside_presets(config: DictConfig, group: str, text: str) -> Iterator[str]:
    """Yield the files of that name in the directories that presets of the group come from."""
    for source in config.hydra.runtime.config_sources:
        if source.schema == "file" and os.path.isfile(f"{source.path}/{group}/{text}"):
            yield absolute(f"{source.path}/{group}/{text}")


def whole_path(text: str, node: Any, leaf: Any) -> str:
    """A path from the root on; one that starts with an interpolation keeps it: jobs resolve it anew."""
    if not text.startswith("${"):
        return absolute(text)
    try:
        value = str(node[leaf])
    except OmegaConfBaseException:
        return text
    return text if os.path.isabs(value) else absolute(value) if value.startswith("~") else f"{os.getcwd()}/{text}"
