"""Speed of physics and learners on this machine, beside their peers: `python -m benchmarks [NAME ...]`."""

import os

from romgrl.humanoid.opengl import import_mujoco

import_mujoco()  # before any row does, whatever MUJOCO_GL says

USERS_ENVIRONMENT = dict(os.environ)
"""What the peers are started with."""

os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # as the project's own stages do, before torch is imported
