"""A checkpoint is whole or it is not used: damage is named and set aside, and the one before it is there."""

from __future__ import annotations

import os
import random
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

from romgrl.artifacts import checkpoint
from romgrl.artifacts.checkpoint import Checkpoints
from tests.helpers.cut_trainings import digest

ROWS = 8


class CountingRing:
    """Row i holds i."""

    def __init__(self, added: int = 0) -> None:
        self.rows, self.added = ROWS, added
        self.values = torch.zeros(ROWS)
        self.write_rows(max(0, added - ROWS), {"value": torch.arange(max(0, added - ROWS), added).float()})

    def read_rows(self, first: int, last: int) -> dict[str, Tensor]:
        return {"value": self.values[torch.arange(first, last) % ROWS]}

    def write_rows(self, first: int, columns: Mapping[str, Tensor]) -> None:
        values = columns["value"]
        self.values[torch.arange(first, first + len(values)) % ROWS] = values


def state(step: int) -> dict[str, Any]:
    """Something of every kind."""
    generator = {"name": "PCG64", "state": 2**127 + step, "half": None}
    return {"learner": {"weights": torch.full((3,), float(step)), "done": step, "generator": generator}, "due": 0.1}


def saved(directory: Path, steps: list[int]) -> list[str]:
    """Checkpoints of a ring to which 3 rows are added before each."""
    said: list[str] = []
    ring = CountingRing()
    checkpoints = Checkpoints(directory, ring=ring, say=said.append)
    for number, step in enumerate(steps, 1):
        fresh = CountingRing(3 * number)
        ring.added, ring.values = fresh.added, fresh.values
        checkpoints.save(step, state(step))
    return said


def loaded(directory: Path) -> tuple[int, str, list[float], list[str]]:
    """Step, digest of the state, rows of the ring and what was said."""
    said: list[str] = []
    ring = CountingRing()
    found = Checkpoints(directory, ring=ring, say=said.append).load()
    assert found is not None
    return found[0], digest(found[1]), sorted(ring.values.tolist()), said


def test_what_was_saved_comes_back_while_the_ring_wraps(tmp_path: Path) -> None:
    for count in range(1, 8):
        directory = tmp_path / f"{count}"
        saved(directory, list(range(10, 10 * count + 1, 10)))
        step, found, rows, said = loaded(directory)
        assert (step, found, said) == (10 * count, digest(state(10 * count)), [])
        assert rows[-min(3 * count, ROWS) :] == [float(row) for row in range(max(0, 3 * count - ROWS), 3 * count)]
        files = [path.name for path in directory.iterdir()]
        assert sum(name.endswith(".json") for name in files) == min(count, 2)
        assert sum(name.startswith("rows-") for name in files) <= 4  # none that two checkpoints do not need


def test_damage_is_found_and_the_checkpoint_before_it_is_used(tmp_path: Path) -> None:
    """Every file of the newest checkpoint cut short, with a flipped bit, or gone."""
    generator, found, total = random.Random(0), 0, 0
    for kind in ("cut", "flip", "gone"):
        for name in ("20.json", "20.safetensors", "rows-3-6.safetensors"):
            directory = tmp_path / f"{kind}-{name}"
            saved(directory, [10, 20])
            damage(directory / name, kind, generator)
            step, bits, _, said = loaded(directory)
            total += 1
            if kind == "gone" and name == "20.json":  # then there is no newer one
                found += (step, bits, said) == (10, digest(state(10)), [])
                continue
            assert (directory / "20.json.damaged").exists()
            found += (step, bits) == (10, digest(state(10))) and "set aside as 20.json.damaged" in said[0]
            assert name in said[0]
    print(f"{found} of {total} damaged checkpoints named and replaced by the one before")
    assert found == total


def damage(path: Path, kind: str, generator: random.Random) -> None:
    content = bytearray(path.read_bytes())
    if kind == "gone":
        return path.unlink()
    if kind == "flip":
        content[-1 - generator.randrange(4)] ^= 1 << generator.randrange(8)  # the numbers are at the end
    return path.write_bytes(content if kind == "flip" else content[: generator.randrange(len(content))]) and None


def test_training_goes_on_after_damage(tmp_path: Path) -> None:
    """A save after a load from the older checkpoint makes a whole one again."""
    saved(tmp_path, [10, 20])
    (tmp_path / "20.safetensors").unlink()
    ring = CountingRing()
    checkpoints = Checkpoints(tmp_path, ring=ring, say=print)
    assert checkpoints.load() is not None
    ring.added, ring.values = 5, CountingRing(5).values
    checkpoints.save(20, state(20))
    assert loaded(tmp_path)[:2] == (20, digest(state(20)))


def test_the_new_checkpoint_is_on_the_disk_before_an_old_one_goes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its name, too: a power cut then leaves one of them."""
    calls: list[str] = []
    forget = Checkpoints._forget
    monkeypatch.setattr(checkpoint, "sync_path", lambda path: calls.append(f"sync {len(list(path.glob('*.json')))}"))
    monkeypatch.setattr(Checkpoints, "_forget", lambda self: (calls.append("forget"), forget(self)))
    saved(tmp_path, [10, 20, 30])
    assert calls == ["sync 1", "forget", "sync 2", "forget", "sync 3", "forget"]


class Killed(BaseException):
    """Nothing after this runs."""


def test_killed_at_every_call_of_a_save(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The end of the process before each write, fsync and rename: the old checkpoint or the new one."""
    outcomes: list[int] = []
    for call in range(100):
        directory = tmp_path / f"{call}"
        saved(directory, [10])
        ring, left = CountingRing(), [call]
        checkpoints = Checkpoints(directory, ring=ring, say=print)
        checkpoints.load()
        ring.added, ring.values = 6, CountingRing(6).values
        with monkeypatch.context() as patch:
            for owner, name in ((os, "fsync"), (os, "replace"), (Path, "replace"), (Path, "open"), (Path, "unlink")):
                patch.setattr(owner, name, dying(getattr(owner, name), left))
            try:
                checkpoints.save(20, state(20))
            except Killed:
                pass
            else:
                break
        step, bits, _, said = loaded(directory)
        assert (bits, said) == (digest(state(step)), [])
        outcomes.append(step)
    print(f"killed at {len(outcomes)} calls: old checkpoint {outcomes.count(10)}, new {outcomes.count(20)} times")
    assert set(outcomes) <= {10, 20}
    assert outcomes == sorted(outcomes)
    assert len(outcomes) >= 8


def dying(original: Any, left: list[int]) -> Any:
    def replacement(*arguments: Any, **named: Any) -> Any:
        left[0] -= 1
        if left[0] < 0:
            raise Killed
        return original(*arguments, **named)

    return replacement
