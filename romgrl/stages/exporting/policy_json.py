"""policy.json: what a policy sees and does, in which body, and what made it."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import onnx

import romgrl
from romgrl.artifacts import Manifest
from romgrl.config.schema import Config
from romgrl.humanoid.command_limits import AskedCommand, CommandLimits
from romgrl.humanoid.digest import physics_digest
from romgrl.humanoid.skeleton import skeleton_of
from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv
from romgrl.stages.wiring.seeds import WATCH_SEED

FORMAT_OF_EXPORT = 1
COLUMN_UNITS = {
    "height": "m",
    "position": "m",
    "axis_x": "1",
    "axis_z": "1",
    "velocity": "m/s",
    "angular_velocity": "rad/s",
}
"""Of what the second part of a column's name says."""

COMMAND = "command."
"""What the names of its columns begin with."""

Section = dict[str, Any]


def policy_description(config: Config, env: PlanarHumanoidVectorEnv, student: Manifest, asked: Section) -> Section:
    """The content of policy.json for an environment whose observation has all columns.

    asked: `target_speed`, or what `command_section` says of the commands that a policy follows.

    Whatever else the file of a `humanoid.xml` describes stays in that file: it may not be ours to pass on. Neither name
    nor bytes of that file decide the key of an export, so they are not in here, either.
    """
    skeleton, own = skeleton_of(env.model), config.humanoid.xml is None
    actions = [{"joint": joint} for joint in env.action_names]
    if own:
        actions = [entry | actuator(env.model, index) for index, entry in enumerate(actions)]
    return {
        "format": FORMAT_OF_EXPORT,
        "control": {
            "rate": config.humanoid.control_frequency,
            "substeps": env.substeps,
            "timestep": env.model.opt.timestep,
        },
        **asked,
        "observation": [
            {"name": name, "unit": COLUMN_UNITS[name.split(".")[1]]}
            for name in env.observation_names
            if not name.startswith(COMMAND)
        ],
        "actions": actions,
        "body": {
            "names": [*skeleton.bodies],
            "root": skeleton.root,
            "neck": skeleton.neck,
            "head": skeleton.head,
            "forward_axis": skeleton.axes[0],
        },
        "model": {"file": "model.xml"} if own else needed_model(env.model),
        **(states(config, env) if own else {}),
        "made_by": {
            "romgrl": romgrl.__version__,
            "student": {"key": student.key, "sha256": student.digest, "romgrl": student.versions.get("romgrl")},
            "mujoco": mujoco.__version__,
            "onnx": onnx.__version__,
        },
    }


def command_section(env: PlanarHumanoidVectorEnv, limits: CommandLimits, asked: AskedCommand) -> Section:
    """The second input of the graph: its columns, what may be asked for, and `asked` to begin with."""
    names = [name for name in env.observation_names if name.startswith(COMMAND)]
    units = ["m/s", *("1" for _ in names[1:])]
    return {
        "command": {
            "input": "command",
            "columns": [{"name": name, "unit": unit} for name, unit in zip(names, units, strict=True)],
            "gaits": {gait: [*ends] for gait, ends in limits.speeds.items()},
            "standing": {"speed": 0.0, "trained": limits.stands},
            "style": [*limits.styles],
            "begin": asked._asdict(),
        }
    }


def needed_model(model: mujoco.MjModel) -> Section:
    """Which model the policy is of, of which nothing is copied: by the digest that a stage's key has of it."""
    return {"file": None, "needed": {"compiled_sha256": physics_digest(model), "held_in_plane_by": "romgrl"}}


def states(config: Config, env: PlanarHumanoidVectorEnv) -> Section:
    """Where it begins, as in `stage=watch`, and in which postures it has fallen: m and rad."""
    env.reset(seed=config.seed + WATCH_SEED)
    qpos, qvel = np.split(env.states()[0], [env.model.nq])
    return {
        "start": {"qpos": qpos.tolist(), "qvel": qvel.tolist()},
        "fall": {
            "root_height": env.task.pelvis_height,
            "head_height": env.task.head_height,
            "trunk_lean": env.task.lean,
        },
    }


def actuator(model: mujoco.MjModel, index: int) -> Section:
    """An actuator, the joint that it moves, and the least and the largest control and torque: rad, N m and s.

    A servo's torque is kp (control - angle) - kd rate, a motor's kp control; both within the limits, and that of a
    `dc_servo` also below the line from its stall torque at rest to none at its no-load speed.
    """
    gain, bias = model.actuator_gainprm[index], model.actuator_biasprm[index]
    joint = int(model.actuator_trnid[index, 0])
    velocity, position = int(model.jnt_dofadr[joint]), int(model.jnt_qposadr[joint])
    kinds = {
        mujoco.mjtBias.mjBIAS_NONE: {"kind": "motor", "unit": "1", "kp": gain[0], "kd": 0.0},
        mujoco.mjtBias.mjBIAS_AFFINE: {"kind": "servo", "unit": "rad", "kp": gain[0], "kd": 0.0 - bias[2]},
        mujoco.mjtBias.mjBIAS_DCMOTOR: {"kind": "dc_servo", "unit": "rad", "kp": gain[4], "kd": 0.0},
    }
    described: Section = kinds[mujoco.mjtBias(int(model.actuator_biastype[index]))]
    if described["kind"] == "dc_servo":
        resistance, constant, voltage = gain[[0, 1, 7]]
        described |= {"stall_torque": constant / resistance * voltage, "no_load_speed": voltage / constant}
    ranges = {"control": model.actuator_ctrlrange[index], "torque": model.actuator_forcerange[index]}
    described |= {name: limits.tolist() for name, limits in ranges.items()}
    described |= {"default": model.qpos0[position], "joint_range": model.jnt_range[joint].tolist()}
    described |= {"joint_damping": model.dof_damping[velocity], "joint_armature": model.dof_armature[velocity]}
    return {name: float(value) if isinstance(value, np.floating) else value for name, value in described.items()}
