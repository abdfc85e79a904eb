from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

STATE_SIZE: int

class Parameters:
    mass: float
    leg_length: float
    foot_radius: float
    foot_mass: float
    stiffness: float
    stance_damping: float
    swing_damping: float
    hip_torque: float
    torque_lag: float
    trunk_moment_limit: float
    retraction: float
    retraction_time: float
    hip_angle_limit: float
    compression_limit: float
    extension_limit: float
    friction: float
    trunk_locked: bool
    trunk_pinned: bool
    trunk_inertia: float
    trunk_pitch_limit: float
    fall_height: float
    substeps: int
    velocity_iterations: int
    position_iterations: int
    gravity: float
    reset_hip_angle_low: float
    reset_hip_angle_high: float
    reset_speed_low: float
    reset_speed_high: float
    speed: float
    control_frequency: float
    episode_steps: int
    alpha: float
    reward_is_velocity: bool
    observation_is_paper: bool
    engine_is_native: bool
    def __init__(self) -> None: ...

class Pose:
    x: float
    y: float
    vx: float
    vy: float
    pitch: float
    pitch_rate: float
    hip_angle: Sequence[float]
    hip_rate: Sequence[float]
    leg_length: Sequence[float]
    leg_rate: Sequence[float]
    def __init__(self) -> None: ...

class Buffers:
    def __init__(self, batch: Batch, arrays: Mapping[str, NDArray[Any]]) -> None: ...

class Batch:
    def __init__(self, parameters: Parameters, num_worlds: int, num_threads: int) -> None: ...
    @property
    def num_worlds(self) -> int: ...
    @property
    def observation_size(self) -> int: ...
    def seed(self, seed: int) -> None: ...
    def reset(self) -> None: ...
    def step(self, actions: NDArray[np.float32], buffers: Buffers) -> None: ...
    def repeat(self, actions: NDArray[np.float32], buffers: Buffers, steps: int) -> None: ...
    def observe(
        self, observation: NDArray[np.float32], features: NDArray[np.float32], contact: NDArray[np.bool_]
    ) -> None: ...
    def place(self, world: int, pose: Pose) -> None: ...
    def save(self) -> NDArray[np.float64]: ...
    def restore(self, states: NDArray[np.float64]) -> None: ...
