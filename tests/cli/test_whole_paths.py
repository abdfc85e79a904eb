"""A file of a humanoid lies in the working directory, or beside the preset that brings it."""

from __future__ import annotations

from pathlib import Path

import pytest

from romgrl.cli.compose import compose_config
from romgrl.humanoid.own_body import human_spec


def test_a_preset_brings_its_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    presets, elsewhere = tmp_path / "presets" / "humanoid", tmp_path / "elsewhere"
    presets.mkdir(parents=True)
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    (presets / "mine.yaml").write_text("defaults: [planar, _self_]\nxml: body.xml\n", encoding="utf-8")
    asked = f"hydra.searchpath=[file://{tmp_path / 'presets'}]", "humanoid=mine"
    assert compose_config(*asked).humanoid.xml == str(elsewhere / "body.xml")  # which is then said to be missing
    (presets / "body.xml").write_text(human_spec(height=1.7, mass=70).to_xml(), encoding="utf-8")
    assert compose_config(*asked).humanoid.xml == str(presets / "body.xml")
    (elsewhere / "body.xml").write_text("<mujoco/>", encoding="utf-8")
    assert compose_config(*asked).humanoid.xml == str(elsewhere / "body.xml")


def test_each_path_of_a_list_is_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", "/home/me")
    monkeypatch.setenv("ELSEWHERE", "there/c")
    written = "library.others=[a,'~/b',/d,'${oc.env:ELSEWHERE}']"
    assert compose_config(written).library.others == [f"{tmp_path}/a", "/home/me/b", "/d", f"{tmp_path}/there/c"]
