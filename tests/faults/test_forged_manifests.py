"""Manifests of somebody who knows their format: nothing in them is executed, and no name leads out of an artifact."""

from __future__ import annotations

import json
import os
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from romgrl.artifacts import open_artifact
from romgrl.errors import ArtifactError
from tests.helpers.damage import forge, sign


def test_the_configuration_in_a_manifest_is_never_instantiated(artifact: Path, mark: Path) -> None:
    target = {"_target_": "os.mkdir", "path": str(mark)}
    forge(artifact, lambda document: document["config"].update({"teacher": target, "_target_": "os.mkdir"}))
    assert open_artifact(artifact).config["teacher"] == target
    assert not mark.exists()


OUTSIDE = [
    *("../outside.csv", "../../outside.csv", "figures/../../outside.csv", "figures/../curve.csv", "./curve.csv"),
    *(
        "figures/./a.txt",
        "/etc/hostname",
        "//etc/hostname",
        "/figures/a.txt",
        "/",
        "",
        ".",
        "..",
        "...",
        "figures//a.txt",
    ),
    *("figures/", "..\\outside.csv", "figures\\a.txt", "C:\\outside.csv", "C:/outside.csv", "c:outside.csv"),
    *("\\\\server\\share\\a.csv", "file:///etc/hostname", "curve.csv\x00.png", "\x00", "curve.csv\n", "\ncurve.csv"),
    *(" curve.csv", "curve.csv ", "curve.csv.", ".curve.csv", "figures/ a.txt", "figures /a.txt", "figures./a.txt"),
    *("~/outside.csv", "$HOME/outside.csv", "%2e%2e/outside.csv", "．．/outside.csv", "curve.csv:stream", "a" * 300),
]


@pytest.mark.usefixtures("mark")
def test_names_that_lead_elsewhere_are_refused(artifact: Path) -> None:
    (artifact.parent / "outside.csv").write_text("step,loss\n1,2\n", encoding="utf-8")
    pristine, refused = (artifact / "manifest.json").read_text(encoding="utf-8"), 0
    assert len(set(OUTSIDE)) == 40
    for name in OUTSIDE:
        (artifact / "manifest.json").write_text(pristine, encoding="utf-8")
        forge(artifact, lambda document: document["files"].update({name: document["files"].pop("curve.csv")}))  # noqa: B023
        with pytest.raises(ArtifactError) as caught:
            open_artifact(artifact)
        assert str(caught.value) == f"{artifact}/manifest.json: {name!r} is not the name of a file of an artifact"
        refused += 1
    assert refused == 40
    print(f"{refused} of 40 names refused")


def link(path: Path, target: Path) -> None:
    path.unlink()
    path.symlink_to(target)


SPECIAL: dict[str, Callable[[Path], object]] = {
    "file": lambda artifact: link(artifact / "curve.csv", artifact.parent / "outside.csv"),
    "extra": lambda artifact: (artifact / "more.csv").symlink_to(artifact.parent / "outside.csv"),
    "broken": lambda artifact: (artifact / "more.csv").symlink_to(artifact / "nothing"),
    "directory": lambda artifact: (artifact / "more").symlink_to(artifact.parent, target_is_directory=True),
    "manifest": lambda artifact: link(artifact / "manifest.json", artifact.parent / "manifest.json"),
    "pipe": lambda artifact: os.mkfifo(artifact / "more.csv"),
}


@pytest.mark.parametrize("kind", SPECIAL)
def test_links_and_special_files_are_refused(artifact: Path, kind: str) -> None:
    (artifact.parent / "outside.csv").write_bytes((artifact / "curve.csv").read_bytes())
    (artifact.parent / "manifest.json").write_bytes((artifact / "manifest.json").read_bytes())
    SPECIAL[kind](artifact)
    with pytest.raises(ArtifactError, match=r"neither a file nor a directory|is a link"):
        open_artifact(artifact)


def update(**values: Any) -> Callable[[dict[str, Any]], object]:
    return lambda document: document.update(values)


FORGED: dict[str, Callable[[dict[str, Any]], object]] = {
    "stage is a number": update(stage=1),
    "key is a list": update(key=["k"]),
    "seed is text": update(seed="0"),
    "seed is true": update(seed=True),
    "time is text": update(wall_time="1"),
    "inputs is a list": update(inputs=[]),
    "a digest is a number": update(inputs={"teacher": 7}),
    "too much": update(config={"x": "a" * 2**20}),
    "unknown field": update(code="import os"),
    "a huge size": lambda document: document["files"]["curve.csv"].update(size=10**400),
    "a negative size": lambda document: document["files"]["curve.csv"].update(size=-1),
    "a fraction of bytes": lambda document: document["files"]["curve.csv"].update(size=1.0),
    "a short digest": lambda document: document["files"]["curve.csv"].update(sha256="ab"),
    "a shape of text": lambda document: document["files"]["curve.csv"].update(arrays={"x": ["float32", "ab"]}),
}


def texts(artifact: Path) -> dict[str, bytes]:
    """Manifests that are no manifest."""
    whole = (artifact / "manifest.json").read_text(encoding="utf-8")
    document = json.loads(whole)
    files = json.loads(whole) | {"files": []}
    return {
        "deep": b"[" * 100_000,
        "deep in a field": whole.replace(
            '"config": {', '"config": {"x": ' + "[" * 50_000 + "]" * 50_000 + ", "
        ).encode(),
        "large": b" " * (2**20 + 1),
        "a name twice": whole.replace('"seed": 0,\n  "stage"', '"seed": 0,\n  "seed": 0,\n  "stage"').encode(),
        "not a number": sign(document | {"wall_time": float("nan")}).encode(),
        "infinite": sign(document | {"wall_time": float("inf")}).encode(),
        "a list of files": json.dumps(files).encode(),
        "a pickle": pickle.dumps(document),
        "not UTF-8": b"\xff\xfe" + whole.encode(),
        "a number of a million digits": whole.replace('"seed": 0', '"seed": ' + "9" * 1_000_000).encode(),
        "null": b"null",
        "nothing": b"",
        "spaces at the end": whole.encode() + b"  ",
    }


def test_hostile_manifests_are_refused(artifact: Path) -> None:
    path = artifact / "manifest.json"
    pristine, refused = path.read_bytes(), 0
    cases = texts(artifact)
    for case, text in cases.items():
        assert text != pristine, case
        path.write_bytes(text)
        with pytest.raises(ArtifactError, match=r"manifest\.json: "):
            open_artifact(artifact)
        refused += 1
    for change in FORGED.values():
        path.write_bytes(pristine)
        forge(artifact, change)
        with pytest.raises(ArtifactError, match=r"manifest\.json: "):
            open_artifact(artifact)
        refused += 1
    assert refused == len(cases) + len(FORGED) == 27
    print(f"{refused} of 27 hostile manifests refused")
