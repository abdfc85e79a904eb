"""Keys of the two bodies: the reduced-order model and the humanoid."""

from __future__ import annotations

from dataclasses import dataclass

from romgrl.config.fields import key

ROMS: dict[str, type[Rom]] = {}
"""The keys of each reduced-order model; romgrl.rom.registry has the models."""
SKELETONS = ("smpl",)  # of romgrl/humanoid/skeleton.py; the first is that of the project's own humanoid


@dataclass
class Rom:
    """Reduced-order model: what every one has. None = taken from the humanoid."""

    name: str = key("what it is called; not given: as its preset")
    model: str = key("its mechanics; not given: spring_leg", choices=ROMS.keys())
    mass: float | None = key("total mass, feet included; null: the humanoid's", unit="kg", low=0.01, high=1e6)
    leg_length: float | None = key(
        "rest length from hip to foot centre; null: the humanoid's pelvis to ankle", unit="m", low=0.05, high=2
    )
    foot_radius: float | None = key(
        "radius of the foot circle; null: the humanoid's ankle height", unit="m", low=0.001, high=1
    )


@dataclass
class SpringLeg(Rom):
    """Reduced-order model: a trunk on two spring legs (paper section 3.2). None = taken from the humanoid."""

    foot_mass: float = key("mass of each foot", unit="kg", low=1e-4, high=1e5)
    roll_over_radius: float = key(
        "radius of the arc that a foot rolls on, rigid with the leg: at least foot_radius; 0: a circle of foot_radius "
        "that sticks or slides and does not roll",
        unit="m",
        low=0,
        high=2,
        before=0,
    )
    stiffness: float = key("leg spring", unit="N/m", low=0.001, high=1e9)
    stance_damping: float = key("leg damping while loaded", unit="N s/m", low=0, high=1e7)
    swing_damping: float = key("leg damping while unloaded", unit="N s/m", low=0, high=1e7)
    hip_torque: float = key("hip torque at action 1", unit="N m", above=0, high=1e5)
    torque_lag: float = key("time constant of the hip motors; 0: none", unit="s", low=0, high=100)
    trunk_moment_limit: float | None = key("largest net hip moment of the trunk; null: no limit", unit="N m", above=0)
    retraction: float = key("shortening of a leg in early swing, share of leg_length; 0: none", low=0, high=0.4)
    retraction_time: float = key("duration of retraction and extension", unit="s", low=1e-6, high=100)
    hip_angle_limit: float = key("hip stops at +- this angle", unit="rad", low=0.01, high=1.57)
    compression_limit: float = key("shortest leg, share of leg_length", low=0.05, high=1)
    extension_limit: float = key("longest leg, share of leg_length", low=1, high=2)
    friction: float = key("ground friction coefficient", low=0, high=100)
    trunk_locked: bool = key("true: the trunk cannot rotate (4 degrees of freedom)")
    trunk_inertia: float = key("moment of inertia of a free trunk", unit="kg m^2", low=1e-4, high=1e6)
    trunk_pitch_limit: float = key("a free trunk falls beyond this pitch", unit="rad", low=0.01, high=10)
    fall_height: float = key("an episode ends below this body height, share of leg_length", above=0, high=1)
    substeps: int = key("physics steps per control step", low=1, high=10_000)
    engine: str = key("box2d: the library; native: the same equations for many worlds", choices=("box2d", "native"))
    velocity_iterations: int = key("velocity iterations of the solver", low=1, high=1000)
    position_iterations: int = key("position iterations of the solver", low=1, high=1000)
    reset_hip_angle: list[float] = key(
        "range of the anti-phase hip angle at reset", unit="rad", low=0, high=1.57, span=True
    )
    reset_speed: list[float] = key(
        "range of the forward speed at reset, share of the target speed", low=-10, high=10, span=True
    )
    observation: str = key("full: 20 entries; paper: the 13 that the paper lists", choices=("full", "paper"))


ROMS["spring_leg"] = SpringLeg


@dataclass
class VariableLeg(SpringLeg):
    """The same with a motor in series with the spring of each leg, which moves the end of its rest length."""

    motor_force: float = key("force of a leg's motor at rest, action 1", unit="N", low=0.001, high=1e6)
    motor_speed: float = key("speed at which it has no force left", unit="m/s", low=0.001, high=100)
    motor_power: float = key("largest power of a leg's motor", unit="W", low=0.001, high=1e7)
    motor_eccentric: float = key("its largest force where it is overpowered, share of motor_force", low=1, high=10)
    motor_eccentric_speed: float = key("speed of yielding at which it has that force", unit="m/s", low=0.001, high=100)
    motor_mass: float = key("mass that the motor moves, as felt along the leg", unit="kg", low=0.001, high=1e9)
    motor_damping: float = key("friction of the motor", unit="N s/m", low=0, high=1e6)
    motor_lag: float = key("time constant of the motor; 0: none", unit="s", low=0, high=100)
    shortest_rest: float = key("shortest rest length, share of leg_length", low=0.05, high=1)
    longest_rest: float = key("longest rest length, share of leg_length", low=1, high=1.5)
    reset_together: bool = key(
        "true: both feet touch down at a reset, ahead of the hip; false: one of them, the other one is as far behind",
        before=False,
    )
    reset_by_speed: bool = key(
        "true: reset_hip_angle is that at a speed of sqrt(g leg_length), at others it is in proportion to the speed",
        before=False,
    )
    reset_drop: list[float] = key(
        "range of the height that the trunk has fallen by at a reset", unit="m", low=0, high=2, span=True, before=[0, 0]
    )


ROMS["variable_leg"] = VariableLeg


@dataclass
class Humanoid:
    """Planar humanoid in MuJoCo (paper section 4.1.2)."""

    name: str = key("what it is called; not given: as its preset")
    xml: str | None = key("MuJoCo file to hold in the sagittal plane; null: the project's own humanoid")
    skeleton: str = key("names and tree of the bodies in the file", choices=SKELETONS)
    actuation: str = key("servo: position servos; torque: joint torques", choices=("servo", "torque"))
    height: float = key("body height of the project's own humanoid", unit="m", low=1.2, high=2.2)
    mass: float = key("body mass of the project's own humanoid", unit="kg", low=30, high=150)
    control_frequency: float = key("control steps per second", unit="Hz", low=1, high=10_000)
    substeps: int = key("physics steps per control step", low=1, high=10_000)
    episode_steps: int = key("an episode is truncated after this many control steps", low=2, high=10**9)
    reset_speed: list[float] = key(
        "range of the forward speed at reset, share of the target speed", low=0, high=10, span=True
    )
    fall_pelvis_height: float = key(
        "it falls when the pelvis is below this share of its standing height", low=0, high=1
    )
    fall_head_height: float = key("it falls when the head is below this share of its standing height", low=0, high=1)
    fall_trunk_lean: float = key("it falls beyond this lean of the pelvis-neck line", unit="rad", above=0, high=10)
