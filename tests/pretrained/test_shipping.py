"""`python -m romgrl.pretrained` replaces what ships as a whole or not at all, and says in one line why not."""

from __future__ import annotations

import errno
import os
import resource
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from romgrl.pretrained.__main__ import main
from romgrl.provenance.shipped import GROUPS


def content(place: Path) -> dict[str, bytes]:
    """Every file that ships."""
    return {str(path.relative_to(place)): path.read_bytes() for path in place.rglob("*") if path.is_file()}


def test_a_full_disk_leaves_what_ships(outputs: Path, shipped: Path) -> None:
    """A limit on the size of files, as `ulimit -f` sets it."""
    before, code = content(shipped), "import sys; from romgrl.provenance import shipped; from pathlib import Path; "
    code += (
        "shipped.PLACE = Path(sys.argv[1]); from romgrl.pretrained.__main__ import main; sys.exit(main(sys.argv[2:]))"
    )
    ended = subprocess.run(
        [sys.executable, "-c", code, shipped, outputs, "experiment=smoke"],
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096)),
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=False,
    )
    assert ended.returncode == 5, ended.stderr
    assert ended.stderr.endswith("File too large\n")
    assert content(shipped) == before
    assert sorted(path.name for path in shipped.iterdir()) == sorted([*GROUPS, "MODEL_CARD.md"])


def test_a_swap_that_fails_is_undone(outputs: Path, shipped: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whichever rename fails; `baseline` is one of those that did not ship before."""
    (shipped / "MODEL_CARD.md").write_text("of others", encoding="utf-8")
    shutil.rmtree(shipped / "baseline")
    before, rename, undone = content(shipped), os.rename, 0
    for failing in range(7):
        count = iter(range(100))

        def broken(source: Path, target: Path, count: Iterator[int] = count, failing: int = failing) -> None:
            if next(count) == failing:
                raise OSError(errno.EIO, os.strerror(errno.EIO), str(source))
            rename(source, target)

        with monkeypatch.context() as patch:
            patch.setattr(os, "rename", broken)
            assert main([str(outputs), "experiment=smoke"]) == 5
        undone += content(shipped) == before
    print(f"{undone} of 7 swaps that failed are undone")
    assert undone == 7
    assert main([str(outputs), "experiment=smoke"]) == 0
    assert content(shipped) != before


BAD_SETTINGS = {
    "nope": "nope: cannot be read; write key=value",
    "rom=nope": "rom: nope is not allowed; allowed: ",
    "bogus=1": "bogus: ",
}


def test_the_command_says_why_nothing_fits(outputs: Path, shipped: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(outputs), "experiment=smoke", "eta=0.4"]) == 3
    assert "eta 0.3 instead of 0.4" in capsys.readouterr().err
    assert main([str(outputs), "experiment=smok"]) == 2
    assert main([str(outputs), "speed=fast"]) == 2
    assert "speed: fast is not allowed" in capsys.readouterr().err
    for argument, line in BAD_SETTINGS.items():
        assert main([str(outputs), argument]) == 2
        said = capsys.readouterr().err
        assert line in said
        assert len(said.splitlines()) == 1
    assert main(["a" * 5000]) == 5
    assert capsys.readouterr().err.endswith("a: File name too long\n")
    for arguments, code in (([], 2), (["--help"], 0)):
        with pytest.raises(SystemExit) as ended:
            main(arguments)
        assert ended.value.code == code
    assert "the directory of results" in capsys.readouterr().out
    assert (shipped / "MODEL_CARD.md").is_file()
