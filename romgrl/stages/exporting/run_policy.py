"""Run a walker that romgrl exported: python run_policy.py --seconds 10

Reads policy.onnx, policy.json and model.xml beside this file, where follow_commands.py is if the policy is asked for a
speed and a gait (--speed 2), and needs numpy, onnxruntime and mujoco. At every control step it observes the body, asks
for the controls of all actuators, and holds them. World: x forward, y left, z up; SI units, angles in radians.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

INSTALL = "pip install numpy mujoco onnxruntime"
try:
    import mujoco
    import numpy as np
    from numpy.typing import NDArray
except ImportError as missing:
    if __name__ != "__main__":
        raise
    sys.exit(f"{' '.join(str(missing).split())}; needed: {INSTALL}")

Vector = NDArray[np.float64]
Description = dict[str, Any]  # what policy.json says

FORMAT_READ = 1
EXIT_CODES = "exit code: 0 after a walk, fallen or not; 1: file or package missing, broken; 2: bad option; 130: Ctrl-C"


class BadFileError(Exception):
    """A file of an export that is missing, broken, or of another export."""

    def __init__(self, path: Path, wrong: object) -> None:
        super().__init__(f"{path}: {' '.join(str(wrong).split())}; needed: the files of one export, side by side")


class OnnxPolicy:
    """policy.onnx: observation (O,), and `command` (C,), C may be 0, -> controls (A,) in the unit of each actuator."""

    def __init__(self, path: Path) -> None:
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1  # of so small a network more are slower
        options.log_severity_level = 4  # what is wrong is raised, too
        self.session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
        self.columns = {each.name: each.shape[-1] for each in self.session.get_inputs()}
        self.command = np.zeros(self.columns.get("command", 0), np.float32)

    def __call__(self, observation: NDArray[np.float32]) -> Vector:
        values = {"observation": observation[None], "command": self.command[None]}
        (control,) = self.session.run(["control"], {name: values[name] for name in self.columns})
        return np.asarray(control[0], np.float64)


class Walker:
    """The body in MuJoCo, as policy.json describes it; it stands where an episode begins."""

    def __init__(self, model: mujoco.MjModel, description: Description) -> None:
        self.model, self.data, self.description = model, mujoco.MjData(model), description
        body = description["body"]
        self.bodies = np.array([model.body(name).id for name in body["names"]])
        self.root, self.neck, self.head = (model.body(body[name]).id for name in ("root", "neck", "head"))
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
        """What the policy sees (O,): the columns of `observation` in policy.json.

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
        return np.concatenate([position[0, 2:], (vectors @ heading.T).ravel()]).astype(np.float32)

    def has_fallen(self) -> bool:
        """Root or head too low, trunk leaning too far, or a simulation that warns."""
        limits, place = self.description["fall"], self.data.xpos
        forward, _, up = place[self.neck] - place[self.root]
        low = place[self.root, 2] < limits["root_height"] or place[self.head, 2] < limits["head_height"]
        low = low or any(warning.number for warning in self.data.warning)
        return bool(low or abs(np.arctan2(forward, up)) > limits["trunk_lean"])


def walk(walker: Walker, policy: Callable[[NDArray[np.float32]], Vector], steps: int) -> Iterator[float]:
    """The closed loop: yield the forward position in m after each of `steps` control steps, up to a fall."""
    for _ in range(steps):
        walker.step(policy(walker.observe()))
        yield float(walker.data.qpos[0])
        if walker.has_fallen():
            return


def report(positions: list[float], rate: float, speed: float, *, end: str) -> str:
    """How long it walked, and how fast over the second half of that; positions in m, rate in Hz, speed in m/s."""
    seconds, half = len(positions) / rate, len(positions) // 2
    held = (positions[-1] - positions[half]) * rate / max(1, len(positions) - 1 - half)
    return f"{seconds:.1f} s, {end}; {held:.2f} m/s over the second half (asked for: {speed:.2f} m/s)"


def in_viewer(walker: Walker, positions: Iterator[float]) -> Iterator[float]:
    """The same positions, at the pace of the clock, in MuJoCo's viewer, which ends them; RuntimeError: none opens."""
    import glfw
    import mujoco.viewer

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if not glfw.init():  # without a display MuJoCo would end the process
            raise RuntimeError("--viewer: no display that opens")
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


def is_finite_number(value: Any) -> bool:
    """Finite, and of a size that physics has."""
    return type(value) in (int, float) and -1e9 < value < 1e9


def is_list(value: Any, of: Callable[[Any], bool]) -> bool:
    """A list that is not empty, all of one kind."""
    return isinstance(value, list) and bool(value) and all(of(each) for each in value)


KINDS_OF_VALUES: dict[str, Callable[[Any], bool]] = {
    "a number": is_finite_number,
    "a number above 0": lambda value: is_finite_number(value) and value > 0,
    "a whole number above 0": lambda value: type(value) is int and 0 < value < 10**6,
    "0, 1 or 2": lambda value: type(value) is int and 0 <= value <= 2,
    "a name": lambda value: isinstance(value, str),
    "names": lambda value: is_list(value, lambda name: isinstance(name, str)),
    "numbers": lambda value: is_list(value, is_finite_number),
    "sections": lambda value: is_list(value, lambda entry: isinstance(entry, dict)),
    "two numbers": lambda value: is_list(value, is_finite_number) and len(value) == 2,
    "ranges": lambda value: isinstance(value, dict) and is_list([*value.values()], KINDS_OF_VALUES["two numbers"]),
}
VALUES_READ = {
    "a number": "fall.root_height fall.head_height fall.trunk_lean",
    "a number above 0": "control.rate",
    "a whole number above 0": "control.substeps",
    "0, 1 or 2": "body.forward_axis",
    "a name": "body.root body.neck body.head",
    "names": "body.names",
    "numbers": "start.qpos start.qvel",
    "sections": "observation actions",
}
ONE_SPEED_READ = {"a number": "target_speed.value"}
COMMAND_READ = {"a number": "command.begin.speed command.begin.style", "a name": "command.begin.gait"}
COMMAND_READ |= {"two numbers": "command.style", "ranges": "command.gaits", "sections": "command.columns"}
"""What is read of policy.json, by its kind: the paths to it; of a policy that follows commands, and of any other."""


def read_description(path: Path) -> Description:
    """The content of policy.json. Raises BadFileError for one that is no export's."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise BadFileError(path, error) from error
    if not isinstance(content, dict) or content.get("format") != FORMAT_READ:
        raise BadFileError(path, f"not the description of an export of format {FORMAT_READ}")
    read = [*VALUES_READ.items(), *(COMMAND_READ if "command" in content else ONE_SPEED_READ).items()]
    for name, kind in ((name, kind) for kind, names in read for name in names.split()):
        value: Any = content
        for part in name.split("."):
            value = value.get(part) if isinstance(value, dict) else None
        if not KINDS_OF_VALUES[kind](value):
            raise BadFileError(path, f"{name} is {json.dumps(value)[:40]}, not {kind}")
    return content


def read_walker_of(path: Path, description: Description) -> Walker:
    """The body of model.xml. Raises BadFileError for a model other than the one that is described."""
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except (ValueError, mujoco.FatalError) as error:
        raise BadFileError(path, error) from error
    told = {**description["start"], "actuators": description["actions"]}
    for name, found in {"qpos": model.nq, "qvel": model.nv, "actuators": model.nu}.items():
        if found != len(told[name]):
            raise BadFileError(path, f"{found} {name}, not {len(told[name])} as policy.json says")
    control = description["control"]
    if abs(control["rate"] * control["substeps"] * model.opt.timestep - 1.0) > 1e-6:
        raise BadFileError(path, f"a timestep of {model.opt.timestep:g} s, not that of policy.json's control")
    try:
        return Walker(model, description)
    except KeyError as error:  # MuJoCo's: a name of no body
        raise BadFileError(path, error.args[0]) from error


def read_policy_of(path: Path, walker: Walker) -> OnnxPolicy:
    """The graph of policy.onnx. Raises BadFileError for that of another walker, ImportError without onnxruntime."""
    seen = walker.observe()
    try:
        policy = OnnxPolicy(path)
        wanted, told = policy.columns["observation"], len(walker.description["observation"])
        if wanted != len(seen) or told != len(seen):
            raise ValueError(f"takes {wanted} columns; policy.json has {told}, the body {len(seen)}")
        commands = len(walker.description.get("command", {"columns": []})["columns"])
        if len(policy.command) != commands:
            raise ValueError(f"takes {len(policy.command)} columns of a command; policy.json has {commands}")
        control = policy(seen)
        if control.shape != (walker.model.nu,):
            raise ValueError(f"gives {control.size} controls; model.xml has {walker.model.nu} actuators")
    except ImportError:
        raise
    except Exception as error:  # onnxruntime's exceptions have no base of their own
        raise BadFileError(path, error) from error
    return policy


def load(directory: Path) -> tuple[Walker, OnnxPolicy]:
    """What the files of an export describe. Raises BadFileError, or ImportError without onnxruntime."""
    for name in ("policy.json", "policy.onnx", "model.xml"):
        if not (directory / name).is_file():
            raise BadFileError(directory / name, "no such file")
    description = read_description(directory / "policy.json")
    follows = (directory / "follow_commands.py").is_file()
    if follows != ("command" in description):
        raise BadFileError(directory / "follow_commands.py", "of another export" if follows else "no such file")
    walker = read_walker_of(directory / "model.xml", description)
    return walker, read_policy_of(directory / "policy.onnx", walker)


def main() -> None:
    """Walk, and print how that went."""
    here, sys.dont_write_bytecode = Path(__file__).resolve().parent, True  # an artifact has no other files
    follows = import_module("follow_commands") if (here / "follow_commands.py").is_file() else None
    parser = argparse.ArgumentParser(description="Run the policy beside this file in MuJoCo.", epilog=EXIT_CODES)
    parser.add_argument("--seconds", type=float, default=10.0, help="length of the walk (default: 10)")
    parser.add_argument("--viewer", action="store_true", help="show it in MuJoCo's viewer (on macOS: run by mjpython)")
    if follows is not None:
        follows.add_options(parser)
    options = parser.parse_args()
    if not 0.1 <= options.seconds <= 1e6:
        parser.error(f"--seconds: {options.seconds} is not allowed; allowed: 0.1 to 1e6")
    mujoco.set_mju_user_warning(lambda text: None)  # or it writes MUJOCO_LOG.TXT; has_fallen sees what it warns of
    walked, end = list[float](), "interrupted"
    try:
        walker, policy = load(here)
        rate = walker.description["control"]["rate"]
        acting, asked = policy, [walker.description.get("target_speed", {}).get("value")]
        if follows is not None:
            acting, asked = follows.follow_options(policy, walker.description, parser)
        positions = walk(walker, acting, max(1, round(options.seconds * rate)))
        for position in in_viewer(walker, positions) if options.viewer else positions:
            walked.append(position)
        end = "then it fell" if walker.has_fallen() else "no fall"
    except (BadFileError, ImportError, RuntimeError) as error:
        told = " ".join(str(error).split())
        sys.exit(f"{told}; needed: {INSTALL}" if isinstance(error, ImportError) else told)
    except KeyboardInterrupt:
        pass
    if walked:
        print(report(walked, rate, float(np.mean(asked[len(asked) // 2 :])), end=end))
    sys.exit(130 if end == "interrupted" else 0)


if __name__ == "__main__":
    main()
