"""Speed of physics and learners on this machine, beside their peers: `python -m benchmarks [NAME ...]`."""

import os

import romgrl.humanoid  # noqa: F401 - MuJoCo, whatever MUJOCO_GL says

USERS_ENVIRONMENT = dict(os.environ)
"""What the peers are started with."""

os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # as the project's own stages do, before torch is imported
