"""Run a walker that romgrl exported: python run_policy.py --seconds 10

Reads policy.onnx, policy.json and model.xml beside this file, and needs numpy, onnxruntime and mujoco, nothing else. At
every control step it observes the body, asks the policy for the controls of all actuators, and holds them for the
physics steps up to the next one. World: x forward, y left, z up; SI units, angles in radians.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Description = dict[str, Any]  # what policy.json says


class OnnxPolicy:
    """policy.onnx: observation (O,) -> controls (A,) of the actuators, in the unit of each."""

    def __init__(self, path: Path) -> None:
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1  # of so small a network more are slower
        self.session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])

    def __call__(self, observation: NDArray[np.float32]) -> Vector:
        (control,) = self.session.run(["control"], {"observation": observation[None]})
        return np.asarray(control[0], np.float64)


class Walker:
    """The body in MuJoCo, as policy.json describes it; it stands where an episode begins."""

    def __init__(self, model: mujoco.MjModel, description: Description) -> None:
        self.model, self.data, self.description = model, mujoco.MjData(model), description
        body = description["body"]
        self.bodies = np.array([model.body(name).id for name in body["names"]])
        self.root, self.neck, self.head = (model.body(body[name]).id for name in ("root", "neck", "head"))
        self.commands = np.array([command["value"] for command in description["commands"]], np.float64)
        self.place(*(np.array(description["start"][name]) for name in ("qpos", "qvel")))

    def place(self, qpos: Vector, qvel: Vector) -> None:
        """Begin in a state: qpos (nq,) and qvel (nv,)."""
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:], self.data.qvel[:] = qpos, qvel
        self.look()

    def step(self, control: Vector) -> None:
        """Hold controls (A,) for one control step."""
        self.data.ctrl[:] = control
        mujoco.mj_step(self.model, self.data, nstep=self.description["control"]["substeps"])
        self.look()

    def look(self) -> None:
        """Bring positions and velocities of all bodies up to the state; mj_step leaves those of the step before."""
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_comVel(self.model, self.data)

    def observe(self) -> NDArray[np.float32]:
        """What the policy sees (O,): the columns of `observation` in policy.json, then its commands.

        Height of the root; then of all bodies position relative to it, images of the local x and z axes, velocity and
        angular velocity, seen from a frame that is turned about the vertical to where the root faces.
        """
        data, body = self.data, self.description["body"]
        position, rotation = data.xpos[self.bodies], data.xmat[self.bodies].reshape(-1, 3, 3)
        spin, velocity = np.split(data.cvel[self.bodies], 2, axis=1)  # of the point at the centre of mass
        origins = velocity + np.cross(spin, position - data.subtree_com[self.root])
        axes = rotation[:, :, (0, 2)].swapaxes(1, 2).reshape(-1, 3)
        vectors = np.concatenate([position[1:] - position[0], axes, origins, spin])
        facing = rotation[0, :2, body["forward_axis"]]
        cosine, sine = facing / np.linalg.norm(facing)
        heading = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        seen = np.concatenate([position[0, 2:], (vectors @ heading.T).ravel(), self.commands])
        return seen.astype(np.float32)

    def has_fallen(self) -> bool:
        """Root or head too low, trunk leaning too far, or a simulation that warns."""
        limits, place = self.description["fall"], self.data.xpos
        forward, _, up = place[self.neck] - place[self.root]
        low = place[self.root, 2] < limits["root_height"] or place[self.head, 2] < limits["head_height"]
        warned = any(warning.number for warning in self.data.warning)
        return bool(low or abs(np.arctan2(forward, up)) > limits["trunk_lean"] or warned)


def walk(walker: Walker, policy: OnnxPolicy, steps: int) -> Iterator[float]:
    """The closed loop: yield the forward position in m after each of `steps` control steps, up to a fall."""
    for _ in range(steps):
        walker.step(policy(walker.observe()))
        yield float(walker.data.qpos[0])
        if walker.has_fallen():
            return


def report(positions: list[float], rate: float, speed: float, *, fell: bool) -> str:
    """How long it walked, and how fast over the second half of that; positions in m, rate in Hz, speed in m/s."""
    seconds, half = len(positions) / rate, len(positions) // 2
    held = (positions[-1] - positions[half]) * rate / max(1, len(positions) - 1 - half)
    end = "then it fell" if fell else "no fall"
    return f"{seconds:.1f} s, {end}; {held:.2f} m/s over the second half (asked for: {speed:.2f} m/s)"


def in_viewer(walker: Walker, positions: Iterator[float]) -> Iterator[float]:
    """The same positions, at the pace of the clock beside MuJoCo's viewer; its window ends them."""
    import mujoco.viewer

    with mujoco.viewer.launch_passive(walker.model, walker.data) as window:
        window.cam.type, window.cam.trackbodyid = mujoco.mjtCamera.mjCAMERA_TRACKING, walker.root
        window.cam.azimuth, window.cam.elevation, window.cam.distance = 90.0, -10.0, 4.0
        due = time.monotonic()
        for position in positions:
            yield position
            window.sync()
            if not window.is_running():
                return
            due += 1.0 / walker.description["control"]["rate"]
            time.sleep(max(0.0, due - time.monotonic()))


def load(directory: Path) -> tuple[Walker, OnnxPolicy]:
    """What the files of an export describe. Raises FileNotFoundError for one that is not there."""
    for name in ("policy.json", "policy.onnx", "model.xml"):
        if not (directory / name).is_file():
            raise FileNotFoundError(f"{directory / name}: no such file; needed: the files of one export, side by side")
    description = json.loads((directory / "policy.json").read_text(encoding="utf-8"))
    model = mujoco.MjModel.from_xml_path(str(directory / "model.xml"))
    return Walker(model, description), OnnxPolicy(directory / "policy.onnx")


def main() -> None:
    """Walk, and print how that went."""
    parser = argparse.ArgumentParser(description="Run the policy beside this file in MuJoCo.")
    parser.add_argument("--seconds", type=float, default=10.0, help="length of the walk (default: 10)")
    parser.add_argument("--viewer", action="store_true", help="show it in MuJoCo's viewer")
    options = parser.parse_args()
    if not 0.1 <= options.seconds <= 1e6:
        parser.error(f"--seconds: {options.seconds} is not allowed; allowed: 0.1 to 1e6")
    try:
        walker, policy = load(Path(__file__).resolve().parent)
    except (FileNotFoundError, ImportError) as error:
        sys.exit(str(error))
    rate = walker.description["control"]["rate"]
    positions = walk(walker, policy, round(options.seconds * rate))
    walked = [*(in_viewer(walker, positions) if options.viewer else positions)]
    if walked:
        speed = walker.description["target_speed"]["value"]
        print(report(walked, rate, speed, fell=walker.has_fallen()))


if __name__ == "__main__":
    main()
