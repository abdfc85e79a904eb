"""Watch a walker: in MuJoCo's viewer where there is a display, as a film where there is none.

In the viewer keys ask one that follows commands for other speeds and gaits; it begins with `speed`.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import closing
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from romgrl.config.commanded import is_conditioned
from romgrl.config.schema import Config
from romgrl.humanoid.rendering import RenderingError, SideCamera
from romgrl.humanoid.skeleton import skeleton_of
from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv
from romgrl.report.encoder import FilmError, write_film
from romgrl.runtime import signals
from romgrl.runtime.stage_log import StageLog
from romgrl.stages.conditioned.asked_at_first import first_command, read_command_limits
from romgrl.stages.conditioned.command_keys import PressedKeys, keys_shown
from romgrl.stages.wiring.humanoid import humanoid_env
from romgrl.stages.wiring.seeds import WATCH_SEED
from romgrl.stages.wiring.walker_policy import read_walker

NO_DISPLAY = "no display"


def run(config: Config, inputs: Mapping[str, Path], output: Path, log: StageLog) -> None:
    """Play the policy of `watch.walker`, whose directory is in `inputs`, or write `output`/<walker>.mp4.

    With a conditioned student the library that taught it is in `inputs`, too.
    """
    directory, keys = inputs[config.watch.walker], None
    if is_conditioned(config):
        limits = read_command_limits(inputs["library"], config)
        keys = PressedKeys(limits, first_command(limits, config))
        log.message(f"asked for: {keys.text}")
    with closing(humanoid_env(config, num_envs=1, commands=keys)) as env:
        reason = no_viewer()
        if reason is None:
            told = "" if keys is None else f"; keys: {', '.join(' '.join(each) for each in keys_shown(keys.limits))}"
            log.message(f"playing in MuJoCo's viewer; its window ends it{told}")
            play(env, directory, config.seed, keys)
        else:
            film(env, directory, output / f"{config.watch.walker}.mp4", config, log, reason)


def no_viewer() -> str | None:
    """Why no window can be opened here; None where one can."""
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        return NO_DISPLAY
    import glfw

    return None if glfw.init() else f"{NO_DISPLAY} that opens"


def walk_on(
    env: PlanarHumanoidVectorEnv, directory: Path, seed: int, keys: PressedKeys | None = None
) -> Iterator[tuple[NDArray[np.float64], bool]]:
    """Yield the state before each step, and whether the walker fell in the last; a newer policy takes over at once.

    keys: of commands, which the walker is asked for from the next step on.
    """
    path = directory / "policy.safetensors"
    written, policy = path.stat().st_mtime, read_walker(directory, env)
    observation, _ = env.reset(seed=seed + WATCH_SEED)
    fell = False
    while True:
        yield env.states()[0].astype(np.float64), fell
        if path.exists() and path.stat().st_mtime > written:
            written, policy = path.stat().st_mtime, read_walker(directory, env)
        if keys is not None and keys.take():
            observation, _ = env.reset()
        observation, _, terminated, _, _ = env.step(policy(observation).astype(np.float32))
        fell = bool(terminated[0])


def play(env: PlanarHumanoidVectorEnv, directory: Path, seed: int, keys: PressedKeys | None = None) -> None:
    """Show a walk at its own pace until the window is closed; what `keys` ask for stands over it."""
    import mujoco
    import mujoco.viewer

    model = env.model
    data, shown = mujoco.MjData(model), ""
    options = {} if keys is None else {"key_callback": keys.press}
    with mujoco.viewer.launch_passive(model, data, show_left_ui=False, show_right_ui=False, **options) as window:
        window.cam.type = mujoco.mjtCamera.mjCAMERA_TRACKING
        window.cam.trackbodyid = model.body(skeleton_of(model).root).id
        window.cam.azimuth, window.cam.elevation, window.cam.distance = 90.0, -10.0, 4.0
        for state, _ in walk_on(env, directory, seed, keys):
            due = time.monotonic() + env.control_step
            data.qpos[:] = state[: model.nq]
            mujoco.mj_forward(model, data)
            if keys is not None and keys.text != shown:
                shown = keys.text
                window.set_texts(overlay(keys))
            window.sync()
            signals.raise_pending()
            if not window.is_running():
                return
            time.sleep(max(0.0, due - time.monotonic()))


def overlay(keys: PressedKeys) -> tuple[None, None, str, str]:
    """What stands over the picture: the command, and the keys that change it."""
    lines = [("asked for", keys.text), *keys_shown(keys.limits)]
    left, right = ("\n".join(column) for column in zip(*lines, strict=True))
    return None, None, left, right


def film(env: PlanarHumanoidVectorEnv, directory: Path, path: Path, config: Config, log: StageLog, reason: str) -> None:
    """Film a walk of `watch.seconds`, or up to its fall. Raises RenderingError or FilmError: nothing can be watched."""
    states: list[NDArray[np.float64]] = []
    for state, fell in walk_on(env, directory, config.seed):
        if fell or len(states) >= round(config.watch.seconds / env.control_step):
            break
        states.append(state)
    ended = "" if len(states) * env.control_step >= config.watch.seconds - env.control_step else ", then it falls"
    try:
        with SideCamera(env.model) as camera:
            if camera.remark:
                log.message(camera.remark)
            write_film(path, map(camera.frame, states), env.control_step)
    except (RenderingError, FilmError) as error:
        raise type(error)(f"{reason}, and no film: {error}") from error
    log.message(f"{reason}; {len(states) * env.control_step:.1f} s are filmed{ended}: {path}")
