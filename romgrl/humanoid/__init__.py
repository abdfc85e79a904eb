"""The planar humanoid: model, observation, task, environments and pictures."""

from romgrl.humanoid.opengl import import_mujoco

import_mujoco()  # before any module here does
