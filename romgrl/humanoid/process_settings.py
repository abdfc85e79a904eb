"""Settings of MuJoCo in this process."""

from __future__ import annotations

import ctypes

import mujoco

from romgrl.humanoid import _core

_NO_TIME = ctypes.CFUNCTYPE(ctypes.c_double)(_core.NO_TIME)


def set_up_mujoco() -> None:
    """No log and no timers.

    Environments count diverged simulations, which MuJoCo would log (MUJOCO_LOG.TXT, console). Its profile, which nobody
    reads, would take a twentieth of the physics for reading the clock (measured).
    """
    config = mujoco.MjLogConfig.get()
    config.logto_file = config.logto_console = False
    mujoco.MjLogConfig.set(config)
    mujoco.set_mjcb_time(_NO_TIME)
