"""Nothing that lies in an artifact or in a configuration is executed, and no array is larger than it may be."""

from __future__ import annotations

import io
import json
import os
import pickle
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from romgrl.algorithms import ppo_policy, sac
from romgrl.artifacts import load_arrays, open_artifact, save_tensors
from romgrl.errors import ArtifactError
from tests.helpers.artifacts import describe, fill
from tests.helpers.damage import replace_file
from tests.helpers.limits import PATIENCE

ROOT = Path(__file__).resolve().parents[2]


class Payload:
    """Makes the directory EVIL when it is unpickled."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self) -> tuple[Callable[..., None], tuple[str]]:
        return os.mkdir, (str(self.mark),)


def npz(**members: bytes) -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, member in members.items():
            archive.writestr(f"{name}.npy", member)
    return content.getvalue()


def npy(header: str, body: bytes = b"") -> bytes:
    text = header.encode() + b"\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + body


def saved(value: Any, directory: Path) -> bytes:
    """As numpy or torch write it, pickles and all."""
    path = directory / ("x.pt" if isinstance(value, dict) else "x.npz")
    torch.save(value, path) if isinstance(value, dict) else np.savez(path, x=value)
    content = path.read_bytes()
    path.unlink()
    return content


def policy(directory: Path, network: Any) -> bytes:
    path = directory / "x.safetensors"
    save_tensors(
        path, {"0.weight": torch.ones(1, 1)}, {"network": network if isinstance(network, str) else json.dumps(network)}
    )
    content = path.read_bytes()
    path.unlink()
    return content


def hostile_files(mark: Path) -> dict[str, tuple[str, bytes]]:
    """Ten files with code in them, by the name that they are put under in an artifact."""
    place, pickled = mark.parent, pickle.dumps(Payload(mark))
    objects = np.array([Payload(mark)], dtype=object)
    mixed = np.array([(1.0, Payload(mark))], dtype=[("a", "f4"), ("b", object)])
    call = f"__import__('os').mkdir({str(mark)!r})"
    network = {"algorithm": "ppo", "input_size": 1, "output_size": 1, "hidden_sizes": []}
    return {
        "pickle as tensors": ("policy.safetensors", pickled),
        "torch.save as tensors": ("policy.safetensors", saved({"w": Payload(mark)}, place)),
        "pickle in .pt": ("policy.pt", saved({"w": Payload(mark)}, place)),
        "pickle as arrays": ("reference.npz", pickled),
        "array of objects": ("reference.npz", saved(objects, place)),
        "record with an object": ("reference.npz", saved(mixed, place)),
        "pickle in npz": ("reference.npz", npz(features=pickled)),
        "code as dtype": (
            "reference.npz",
            npz(features=npy(f"{{'descr': {call}, 'fortran_order': False, 'shape': ()}}")),
        ),
        "code as network": ("policy.safetensors", policy(place, call)),
        "callable as activation": ("policy.safetensors", policy(place, network | {"activation": "os.mkdir"})),
        "_target_ in a network": (
            "policy.safetensors",
            policy(place, network | {"_target_": "os.mkdir", "path": str(mark)}),
        ),
    }


def test_code_in_an_artifact_is_refused_and_not_executed(mark: Path, tmp_path: Path) -> None:
    refused, cases = 0, hostile_files(mark)
    for case, (name, content) in cases.items():
        place = tmp_path / case.replace(" ", "-")
        fill(place)
        describe(place)
        arrays = {"features": ["object", [1]]} if name.endswith("npz") else {"0.weight": ["float32", [1, 1]]}
        replace_file(place, name, content, {} if name.endswith("pt") else arrays)
        if "network" not in case and "callable" not in case:  # those hold tensors, and code in their description
            with pytest.raises(ArtifactError, match=name.replace(".", r"\.")):
                open_artifact(place)
        if name.endswith("npz"):
            with pytest.raises(ArtifactError, match=r"reference\.npz: cannot be read"):
                load_arrays(place / name)
        elif name.endswith("safetensors"):
            for load in (ppo_policy.load_ppo_policy, sac.load_sac_policy):
                with pytest.raises(ArtifactError, match=r"policy\.safetensors: "):
                    load(place / name)
        assert not mark.exists(), case
        refused += 1
    assert refused == len(cases) == 11
    pickle.loads(pickle.dumps(Payload(mark)))
    assert mark.exists()  # so they would have
    print(f"{refused} of {len(cases)} files with code refused, none executed")


def configurations(mark: Path) -> dict[str, tuple[str, list[str]]]:
    """YAML and command lines that would make EVIL, by kind."""
    call = f"{{_target_: os.mkdir, path: '{mark}'}}"
    handler = f"{{'()': os.mkdir, path: '{mark}'}}"
    logging = "{{version: 1, root: {{handlers: [x]}}, handlers: {{x: {0}}}}}"
    return {
        "callback": (f"hydra: {{callbacks: {{x: {call}}}}}", []),
        "callback on the command line": ("", [f"+hydra.callbacks.x={{_target_:os.mkdir,path:'{mark}'}}"]),
        "in a callback": (f"hydra: {{callbacks: {{sweep: {{x: {call}}}}}}}", []),
        "in a list in a callback": (f"hydra: {{callbacks: {{sweep: {{x: [[{call}]]}}}}}}", []),
        "interpolated": ("hydra: {callbacks: {x: {_target_: '${oc.env:EVIL}', path: '${oc.env:MARK}'}}}", []),
        "referred to": (f"x: {call}\nhydra: {{callbacks: {{x: '${{x}}'}}}}", []),
        "launcher": (f"hydra: {{launcher: {call}}}", ["-m"]),
        "sweeper": (f"hydra: {{sweeper: {{x: {call}}}}}", ["-m"]),
        "logging": (f"hydra: {{job_logging: {logging.format(handler)}}}", []),
        "logging of hydra": (f"hydra: {{hydra_logging: {logging.format(handler)}}}", []),
        "class of a handler": (f"hydra: {{job_logging: {logging.format('{class: evil_package.Handler}')}}}", []),
        "YAML tag": (f"x: !!python/object/apply:os.mkdir ['{mark}']", []),
        "YAML tag of a name": ("x: !!python/name:evil_package.MADE", []),
        "package on the search path": ("hydra: {searchpath: ['pkg://evil_package']}", []),
        "environment of the job": ("hydra: {job: {env_set: {PYTHONPATH: '/evil'}}}", []),
    }


def test_a_configuration_executes_nothing(mark: Path, tmp_path: Path) -> None:
    (tmp_path / "evil_package").mkdir()
    (tmp_path / "evil_package" / "__init__.py").write_text(f"import os\nos.mkdir({str(mark)!r})\n", encoding="utf-8")
    refused, cases = 0, configurations(mark)
    variables = {"EVIL": "os.mkdir", "MARK": str(mark), "PYTHONPATH": f"{ROOT}:{tmp_path}", "OMP_NUM_THREADS": "1"}
    for case, (yaml, arguments) in cases.items():
        (tmp_path / "evil.yaml").write_text(f"defaults: [config, _self_]\n{yaml}\n", encoding="utf-8")
        arguments += ["stage=teacher", "tracking=none", f"paths.outputs={tmp_path}/outputs"]
        arguments += ["--config-dir", str(tmp_path), "--config-name", "evil"]
        result = subprocess.run(
            [sys.executable, "-m", "tests.helpers.fake_stages", *arguments],
            env=os.environ | variables,
            cwd=ROOT,
            capture_output=True,
            text=True,
            timeout=PATIENCE,
            check=False,
            encoding="utf-8",
        )
        told = result.stderr.splitlines()  # what is found in two places has two lines
        assert (result.returncode, len(told)) == (2, 2 if case == "referred to" else 1), f"{case}: {told}"
        assert not mark.exists(), case
        assert not (tmp_path / "outputs").exists(), case
        refused += 1
    assert refused == len(cases) == 15
    print(f"{refused} of {len(cases)} configurations with code refused with exit code 2, none executed")


def test_arrays_that_are_not_as_large_as_they_say(tmp_path: Path) -> None:
    """Refused before anything of that size is allocated."""
    header = "{{'descr': '<f4', 'fortran_order': False, 'shape': ({},)}}"
    cases = {
        "more than the file has": npz(features=npy(header.format(10**12))),
        "negative": npz(features=npy(header.format(-1))),
        "less than the file has": npz(features=npy(header.format(1), b"0" * 10**6)),
        "too large": npz(features=npy("{'descr': '<f4', 'fortran_order': False, 'shape': (" + "9" * 30 + ",)}")),
        "no array": npz(features=b"0" * 10**6),
    }
    for content in cases.values():
        (tmp_path / "x.npz").write_bytes(content)
        with pytest.raises(ArtifactError, match=r"x\.npz: cannot be read"):
            load_arrays(tmp_path / "x.npz")
    print(f"{len(cases)} of {len(cases)} false sizes refused")


def test_a_bomb_is_refused_by_its_declared_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("romgrl.artifacts.payload.LARGEST_ARRAYS", 10**6)
    np.savez_compressed(tmp_path / "x.npz", x=np.zeros(10**6, np.float32))
    assert (tmp_path / "x.npz").stat().st_size < 10**4
    with pytest.raises(ArtifactError, match="holds more than 4 GiB"):
        load_arrays(tmp_path / "x.npz")
