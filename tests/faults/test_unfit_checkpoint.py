"""A checkpoint that is whole but not of this training is named and set aside; the training goes on from one that is."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from romgrl.artifacts import load_tensors, save_tensors
from romgrl.artifacts.checkpoint import CHECKPOINT, sealed
from romgrl.runtime.signals import Interrupted
from tests.conftest import Composer
from tests.helpers.cut_trainings import Recorder, files, train, training

Document = dict[str, Any]
Tensors = dict[str, torch.Tensor]
Spoil = Callable[[Document, Tensors], object]


def forge(directory: Path, spoil: Spoil, rows: Callable[[Tensors], object] | None = None) -> None:
    """Change the newest checkpoint, and seal it again."""
    path = max(directory.glob("*.json"), key=lambda each: int(each.stem))
    document = json.loads(path.read_bytes().partition(b"\n")[2])
    state = path.with_suffix(".safetensors")
    tensors = load_tensors(state)[0]
    spoil(document, tensors)
    save_tensors(state, tensors, {})
    changed = [state]
    if rows is not None:
        changed.append(directory / max(document["segments"], key=lambda name: document["segments"][name]["last"]))
        columns = load_tensors(changed[-1])[0]
        rows(columns)
        save_tensors(changed[-1], columns, {})
    for file in changed:
        if document.get("files"):
            document["files"][file.name] = hashlib.sha256(file.read_bytes()).hexdigest()
    path.write_bytes(sealed(document))


def resized(name: str) -> Spoil:
    def spoil(document: Document, tensors: Tensors) -> None:
        tensors[name] = torch.cat([tensors[name].flatten(), tensors[name].flatten()])

    return spoil


TEACHER: dict[str, Spoil] = {
    "no values": lambda document, tensors: document.pop("values"),
    "no segments": lambda document, tensors: document.pop("segments"),
    "no files": lambda document, tensors: document.pop("files"),
    "files is a list": lambda document, tensors: document.update(files=[]),
    "no SHA-256 of the state": lambda document, tensors: document["files"].clear(),
    "another step": lambda document, tensors: document.update(step=1),
    "a value in the place of a part": lambda document, tensors: document["values"].update(ppo=1),
    "a part in the place of a value": lambda document, tensors: document["values"].update({"ppo/weights/x": 1}),
    "a part more": lambda document, tensors: document["values"].update({"more/number": 1}),
    "an extra name": lambda document, tensors: document["values"].update({"ppo/more": 1}),
    "a tensor is missing": lambda document, tensors: tensors.pop("ppo/weights"),
    "a part is missing": lambda document, tensors: [tensors.pop(name) for name in list(tensors) if "tally" in name],
    "another shape": resized("ppo/weights"),
    "another shape of an array": resized("loop/observation"),
    "another shape of moments": resized("ppo/optimizer/0/exp_avg"),
    "no moment": lambda document, tensors: tensors.pop("ppo/optimizer/0/exp_avg_sq"),
    "moments of another parameter": lambda document, tensors: tensors.update(
        {"ppo/optimizer/7/exp_avg": tensors["ppo/weights"].clone()}
    ),
    "another dtype": lambda document, tensors: tensors.update({"ppo/weights": tensors["ppo/weights"].double()}),
    "another dtype of an array": lambda document, tensors: tensors.update(
        {"tally/length": tensors["tally/length"] > 0}
    ),
    "a generator cut short": lambda document, tensors: tensors.update({"ppo/generator": tensors["ppo/generator"][:9]}),
    "worlds cut short": lambda document, tensors: tensors.update({"loop/worlds": tensors["loop/worlds"][:, 1:]}),
}


def test_a_teacher_goes_on_from_the_checkpoint_before(
    compose_config: Composer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    config, recorder = training("teacher", compose_config), Recorder(monkeypatch)
    for cut in (1024, 2048):
        recorder.cut = cut
        recorder.again()
        with pytest.raises(Interrupted):
            train("teacher", config, tmp_path / "cut")
    named = 0
    for kind, spoil in TEACHER.items():
        output = shutil.copytree(tmp_path / "cut", tmp_path / kind)
        forge(output / CHECKPOINT, spoil)
        recorder.again()
        recorder.cut = 1280
        capsys.readouterr()
        with pytest.raises(Interrupted):
            train("teacher", config, output)
        assert recorder.steps == [1280], kind
        said = "".join(capsys.readouterr().out.split())
        named += "2048." in said and "setasideas2048.json.damaged" in said
        assert (output / CHECKPOINT / "2048.json.damaged").exists(), kind
    print(f"{named} of {len(TEACHER)} checkpoints that do not fit are named, and the one before is used")
    assert named == len(TEACHER)


def test_a_list_is_no_checkpoint(compose_config: Composer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config, recorder = training("teacher", compose_config), Recorder(monkeypatch)
    place = tmp_path / "cut" / CHECKPOINT
    place.mkdir(parents=True)
    contents = [json.dumps([]).encode(), b"not JSON", b"[" * 100000, b"\xff"]
    for step, text in enumerate(contents):
        (place / f"{step}.json").write_bytes(hashlib.sha256(text).hexdigest().encode() + b"\n" + text)
    (place / "notes.json").write_text("{}", encoding="utf-8")
    recorder.cut = 256
    with pytest.raises(Interrupted):
        train("teacher", config, tmp_path / "cut")
    assert len([*place.glob("*.damaged")]) == len(contents)


STUDENT: dict[str, tuple[Spoil, Callable[[Tensors], object] | None]] = {
    "a row short": (
        lambda document, tensors: None,
        lambda rows: rows.update({name: column[:-1].clone() for name, column in rows.items()}),
    ),
    "a column missing": (lambda document, tensors: None, lambda rows: rows.pop("back")),
    "a column more": (lambda document, tensors: None, lambda rows: rows.update(more=rows["back"].clone())),
    "another type": (lambda document, tensors: None, lambda rows: rows.update(back=rows["back"].double())),
    "no segments": (lambda document, tensors: document.update(segments={}), None),
    "fewer rows than were added": (
        lambda document, tensors: document["values"].update({"learner/buffer/added": 999}),
        None,
    ),
    "an attribute more": (lambda document, tensors: document["values"].update({"loop/more": 1}), None),
    "metrics are none": (lambda document, tensors: document["values"].update({"loop/metrics": 1}), None),
    "text for a number": (lambda document, tensors: document["values"].update({"loop/due": "x"}), None),
    "another critic": (resized("learner/sac/tensors/critic"), None),
    "another moment": (resized("learner/sac/critic_optimizer/0/exp_avg"), None),
    "no such generator": (
        lambda document, tensors: document["values"].update({"env/generator/bit_generator": "x"}),
        None,
    ),
}


@pytest.mark.parametrize("kinds", [["a row short", "another moment"], pytest.param([*STUDENT], marks=pytest.mark.slow)])
def test_a_student_starts_again_with_the_bits_of_a_start(
    kinds: list[str], compose_config: Composer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing of the checkpoint stays in networks, optimisers, random streams or the replay buffer."""
    config, recorder = training("student", compose_config, "student.total_steps=800"), Recorder(monkeypatch)
    train("student", config, tmp_path / "whole")
    whole = (recorder.state, files(tmp_path / "whole"))
    recorder.again()
    recorder.cut = 600
    with pytest.raises(Interrupted):
        train("student", config, tmp_path / "cut")
    for kind in kinds:
        output = shutil.copytree(tmp_path / "cut", tmp_path / kind)
        forge(output / CHECKPOINT, *STUDENT[kind])
        recorder.again()
        train("student", config, output)
        assert recorder.steps[0] == 8, kind
        assert (recorder.state, files(output)) == whole, kind
        assert [*output.glob(f"{CHECKPOINT}/*.json.damaged")], kind
