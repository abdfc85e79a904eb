"""What an episode's steps do not report, at the rate of the physics: joint power, stops, contact and sliding of feet.

Read from sensors of a copy of the model, in recorded states under recorded actions.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass, fields

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from romgrl.humanoid.load_sensors import CONTACT, SLOTS, STOP, WIDTH
from romgrl.humanoid.skeleton import skeleton_of
from romgrl.humanoid.task import controls

Flags = NDArray[np.bool_]

LOADED = 0.1
"""A foot counts as loaded from this share of the body weight on."""
SLIDES = 0.3
"""A loaded foot slides where the contact that bears most moves faster over the ground, m/s."""
_ROWS = 4096  # states replayed together


@dataclass(frozen=True)
class Loads:
    """Of T control steps of S substeps each; the joints' stops count with the actuators."""

    power: NDArray[np.float64]
    """(T,) W: sum over the joints of |torque x angular velocity|, mean over the substeps."""
    positive_power: NDArray[np.float64]
    """(T,) W: the part of it where torque and angular velocity have the same sign."""
    stop_share: NDArray[np.float64]
    """(T,): largest torque of a joint's stop as a share of its actuator's largest torque."""
    touching: Flags
    """(T, S, 2): left and right foot touch the ground, with what is welded to them."""
    loaded: Flags
    """(T, S, 2): the foot bears more than LOADED of the body weight."""
    sliding: Flags
    """(T, S, 2): it is loaded, and slides."""
    ankle_stop: Flags
    """(T, S, 2): the ankle of that foot lies on a stop."""

    @property
    def contact(self) -> Flags:
        """(T, 2): the feet touch the ground in the last substep."""
        return self.touching[..., -1, :]

    @classmethod
    def empty(cls, *shape: int, substeps: int) -> Loads:
        """All zero, for steps of `shape`."""
        power, positive_power, stop_share = np.zeros((3, *shape))
        touching, loaded, sliding, ankle_stop = np.zeros((4, *shape, substeps, 2), np.bool_)
        return cls(power, positive_power, stop_share, touching, loaded, sliding, ankle_stop)

    def arrays(self) -> dict[str, NDArray[np.float64] | Flags]:
        """By name."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def put(self, where: tuple[int, slice] | slice, other: Loads) -> None:
        """Write those of `other` to the place of these."""
        for name, values in other.arrays().items():
            getattr(self, name)[where] = values


def replay(
    model: mujoco.MjModel,
    states: NDArray[np.floating],
    actions: NDArray[np.floating],
    substeps: int,
    *,
    num_threads: int = 1,
) -> Loads:
    """Repeat control steps, each from its own recorded state, so that no error builds up.

    states (T, nq + nv) before each step, actions (T, A) in [-1, 1].
    """
    measured = copy.copy(model)
    measured.opt.disableflags &= ~mujoco.mjtDisableBit.mjDSBL_SENSOR.value
    loads = Loads.empty(len(states), substeps=substeps)
    for start in range(0, len(states), _ROWS):
        rows = slice(start, min(start + _ROWS, len(states)))
        loads.put(rows, _replay_together(measured, states[rows], actions[rows], substeps, num_threads))
    return loads


def _replay_together(
    model: mujoco.MjModel, states: NDArray[np.floating], actions: NDArray[np.floating], substeps: int, num_threads: int
) -> Loads:
    loads, batch = Loads.empty(len(states), substeps=substeps), Batch(model, len(states), num_threads)
    qpos, qvel, sensors = batch.bind("qpos"), batch.bind("qvel"), batch.bind("sensordata")
    actuators = batch.bind("qfrc_actuator")
    qpos[:], qvel[:] = states[:, : model.nq], states[:, model.nq :]
    batch.bind("ctrl")[:] = controls(model, actions)
    skeleton = skeleton_of(model)
    joints = [model.joint(name).dofadr[0] for name in skeleton.hinges]
    strongest = np.abs(model.actuator_forcerange).max(axis=1)
    strongest = np.where(strongest > 0, strongest, np.inf)  # an actuator without limits
    stops = [model.sensor(STOP + name).adr[0] for name in skeleton.hinges]
    ankle_names = skeleton.left.ankle, skeleton.right.ankle
    ankles = [skeleton.hinges.index(name) for name in ankle_names]
    feet = [slice(start := model.sensor(CONTACT + name).adr[0], start + SLOTS * WIDTH) for name in ankle_names]
    weight = float(model.body_mass.sum() * np.linalg.norm(model.opt.gravity))
    for substep in range(substeps):
        before = qvel[:, joints].copy()
        batch.step()
        velocity = 0.5 * (before + qvel[:, joints])  # of the substep in which sensors' and actuators' torques act
        stop = sensors[:, stops]
        # A stop pushes back into the range: its force is positive at the lower end, and the sensor gives its size.
        beyond = qpos[:, joints] > model.jnt_range[model.dof_jntid[joints]].mean(axis=1)
        work = np.stack((actuators[:, joints], np.where(beyond, -stop, stop))) * velocity
        loads.power[:] += np.abs(work).sum(axis=(0, 2)) / substeps
        loads.positive_power[:] += work.clip(min=0).sum(axis=(0, 2)) / substeps
        np.maximum(loads.stop_share, (np.abs(stop) / strongest).max(axis=1), out=loads.stop_share)
        loads.ankle_stop[:, substep] = stop[:, ankles] != 0
        for foot, columns in enumerate(feet):
            contacts = sensors[:, columns].reshape(len(states), SLOTS, WIDTH)
            found, force = contacts[..., 0] > 0, np.abs(contacts[..., 1])
            slip = np.linalg.norm(contacts[..., 5:], axis=-1)  # in the contact's plane
            most = force.argmax(axis=1)
            loads.touching[:, substep, foot] = found.any(axis=1)
            loads.loaded[:, substep, foot] = force.sum(axis=1) > LOADED * weight
            loads.sliding[:, substep, foot] = slip[np.arange(len(slip)), most] > SLIDES
    np.logical_and(loads.sliding, loads.loaded, out=loads.sliding)
    return loads
