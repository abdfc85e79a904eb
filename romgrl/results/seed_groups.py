"""Seeds that chose the settings, and held-out ones, which no choice has seen: what a result is to be read from."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TypeVar

CHOSEN_SEEDS = range(5)  # looked at when settings were chosen; every other seed is held out
HELD_OUT, CHOSEN = "held out", "chose the settings"

Item = TypeVar("Item")


def group_of(seed: int) -> str:
    """Tell whether a seed is held out or chose the settings."""
    return CHOSEN if seed in CHOSEN_SEEDS else HELD_OUT


def by_group(items: Iterable[Item], seed_of: Callable[[Item], int | None]) -> dict[str, list[Item]]:
    """Items by the group of their seed, held-out ones first; an item without a seed is in none, named ''."""
    groups: dict[str, list[Item]] = {HELD_OUT: [], CHOSEN: [], "": []}
    for item in items:
        seed = seed_of(item)
        groups["" if seed is None else group_of(seed)].append(item)
    return {name: members for name, members in groups.items() if members}


def held_out_or_all(items: Iterable[Item], seed_of: Callable[[Item], int | None]) -> list[Item]:
    """The held-out ones alone, where there are any; all of them otherwise."""
    groups = by_group(items, seed_of)
    return groups[HELD_OUT] if HELD_OUT in groups else [item for members in groups.values() for item in members]


def seeds_told(seeds: Sequence[int]) -> str:
    """`seeds 5, 6 (held out)`, `seed 0 (chose the settings)`, or both."""
    texts = []
    for name, members in by_group(sorted(set(seeds)), lambda seed: seed).items():
        texts.append(f"seed{'s' if len(members) > 1 else ''} {', '.join(map(str, members))} ({name})")
    return " and ".join(texts)
