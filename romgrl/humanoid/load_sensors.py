"""Sensors of what joints and feet bear, which `romgrl.humanoid.loads` reads and nobody else."""

from __future__ import annotations

import mujoco

from romgrl.humanoid.skeleton import Skeleton

STOP, CONTACT = "stop_", "contact_"
_FIELDS = (
    mujoco.mjtConDataField.mjCONDATA_FOUND,
    mujoco.mjtConDataField.mjCONDATA_FORCE,
    mujoco.mjtConDataField.mjCONDATA_LINVEL,
)
SLOTS, WIDTH = 8, 7  # contacts of a foot, and numbers of each: found, force (3), velocity (3)
_LARGEST_FIRST = 2  # the sensor's reduction "maxforce"


def add_sensors(spec: mujoco.MjSpec, skeleton: Skeleton) -> None:
    """Sensors of the stops and of the feet, which are switched off until `replay` reads them.

    A foot is the ankle's body and all that hangs from it, and only contact with the ground counts.
    """
    for joint in skeleton.hinges:
        spec.add_sensor(
            name=STOP + joint,
            type=mujoco.mjtSensor.mjSENS_JOINTLIMITFRC,
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
            objname=joint,
        )
    data = sum(1 << field.value for field in _FIELDS)
    for ankle in (skeleton.left.ankle, skeleton.right.ankle):
        spec.add_sensor(
            name=CONTACT + ankle,
            type=mujoco.mjtSensor.mjSENS_CONTACT,
            objtype=mujoco.mjtObj.mjOBJ_XBODY,
            objname=ankle,
            reftype=mujoco.mjtObj.mjOBJ_BODY,
            refname="world",
            intprm=[data, _LARGEST_FIRST, SLOTS],
        )
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_SENSOR.value
