"""An export wants a package that an installation without the extra does not have."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

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
    monkeypatch.setitem(sys.modules, "onnx", None)
    assert [*misfits(compose_config("stage=student"))] == []
    assert [*misfits(compose_config("stage=export"))] == [LINE]


@pytest.mark.parametrize(
    ("fault", "told"),
    [
        ("raise TypeError('Descriptors\\ncannot be created')", "TypeError: Descriptors cannot be created"),
        ("import ml_dtypes_of_nobody", "No module named 'ml_dtypes_of_nobody'"),
        ("raise ImportError('no libonnx.so')", "ImportError: no libonnx.so"),
    ],
)
def test_a_broken_onnx_is_told_before_any_work(
    compose_config: Composer, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, fault: str, told: str
) -> None:
    (tmp_path / "onnx.py").write_text(fault, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "onnx", raising=False)
    assert [*misfits(compose_config("stage=export"))] == [
        f"stage=export: onnx cannot be imported: {told}; pip install onnx, the extra romgrl[export]"
    ]
