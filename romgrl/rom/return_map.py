"""The stride of the reduced-order model as a return map, from one passing of the legs to the next.

The section is where the left foot passes the right one forwards: in the middle of a stance in running and walking, away
from touchdown and take-off. The policy acts at a fixed rate that is no multiple of the stride's, so that the share of a
control step that has passed at the section differs from stride to stride. The worlds are therefore stepped by single
substeps, each with its own clock, its action held in between, which is the motion of the vector environment bit for
bit; the crossing is interpolated within a substep. Feet that move together do not pass each other: the section of a
hop is the top of its flight.

A state on the section has as coordinates the trunk (x and the last touchdown's x, both relative to the foot; y;
velocities; pitch if it is free), the feet (y, velocities), and of each leg the motor's torque, the shortening and the
last touchdown angle, with motors in the legs the extension, its rate and the drive, too, and the time since the last
touchdown. The clock and the action that is held go with the world and are no coordinates.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import count

import numpy as np
from gymnasium.spaces import flatdim
from numpy.typing import NDArray

from romgrl.rom import _core
from romgrl.rom.parameters import Commands, SpringLegParameters, VariableLegParameters
from romgrl.rom.vector_env import SpringLegVectorEnv

Array = NDArray[np.float64]
Policy = Callable[[NDArray[np.float32]], NDArray[np.float32]]

GRAVITY = 9.81
LONGEST_STRIDE = 3.0  # s
TRUNK = {"trunk_x": 0, "trunk_y": 1, "trunk_vx": 3, "trunk_vy": 4}
FEET_APART = "right_foot_x"  # from the left one: what a section at the top of the flight has in the place of trunk_vy
PITCH = {"pitch": 2, "pitch_rate": 5}
ORIGIN, TOUCHDOWN_X, LEFT_SLOT = 19, 20, 18
FOOT = {"y": 1, "vx": 3, "vy": 4}  # from the first column of a foot: 6 or 12
LEG = {"torque": 0, "shortening": 1, "touchdown_angle": 2}  # from the first column of a leg: cpp/rom/world_state.hpp
MOTOR = {"extension": 4, "extension_rate": 5, "drive": 6}
AGE = {"touchdown_age": 23}
SIDES = ("left", "right")


@dataclass
class Walkers:
    """Worlds (B, S) as `SpringLegVectorEnv.save` has them, substeps since the last action (B,), that action (B, A)."""

    states: Array
    elapsed: NDArray[np.int64]
    action: NDArray[np.float32]

    def take(self, others: Walkers, chosen: NDArray[np.bool_]) -> None:
        """Replace the chosen rows (B,) by those of `others`."""
        for own, other in ((self.states, others.states), (self.elapsed, others.elapsed), (self.action, others.action)):
            own[chosen] = other[chosen]

    def tiled(self, times: int) -> Walkers:
        """`times` copies one after the other."""
        return Walkers(np.tile(self.states, (times, 1)), np.tile(self.elapsed, times), np.tile(self.action, (times, 1)))

    def rows(self, chosen: NDArray[np.bool_]) -> Walkers:
        """The chosen ones."""
        return Walkers(self.states[chosen], self.elapsed[chosen], self.action[chosen])


@dataclass(frozen=True)
class Crossing:
    """Where B worlds cross the section: coordinates (B, n), nan where one fell or stood; contact (B, 2) of the feet.

    walkers: the worlds at the end of that substep; time (B,) s since the start.
    """

    coordinates: Array
    walkers: Walkers
    contact: NDArray[np.bool_]
    time: Array


class StrideMap:
    """Strides of a policy's worlds at `speed`, acting `control_frequency` times per second."""

    def __init__(
        self,
        policy: Policy,
        parameters: SpringLegParameters,
        *,
        speed: float | Commands,
        control_frequency: float,
        threads: int = 1,
        top: bool = False,
    ) -> None:
        """top: the section is the top of the flight, not the passing of the legs."""
        self.policy, self.speed, self.threads, self.top = policy, speed, threads, top
        self.substeps = parameters.substeps
        self.parameters = replace(parameters, substeps=1)
        self.frequency = control_frequency * self.substeps
        self.trunk = {name: column for name, column in TRUNK.items() if not (top and name == "trunk_vy")}
        self.names = (
            *self.trunk,
            *(() if parameters.trunk_locked else PITCH),
            "touchdown_x",
            *((FEET_APART,) if top else ()),
        )
        self.names += tuple(f"{side}_foot_{name}" for side in SIDES for name in FOOT)
        motors = isinstance(parameters, VariableLegParameters)
        self.leg, self.clock = LEG | (MOTOR if motors else {}), AGE if motors else {}
        if parameters.retraction == 0:  # what is shortened stays so, a multiplier of one that says nothing
            self.leg = {name: column for name, column in self.leg.items() if name != "shortening"}
        self.names += tuple(f"{side}_{name}" for side in SIDES for name in self.leg)
        self.names += tuple(self.clock)

    @property
    def scales(self) -> Array:
        """Unit of each coordinate (n,): leg length, sqrt(g L0), sqrt(g / L0), largest torque, rad."""
        length, torque = self.parameters.leg_length, self.parameters.hip_torque
        speed = np.sqrt(GRAVITY * length)
        endings = {"extension_rate": speed, "shortening": length, "extension": length, "torque": torque}
        endings |= {
            "_age": length / speed,
            "_x": length,
            "_y": length,
            "_vx": speed,
            "_vy": speed,
            "_rate": speed / length,
        }
        return np.array([next((v for end, v in endings.items() if name.endswith(end)), 1.0) for name in self.names])

    @property
    def stroke(self) -> tuple[float, ...]:
        """The ends of what the legs' motors can extend them by, m; none without motors."""
        if not isinstance(self.parameters, VariableLegParameters):
            return ()
        ends = self.parameters.shortest_rest, self.parameters.longest_rest
        return tuple((end - 1.0) * self.parameters.leg_length for end in ends)

    def settled(self, worlds: int, *, strides: int, seed: int) -> Crossing:
        """`worlds` random starts after `strides` strides."""
        env = self._worlds(worlds)
        env.reset(seed=seed)
        states, actions = env.save(), flatdim(env.single_action_space)
        env.close()
        start = Walkers(states, np.full(worlds, self.substeps), np.zeros((worlds, actions), np.float32))
        return self.walk(start, strides=strides)

    def walk(self, start: Walkers, *, strides: int = 1) -> Crossing:
        """Let all go on until they have crossed the section `strides` times."""
        worlds = len(start.states)
        now, end = start.tiled(1), start.tiled(1)
        env = self._worlds(worlds)
        now.states[:, _core.WALKER_SIZE : _core.WALKER_SIZE + now.action.shape[1]] = now.action
        observation, _ = env.restore(now.states)
        place, gap = self._motion(now.states)
        coordinates = np.full((worlds, len(self.names)), np.nan)
        contact, time = np.zeros((worlds, 2), bool), np.full(worlds, np.nan)
        passed, last, alive = np.zeros(worlds, int), np.zeros(worlds, int), np.ones(worlds, bool)
        for step in count():
            due = now.elapsed >= self.substeps
            if due.any():
                now.action[due] = self.policy(observation[due])
                now.elapsed[due] = 0
            observation, _, terminated, _, info = env.step(now.action)
            now.states = env.save()
            place_after, gap_after = self._motion(now.states)
            alive &= ~terminated & (step - last < LONGEST_STRIDE * self.frequency)
            crossed = alive & (gap < 0) & (gap_after >= 0)
            passed += crossed
            last[crossed] = step
            there = crossed & (passed == strides)
            share = gap[there] / (gap - gap_after)[there]
            between = place[there] + share[:, None] * (place_after - place)[there]
            coordinates[there] = between
            now.elapsed += 1
            end.take(now, there)
            contact[there], time[there] = info["contact"][there], (step + share) / self.frequency
            if (~alive | (passed >= strides)).all():
                break
            place, gap = place_after, gap_after
        env.close()
        return Crossing(coordinates, end, contact, time)

    def disturbed(self, walkers: Walkers, offsets: Array) -> Walkers:
        """The same worlds with their coordinates moved by `offsets` (B, n)."""
        states, named = walkers.states.copy(), dict(zip(self.names, offsets.T, strict=True))
        for name, column in {**self.trunk, **PITCH}.items():
            states[:, column] += named.get(name, 0.0) * (-1 if name in PITCH else 1)  # saved counter-clockwise
        states[:, TOUCHDOWN_X] += named["touchdown_x"]
        for name, column in self.clock.items():
            states[:, column] = np.maximum(states[:, column] + named[name], 0.0)
        rows = np.arange(len(states))
        if self.top:
            states[rows, _foot(states, 1)] += named[FEET_APART]
        for side, name in enumerate(SIDES):
            for ending, column in FOOT.items():
                states[rows, _foot(states, side) + column] += named[f"{name}_foot_{ending}"]
            for ending, column in self.leg.items():
                states[:, _core.FIRST_LEG + _core.LEG_SIZE * side + column] += named[f"{name}_{ending}"]
        return Walkers(states, walkers.elapsed, walkers.action)

    def _motion(self, states: Array) -> tuple[Array, Array]:
        """Coordinates (B, n), and what rises through zero on the section (B,): the left foot's lead, or the fall."""
        rows = np.arange(len(states))
        left, right = (_foot(states, side) for side in range(2))
        feet = [states[rows, first + column] for first in (left, right) for column in FOOT.values()]
        first = (_core.FIRST_LEG, _core.FIRST_LEG + _core.LEG_SIZE)
        legs = [states[:, start + column] for start in first for column in self.leg.values()]
        trunk = [states[:, column] for column in self.trunk.values()]
        trunk[0] = trunk[0] - states[rows, left]
        pitch = [] if self.parameters.trunk_locked else [-states[:, column] for column in PITCH.values()]
        touchdown = states[:, TOUCHDOWN_X] - states[:, ORIGIN] - states[rows, left]
        gap = states[rows, left] - states[rows, right]
        apart = [-gap] if self.top else []
        passed = -states[:, TRUNK["trunk_vy"]] if self.top else gap
        clock = [states[:, column] for column in self.clock.values()]
        return np.stack([*trunk, *pitch, touchdown, *apart, *feet, *legs, *clock], axis=1), passed

    def _worlds(self, number: int) -> SpringLegVectorEnv:
        return SpringLegVectorEnv(
            parameters=self.parameters,
            num_envs=number,
            speed=self.speed,
            control_frequency=self.frequency,
            episode_steps=10**9,
            num_threads=self.threads,
        )


def _foot(states: Array, side: int) -> NDArray[np.int64]:
    """First column of the left (0) or right (1) foot of each world."""
    slot = states[:, LEFT_SLOT].astype(np.int64)
    return np.asarray(6 + 6 * (slot if side == 0 else 1 - slot))


RETURN_MAPS = {"spring_leg": StrideMap, "variable_leg": StrideMap}
"""By `rom.model`; one that is missing here has no Floquet multipliers."""
