"""An artifact is published whole or not at all, whichever call to the operating system fails."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from romgrl.artifacts import (
    load_arrays,
    load_tensors,
    open_artifact,
    publish,
    read_manifest,
    save_arrays,
    save_tensors,
    set_aside,
)
from romgrl.errors import ArtifactError, StorageError
from tests.faults.injection import Faults
from tests.helpers.artifacts import describe, fill

CODES = (errno.ENOSPC, errno.EIO, errno.EACCES)


def make(directory: Path) -> None:
    """What a job does at the end of a stage."""
    partial = directory.with_name("key.partial")
    describe(partial)
    publish(partial, directory)


def contents(directory: Path) -> dict[str, bytes]:
    paths = sorted(path for path in directory.rglob("*") if path.is_file())
    return {path.relative_to(directory).as_posix(): path.read_bytes() for path in paths}


def calls_of(work: Callable[[], object]) -> int:
    """How many calls to the operating system it takes."""
    faults = Faults()
    with faults.installed():
        work()
    return len(faults.calls)


def test_every_failed_call_of_a_publish_leaves_old_or_new(tmp_path: Path) -> None:
    def prepare(name: str) -> Path:
        directory = tmp_path / name / "key"
        fill(directory.with_name("key.partial"))
        return directory

    counted = prepare("counted")
    total = calls_of(lambda: make(counted))
    whole = contents(counted)
    left = {"old": 0, "new": 0}
    for code in CODES:
        for call in range(total):
            directory = prepare(f"{code}-{call}")
            partial = directory.with_name("key.partial")
            payload = contents(partial)
            with Faults(call, code).installed(), pytest.raises(StorageError, match=os.strerror(code)) as caught:
                make(directory)
            assert len(str(caught.value).splitlines()) == 1
            if directory.exists():
                open_artifact(directory, stage="teacher", key="key")
                assert not partial.exists()
                left["new"] += 1
            else:
                kept = contents(partial)
                assert {name: kept.get(name) for name in payload} == payload
                assert set(kept) <= {*payload, "manifest.json"}
                make(directory)  # the same again, now that the disk works
                left["old"] += 1
            assert contents(directory) == whole
            shutil.rmtree(directory.parent)
    assert total > 40
    assert left["old"] > 0
    assert left["new"] > 0
    print(f"{sum(left.values())} of {len(CODES) * total} failed calls left the old state ({left['old']}) or the new")


def test_every_failed_call_of_a_save_leaves_the_old_file_or_the_new(tmp_path: Path) -> None:
    arrays, tensors = tmp_path / "x.npz", tmp_path / "x.safetensors"

    def save(value: float) -> None:
        save_arrays(arrays, {"x": np.full(3, value)})
        save_tensors(tensors, {"x": torch.full((3,), value)}, {})

    def values() -> tuple[float, float]:
        return float(load_arrays(arrays)["x"].mean()), float(load_tensors(tensors)[0]["x"].mean())

    save(0.0)
    total, whole = calls_of(lambda: save(0.0)), 0
    for code in CODES:
        for call in range(total):
            save(0.0)
            with Faults(call, code).installed(), pytest.raises(StorageError):
                save(1.0)
            assert values() in ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0))
            assert sorted(path.name for path in tmp_path.iterdir()) == ["x.npz", "x.safetensors"]
            whole += 1
    assert whole == len(CODES) * total >= 3 * 12
    print(f"{whole} of {len(CODES) * total} failed calls left a whole file")


def test_all_is_on_the_disk_before_it_has_its_name(tmp_path: Path) -> None:
    """What a power cut leaves: nothing that was not synchronised after its last write."""
    directory = tmp_path / "key"
    partial = tmp_path / "key.partial"
    fill(partial)
    faults = Faults()
    with faults.installed():
        describe(partial)
        manifest = [number for number, (name, _) in enumerate(faults.calls) if name == "replace"][-1]
        publish(partial, directory)
    renamed = next(number for number, (name, _) in enumerate(faults.calls) if name == "rename")
    last_write = max(number for number, (name, _) in enumerate(faults.calls) if name == "write")
    before = {inode for number, inode in faults.synced if last_write < number < renamed}
    everything = {path.stat().st_ino for path in (directory, *directory.rglob("*"))}
    assert len(everything) == 7
    assert everything <= before
    assert any(number < manifest for number, inode in faults.synced)  # its bytes before its name
    assert [inode for number, inode in faults.synced if number > renamed] == [tmp_path.stat().st_ino]
    replaced = [call for call in faults.calls if call[0] == "replace"]
    assert Path(replaced[-1][1]).name.startswith(".manifest.json.")
    print(f"{len(everything)} of {len(everything)} files and directories synchronised before the name")


@pytest.mark.parametrize("name", ["x.npz", "x.safetensors", "manifest.json"])
def test_a_saved_file_is_on_the_disk_before_it_has_its_name(tmp_path: Path, name: str) -> None:
    faults = Faults()
    with faults.installed():
        if name.endswith("npz"):
            save_arrays(tmp_path / name, {"x": np.ones(3)})
        elif name.endswith("safetensors"):
            save_tensors(tmp_path / name, {"x": torch.ones(3)}, {})
        else:
            describe(tmp_path)
    named = next(number for number, (call, _) in enumerate(faults.calls) if call == "replace")
    written = max(number for number, (call, _) in enumerate(faults.calls) if call == "write")
    assert [inode for number, inode in faults.synced if written < number < named] == [(tmp_path / name).stat().st_ino]


def test_without_a_manifest_nothing_is_published(tmp_path: Path) -> None:
    fill(tmp_path / "key.partial")
    with pytest.raises(ArtifactError, match="not a finished artifact"):
        publish(tmp_path / "key.partial", tmp_path / "key")
    assert not (tmp_path / "key").exists()


def test_what_is_there_already_is_not_replaced(tmp_path: Path) -> None:
    fill(tmp_path / "key.partial")
    make(tmp_path / "key")
    before = contents(tmp_path / "key")
    fill(tmp_path / "key.partial")
    (tmp_path / "key.partial" / "curve.csv").write_text("step\n9\n", encoding="utf-8")
    with pytest.raises(StorageError, match="not empty"):
        make(tmp_path / "key")
    assert contents(tmp_path / "key") == before


def test_set_aside_keeps_everything_under_names_of_their_own(tmp_path: Path) -> None:
    names = set()
    for round_number in range(20):
        fill(tmp_path / "key.partial")
        make(tmp_path / "key")
        (tmp_path / "key" / "curve.csv").write_text(str(round_number), encoding="utf-8")
        aside = set_aside(tmp_path / "key")
        assert (aside / "curve.csv").read_text(encoding="utf-8") == str(round_number)
        assert aside.name.startswith("key.damaged-20")
        assert not (tmp_path / "key").exists()
        names.add(aside)
    assert len(names) == len(list(tmp_path.iterdir())) == 20
    assert read_manifest(names.pop()).key == "key"
