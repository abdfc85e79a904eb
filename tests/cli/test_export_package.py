"""An export wants a package that an installation without the extra does not have."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from romgrl.cli import export_package
from romgrl.cli.consistency import misfits
from tests.conftest import Composer

ROOT = Path(__file__).resolve().parents[2]
LINE = "stage=export: onnx is not installed; pip install onnx, the extra romgrl[export]"


def test_without_onnx_nothing_begins(tmp_path: Path) -> None:
    script = "import sys; sys.modules['onnx'] = None; from tests.helpers.fake_stages import main; main()"
    arguments = [sys.executable, "-c", script, "stage=export", f"paths.outputs={tmp_path}/outputs"]
    result = subprocess.run(arguments, cwd=ROOT, capture_output=True, text=True, encoding="utf-8", check=False)
    assert (result.returncode, result.stdout, result.stderr) == (2, "", f"{LINE}\n")
    assert not list(tmp_path.iterdir())


def test_other_stages_do_without(compose_config: Composer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(export_package, "find_spec", lambda name: None)
    assert [*misfits(compose_config("stage=student"))] == []
    assert [*misfits(compose_config("stage=export"))] == [LINE]
