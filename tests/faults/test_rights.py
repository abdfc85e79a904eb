"""Whoever may only read the results of another reads them; what has to be written is told before any work."""

from __future__ import annotations

import io
import os
import shutil
import stat
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from romgrl.artifacts import rights, setting_aside
from romgrl.artifacts.locks import Owner, exclusive, lock_path
from romgrl.artifacts.rights import require_right
from romgrl.config.schema import Config
from romgrl.errors import ArtifactError, ConfigurationError
from romgrl.pipeline import run as pipeline
from romgrl.pipeline.watch import film_directory
from tests.helpers.jobs import start, trainings
from tests.helpers.limits import PATIENCE

ARGUMENTS = ("experiment=smoke", "threads=1", "stage=evaluation")
Reader = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture
def reader(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Reader]:
    """Run the command line as somebody who may not write under `outputs`, however high the user of the tests is."""
    outputs = tmp_path / "outputs"
    if os.geteuid() == 0 and shutil.which("setpriv") is None:
        pytest.skip("root may write everywhere, and there is no setpriv to change that")
    limited = ["setpriv", "--bounding-set=-dac_override,-dac_read_search"] if os.geteuid() == 0 else []
    popen = subprocess.Popen

    def started(arguments: list[str], **options: object) -> subprocess.Popen[str]:
        return popen([*limited, *arguments], **options)

    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        permit(outputs, 0o555)
        with monkeypatch.context() as patched:
            patched.setattr(subprocess, "Popen", started)
            process = start(*arguments, f"paths.outputs={outputs}")
        out, err = process.communicate(timeout=PATIENCE)
        permit(outputs, 0o755)
        return subprocess.CompletedProcess(process.args, process.returncode, out, err)

    yield run
    permit(outputs, 0o755)


def permit(outputs: Path, mode: int) -> None:
    """Give every directory a mode, and every file the same without the right to run it."""
    for path in (outputs, *outputs.rglob("*")):
        path.chmod(mode if path.is_dir() else mode & 0o666)


def test_finished_results_of_another_are_read(fakes: None, smoke_config: Config, reader: Reader) -> None:
    """Reused and printed; where one is missing, a line says who may make it, and nothing is begun."""
    outputs = Path(smoke_config.paths.outputs)
    silent = replace(smoke_config.tracking, enabled=False)
    pipeline.run(replace(smoke_config, stage="evaluation", tracking=silent), console=Console(file=io.StringIO()))
    made = trainings(outputs)
    told = reader(*ARGUMENTS)
    warning = f"warning: nothing goes to MLflow: {outputs}/journal: Permission denied\n"
    assert (told.returncode, told.stderr) == (0, warning)
    for text in ("evaluation: reused", f"artifact: {outputs}/artifacts/evaluation/", "average"):
        assert text in told.stdout
    assert "compare runs" not in told.stdout
    other = reader(*ARGUMENTS, "tracking=none", "eta=0.4")
    place = f"{outputs}/artifacts/student"
    assert (other.returncode, other.stderr.splitlines()) == (2, [refusal(place, "student is to be made")])
    assert trainings(outputs) == made


@pytest.mark.parametrize("suffix", ["", ".partial"])
def test_a_place_that_is_no_directory_is_named_before_any_work(fakes: None, smoke_config: Config, suffix: str) -> None:
    """A link that leads nowhere, or what a process would wait for when it opens it."""
    config = replace(smoke_config, stage="teacher", tracking=replace(smoke_config.tracking, enabled=False))
    made = pipeline.run(config, console=Console(file=io.StringIO()))["teacher"]
    shutil.rmtree(made)
    place = made.with_name(made.name + suffix)
    if suffix:
        os.mkfifo(place)
    else:
        place.symlink_to("/no/such/place")
    with pytest.raises(ArtifactError, match=f"{place}: is no directory; remove it"):
        pipeline.run(config, console=Console(file=io.StringIO()))
    assert len(trainings(Path(config.paths.outputs))) == 1


def test_a_sweep_that_only_reads_needs_no_right_to_write(reader: Reader, tmp_path: Path) -> None:
    (tmp_path / "outputs" / "artifacts").mkdir(parents=True)
    told = reader("-m", "stage=verify", "speed=1,2")
    assert told.returncode == 3
    assert [line.partition(";")[0] for line in told.stderr.splitlines()] == [
        f"{tmp_path}/outputs: no finished evaluation of this configuration"
    ] * 2


def refusal(place: str, why: str) -> str:
    """The line of a place that belongs to the user of the tests."""
    user = rights.name_of(os.geteuid())
    return (
        f"{place}: {why}, and {user} may not write there; paths.outputs=DIR of your own goes elsewhere, "
        f"or ask the owner, {user}, for write permission"
    )


@pytest.fixture
def forbidden(monkeypatch: pytest.MonkeyPatch) -> set[Path]:
    """Places that the system says this user may not write to."""
    places: set[Path] = set()
    monkeypatch.setattr(os, "access", lambda path, mode, **_: Path(path) not in places)
    return places


def test_what_cannot_be_written_is_named_with_its_owner(tmp_path: Path, forbidden: set[Path]) -> None:
    """The file itself, or the directory that would have to hold it."""
    require_right(tmp_path / "a" / "b", "b is to be made")
    lock = tmp_path / "lock"
    lock.touch()
    forbidden |= {lock, tmp_path}
    for path, told in ((lock, lock), (tmp_path / "a" / "b", tmp_path)):
        with pytest.raises(ConfigurationError) as error:
            require_right(path, "b is to be made")
        assert str(error.value) == refusal(str(told), "b is to be made")
    assert rights.name_of(4_000_000_000) == "user 4000000000"


def test_what_is_damaged_and_cannot_be_set_aside_says_both(tmp_path: Path, forbidden: set[Path]) -> None:
    """The file that is damaged, and who may write there."""
    directory = tmp_path / "teacher" / "key"
    directory.mkdir(parents=True)
    forbidden.add(directory.parent)
    with pytest.raises(ConfigurationError) as error, setting_aside(directory):
        raise ArtifactError(f"{directory}/a.csv: damaged")
    why = f"{directory}/a.csv: damaged; it is to be set aside"
    assert str(error.value) == refusal(str(directory.parent), why)
    assert directory.exists()


@pytest.mark.parametrize("mode", [0o700, 0o755, 0o775, 0o2775, 0o777])
def test_whoever_may_write_beside_it_may_hold_a_lock(tmp_path: Path, mode: int) -> None:
    """The lock outlives its process, and the next one may be another user's."""
    directory = tmp_path / "teacher" / "0123456789abcdef"
    directory.parent.mkdir()
    directory.parent.chmod(mode)
    umask = os.umask(0o077)
    try:
        with exclusive(directory, say=pytest.fail, stopping=lambda: False):
            pass
    finally:
        os.umask(umask)
    assert stat.S_IMODE(lock_path(directory).stat().st_mode) == mode & 0o666


def test_the_note_of_another_owner_is_replaced(tmp_path: Path) -> None:
    """A file that this user may not write to, in a directory in which it may be removed."""
    owner = Owner(tmp_path / "key")
    owner.path.write_text("of another", encoding="utf-8")
    before = owner.path.stat().st_ino
    with owner.path.open():
        owner.sign()
        assert owner.path.stat().st_ino != before
    assert str(owner).startswith(f"process {os.getpid()} on ")


def test_a_film_goes_where_this_user_may_write(tmp_path: Path, forbidden: set[Path]) -> None:
    """Beside the results, or else where temporary files go."""
    place = tmp_path / "watch" / "key"
    assert film_directory(place, "student") == place
    forbidden.add(place)
    other = film_directory(place, "student")
    assert other.name.startswith("romgrl-watch-")
    assert not [*other.iterdir()]
    other.rmdir()
