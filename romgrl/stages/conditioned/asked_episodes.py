"""Episodes of a walker under commands that are known beforehand: many groups in one environment, block by block."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from romgrl.artifacts import load_arrays, save_arrays
from romgrl.config.schema import Config
from romgrl.errors import ArtifactError
from romgrl.gait.features import Floats, Gait, gait_from_rollouts
from romgrl.gait.recording import Policy
from romgrl.humanoid.command_schedules import CommandTable
from romgrl.stages.rollouts.humanoid import roll_out_all
from romgrl.stages.wiring.humanoid import humanoid_env
from romgrl.stages.wiring.seeds import EVALUATION_SEED

Arrays = dict[str, NDArray[Any]]
TableRow = dict[str, Any]
MOST_STEPS = 2**17
"""Control steps of all episodes of a block, of some 1 kB each; a block has one group at least."""
KEPT_OF_EPISODE = ("features", "velocity", "contact")


@dataclass(frozen=True)
class Asked:
    """What all episodes of a group are asked for: speeds (K,), m/s, and weights of the gaits (K, G) from times (K,), s,
    on, or straight from each to the next one."""

    times: tuple[float, ...]
    speeds: tuple[float, ...]
    weights: tuple[tuple[float, ...], ...]
    ramp: bool = False

    def at(self, seconds: Floats) -> Floats:
        """Commands (T, 2 + G) at times (T,)."""
        style = np.ones((len(seconds), 1))
        if self.ramp:
            columns = [
                np.interp(seconds, self.times, values) for values in (self.speeds, *zip(*self.weights, strict=True))
            ]
            return np.concatenate((np.stack(columns, axis=1), style), axis=1)
        row = np.searchsorted(self.times, seconds + 1e-9, side="right") - 1
        return np.concatenate((np.array(self.speeds)[row, None], np.array(self.weights)[row], style), axis=1)


class Walked(NamedTuple):
    """The episodes of a group: their gait, with loads, and states (E, T, nq + nv) before each step."""

    gait: Gait
    states: NDArray[np.float64]

    def longest(self) -> Arrays:
        """Of the first episode without a fall, or else the longest: states, KEPT_OF_EPISODE and valid, by name.

        What follows a fall is zero, the states there are those at the fall.
        """
        valid = self.gait.valid
        row = int(valid.sum(axis=1).argmax())
        there = valid[row]
        last = max(0, int(there.sum()) - 1)
        found: Arrays = {"states": np.where(there[:, None], self.states[row], self.states[row, last]), "valid": there}
        for name in KEPT_OF_EPISODE:
            values = getattr(self.gait, name)[row]
            found[name] = np.where(there.reshape(-1, *(1,) * (values.ndim - 1)), values, np.zeros_like(values))
        return found


@dataclass(frozen=True)
class Walker:
    """A policy in the environment of a configuration, asked for gaits; `body`: its model; `tick` hears of steps."""

    config: Config
    policy: Policy
    gaits: Sequence[str]
    body: mujoco.MjModel
    tick: Callable[[int], None]

    def block(self, block: Sequence[Asked], episodes: int, steps: int, part: int, number: int = 0) -> list[Walked]:
        """Groups that walk `episodes` times each; all have the same times, and all ramp or none.

        `part` and `number` of the block set its resets apart from those of others; those of all walkers are the same.
        """
        env = humanoid_env(
            self.config,
            num_envs=len(block) * episodes,
            episode_steps=steps + 1,
            body=self.body,
            commands=command_table(self.gaits, block, episodes),
        )
        before = [0]

        def progress(step: int) -> None:
            self.tick((step - before[0]) * env.num_envs)
            before[0] = step

        arrays, states = roll_out_all(
            env, self.policy, steps=steps, seed=block_seed(self.config.seed, part, number), progress=progress
        )
        env.close()
        found = []
        for first in range(0, env.num_envs, episodes):
            rows = slice(first, first + episodes)
            own = {f"walker_{name}": values[rows] for name, values in arrays.items()}
            gait = gait_from_rollouts(own | {"dt": np.array(env.control_step)}, "walker")
            found.append(Walked(gait, states[rows]))
        return found


def blocks(groups: Sequence[Asked], steps: int) -> list[Sequence[Asked]]:
    """Groups of so many steps each, as many together as MOST_STEPS permits."""
    size = max(1, MOST_STEPS // steps)
    return [groups[first : first + size] for first in range(0, len(groups), size)]


def command_table(gaits: Sequence[str], groups: Sequence[Asked], episodes: int) -> CommandTable:
    """The commands of groups of so many episodes each, in their order."""
    speeds = np.repeat(np.array([group.speeds for group in groups]).T, episodes, axis=1)
    weights = np.repeat(np.array([group.weights for group in groups]).transpose(1, 0, 2), episodes, axis=1)
    return CommandTable(gaits, groups[0].times, speeds, weights, ramp=groups[0].ramp)


def block_seed(seed: int, part: int, number: int) -> int:
    """Of a block of a part of the evaluation: of its own seeds, which no training and no check draws from."""
    return int(np.random.SeedSequence((seed + EVALUATION_SEED, part, number)).generate_state(1)[0])


def made_once(path: Path, make: Callable[[], tuple[Any, Arrays]]) -> tuple[Any, Arrays]:
    """What is in a file of `made_once`, or else what is made now, numbers and arrays, and written there first.

    An interrupted evaluation goes on with the same bits: what is read is what is used. A file that was made under
    another name is made anew.
    """
    found: Arrays | None = None
    if path.is_file():
        with suppress(ArtifactError):
            found = load_arrays(path)
    if found is None or str(found.get("made_as")) != path.name:
        numbers, arrays = make()
        told = {"numbers": np.array(json.dumps(numbers)), "made_as": np.array(path.name)}
        save_arrays(path, arrays | told)
        found = load_arrays(path)
    del found["made_as"]
    return json.loads(str(found.pop("numbers"))), found
