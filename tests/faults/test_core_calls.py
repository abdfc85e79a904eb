"""Generated calls into the C++ core: each works or raises, the process lives, and refused calls change nothing.

`make test-sanitizers` runs it with AddressSanitizer and UndefinedBehaviorSanitizer.
"""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from romgrl.humanoid import _core as humanoid_core
from romgrl.humanoid.model import build
from romgrl.humanoid.planar_observer import planar_bodies
from romgrl.rom import _core
from tests.helpers.rom_worlds import Worlds

CALLS = 10_000
REFUSALS = (ValueError, TypeError, KeyError, OverflowError, IndexError, RuntimeError, MemoryError)
DTYPES = ("f4", "f8", "f2", ">f4", "i4", "i8", "u1", "?", "c8", "O", "U3", "S4", "M8[s]")
NUMBERS = (0.0, -0.0, 1.0, -1.0, math.nan, math.inf, -math.inf, 1e300, -1e300, 5e-324, 1e-40, 1e12, 2.0**31, 0.5)
INTEGERS = (0, 1, -1, 2, 3, 7, 64, 2**31 - 1, 2**31, -(2**31), 2**63, -(2**63), 2**64, 2**200)


@dataclass
class Generator:
    """Arguments of all kinds, the good one among them."""

    random: np.random.Generator

    def pick(self, choices: Any) -> Any:
        return choices[int(self.random.integers(len(choices)))]

    def array(self, rows: int, columns: int, dtype: str) -> Any:
        """The array that is wanted, or one of another shape, strides, dtype, alignment or flags, or none at all."""
        kind = int(self.random.integers(14))
        shape = (rows, columns) if columns else (rows,)
        good = self.random.normal(size=shape).astype(dtype)
        if kind == 0:
            return np.zeros(tuple(int(self.random.integers(0, 4)) for _ in range(int(self.random.integers(4)))), dtype)
        if kind == 1:
            return good.astype("f8").astype(self.pick(DTYPES))
        if kind == 2:
            return np.zeros((*shape[:-1], 2 * shape[-1]), dtype)[..., ::2]
        if kind == 3:
            return good[::-1]
        if kind == 4:
            return np.broadcast_to(good[:1], shape)
        if kind == 5:
            raw = np.zeros(good.nbytes + 1, np.uint8)[1:]
            return raw.view(dtype).reshape(shape)
        if kind == 6:
            good.flags.writeable = False
            return good
        if kind == 7:
            return self.pick((None, "text", 3, [[1.0]], {}, b"bytes", memoryview(b"1234")))
        if kind == 8 and good.size:
            good.flat[int(self.random.integers(good.size))] = self.pick(NUMBERS) if dtype.startswith("f") else 1
        if kind == 9 and columns:
            return np.asfortranarray(good)
        return good

    def whole(self) -> Any:
        return self.pick((*INTEGERS, 1.5, None, "3", True))

    def number(self) -> Any:
        return self.pick((*NUMBERS, None, "x", 3))


Calls = dict[str, Callable[[], Any]]


def rom_calls(make: Generator, worlds: Worlds, other: Worlds) -> Calls:
    """Every function of romgrl.rom._core, on a batch that goes on living."""
    batch, n = worlds.batch, worlds.batch.num_worlds
    size = batch.observation_size

    def buffers() -> _core.Buffers:
        arrays = dict(worlds.arrays)
        name = make.pick(list(arrays))
        good = arrays[name]
        arrays[name] = make.array(n, good.shape[1] if good.ndim == 2 else 0, good.dtype.str[1:].replace("b1", "?"))
        return _core.Buffers(make.pick((batch, batch, None)), arrays)

    def step() -> None:
        own = make.pick((worlds, worlds, worlds, other))
        batch.step(make.array(n, 2, "f4"), _core.Buffers(own.batch, own.arrays))

    def place() -> None:
        pose = _core.Pose()
        pose.leg_length = [0.8, 0.8]
        for name in ("x", "y", "vx", "vy", "pitch", "pitch_rate"):
            if make.random.random() < 0.4:
                setattr(pose, name, make.number())
        if make.random.random() < 0.4:
            setattr(pose, make.pick(("hip_angle", "hip_rate", "leg_length", "leg_rate")), [make.number(), 0.5])
        batch.place(make.whole(), pose)

    def restore() -> None:
        states = batch.save()
        if make.random.random() < 0.5:
            bits = states.view(np.uint64)
            flat = int(make.random.integers(bits.size))
            bits.flat[flat] ^= np.uint64(1) << np.uint64(make.random.integers(64))
        else:
            states = make.array(*states.shape, "f8")
        batch.restore(states)

    def parameters() -> None:
        values = _core.Parameters()
        names = [name for name in dir(values) if not name.startswith("_")]
        name = make.pick(names)
        setattr(values, name, make.whole() if isinstance(getattr(values, name), int) else make.number())
        small = Worlds(values, make.pick((1, 1, 2)))
        for _ in range(3):
            small.step(np.ones((small.batch.num_worlds, 2), np.float32))

    def batches() -> None:
        worlds_wanted, threads = make.pick((0, 1, -1, 2, 3, 2**31, None)), make.pick((0, 1, -1, 2, 5, 2**31, 2**70))
        _core.Batch(_core.Parameters(), worlds_wanted, threads).reset()

    return {
        "step": step,
        "repeat": lambda: batch.repeat(
            make.array(n, 2, "f4"), _core.Buffers(batch, worlds.arrays), make.pick((0, 1, 3, -1, -(2**31), 2**40, None))
        ),
        "buffers": buffers,
        "observe": lambda: batch.observe(make.array(n, size, "f4"), make.array(n, 5, "f4"), make.array(n, 2, "?")),
        "place": place,
        "restore": restore,
        "seed": lambda: batch.seed(make.whole()),
        "reset": batch.reset,
        "parameters": parameters,
        "batch": batches,
    }


def humanoid_calls(make: Generator) -> Calls:
    """Every function of romgrl.humanoid._core."""
    model = build()
    bodies = planar_bodies(model)
    tree: dict[str, Any] = {
        "parents": [-1, 0, 0],
        "joints": [2, 3, -1],
        "offsets": [[0.0, 0.0, 0.0]] * 3,
        "x_axes": [[1.0, 0.0, 0.0]] * 3,
        "z_axes": [[0.0, 0.0, 1.0]] * 3,
        "rest": [0.0] * 4,
        "left_ankle": 1,
        "right_ankle": 2,
        "neck": 1,
        "head": 2,
    }

    def observe() -> None:
        rows = make.pick((0, 1, 2, 5))
        columns = make.array(6, 0, "i4")
        if isinstance(columns, np.ndarray) and columns.dtype == np.int32 and columns.size and columns.flags.writeable:
            columns[0] = make.pick((0, 357, 358, -1, 2**31 - 1))
        arguments = [make.array(rows, model.nq, "f8"), make.array(rows, model.nv, "f8"), columns]
        bodies.observe(*arguments, make.array(rows, 6, "f4"), make.array(rows, humanoid_core.POSTURE_SIZE, "f8"))

    def construct() -> None:
        changed = dict(tree)
        name = make.pick(list(tree))
        changed[name] = make.pick(
            ([], [make.whole()] * 3, [make.number()] * 3, [[make.number()] * 3] * 3, [[0.0]] * 3, None, tree[name] * 2)
        )
        made = humanoid_core.PlanarBodies(**changed)
        made.observe(
            np.zeros((1, 4)),
            np.zeros((1, 4)),
            np.zeros(1, np.int32),
            np.zeros((1, 1), np.float32),
            np.zeros((1, humanoid_core.POSTURE_SIZE)),
        )

    return {"bodies.observe": observe, "bodies": construct}


@pytest.mark.parametrize("engine", ["box2d", "native"])
def test_generated_calls(engine: str) -> None:
    make = Generator(np.random.default_rng(0))
    values = _core.Parameters()
    values.engine_is_native = engine == "native"
    worlds, other = Worlds(values, 3, 2), Worlds(values, 5)
    worlds.batch.seed(0)
    worlds.batch.reset()
    calls = rom_calls(make, worlds, other) | humanoid_calls(make)
    names, outcomes = list(calls), Counter[str]()
    for number in range(CALLS // 2):
        name = names[number % len(names)]
        before = worlds.batch.save()
        try:
            calls[name]()
            outcomes["accepted"] += 1
        except REFUSALS:
            outcomes["refused"] += 1
            if name != "repeat":
                assert worlds.batch.save().tobytes() == before.tobytes(), name
    total = outcomes["accepted"] + outcomes["refused"]
    print(f"{engine}: {total} calls of {len(names)} functions, {outcomes['refused']} refused, none ended the process")
    assert total == CALLS // 2
    assert min(outcomes.values()) > CALLS // 20
    worlds.step(np.zeros((3, 2), np.float32))
    assert np.isfinite(worlds["observation"]).all()


def test_the_sanitized_core_is_the_one_that_is_tested() -> None:
    wanted = os.environ.get("ROMGRL_SANITIZED")
    if wanted is None:
        pytest.skip("the core is built without sanitizers")
    assert all(
        os.path.realpath(module.__file__).startswith(os.path.realpath(wanted)) for module in (_core, humanoid_core)
    )
