"""A standard output or error that is missing, full or broken costs what it would have shown, never the work."""

from __future__ import annotations

import fcntl
import io
import os
import pty
import re
import select
import signal
import subprocess
import sys
import termios
from pathlib import Path
from typing import Any

import pytest

from romgrl.artifacts import storage_faults
from romgrl.cli import allowlist
from romgrl.runtime import display
from romgrl.runtime.display import Guarded
from romgrl.sweeps.launch import Labelled
from tests.helpers.jobs import ROOT, Command
from tests.helpers.limits import LONG, PATIENCE, wait_until

SAY = """
import os, subprocess, sys
sys.path.insert(0, {root!r})
from romgrl.runtime.display import protect
protect()
file = open({file!r}, "w", encoding="utf-8")
subprocess.run(["echo", "of a child"])
for _ in range(3):
    print("x" * 100_000, flush=True)
    print("said", file=sys.stderr)
print("at the end")
file.write(f"{{file.fileno() > 2}} {{os.get_inheritable(1)}} {{sys.stdout.isatty()}}")
"""
LOST = "romgrl: stdout: {}; the work goes on, what it would say is lost"
TEACHER = ("experiment=smoke", "stage=teacher", "tracking=none", "threads=1")


def shell(command: str, *arguments: str, **variables: str) -> subprocess.CompletedProcess[str]:
    """Run a line of bash, in which "$@" is this Python with arguments; its exit code is that of the first command."""
    line = ["bash", "-c", f"{command}; exit ${{PIPESTATUS[0]}}", "bash", sys.executable, *arguments]
    environment = os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"} | variables
    return subprocess.run(line, env=environment, cwd=ROOT, capture_output=True, encoding="utf-8", timeout=PATIENCE)


@pytest.mark.parametrize(
    ("redirections", "told"),
    [
        (">&-", [LOST.format("is closed"), *["said"] * 3]),
        (">/dev/full", ["echo: write error: No space left on device", LOST.format("No space left on device")]),
        ("| true", [LOST.format("Broken pipe"), *["said"] * 3]),
        ("2>&-", []),
        ("2>/dev/full", []),
        ("<&- >&- 2>&-", []),
    ],
)
def test_no_print_raises(tmp_path: Path, redirections: str, told: list[str]) -> None:
    """Nor does the last flush, which Python ends with 120 for; a file never gets the place of a missing stream."""
    file = tmp_path / "file"
    ended = shell(f'"$@" {redirections}', "-c", SAY.format(root=str(ROOT), file=str(file)))
    assert ended.returncode == 0, ended.stderr
    assert file.read_text(encoding="utf-8") == "True True False"
    lines = [line for line in ended.stderr.splitlines() if "Broken pipe" not in line or "romgrl" in line]
    assert set(told) <= set(lines)
    assert sum(line.startswith("romgrl: ") for line in lines) == sum(line.startswith("romgrl: ") for line in told)


@pytest.mark.parametrize("redirections", [">&- 2>&-", ">/dev/full", "| head -1"])
def test_jobs_go_on_without_a_display(tmp_path: Path, redirections: str) -> None:
    """A sweep of two jobs: both are made, and a full terminal is not taken for a full disk."""
    arguments = ("-m", "tests.helpers.fake_stages", "-m", *TEACHER, "seed=0,1", f"paths.outputs={tmp_path}")
    ended = shell(f'"$@" {redirections}', *arguments)
    assert ended.returncode == 0, ended.stderr
    assert len(list(tmp_path.glob("artifacts/teacher/*/manifest.json"))) == 2
    assert len(ended.stderr.splitlines()) == ("2>" not in redirections)


@pytest.mark.slow
@pytest.mark.parametrize("redirections", [">&-", ">/dev/full", "| head -1", ">/dev/full 2>&1"])
@pytest.mark.parametrize("launcher", ["joblib", "submitit_local"])
def test_jobs_of_launchers_go_on_without_a_display(tmp_path: Path, launcher: str, redirections: str) -> None:
    arguments = ("-m", "tests.helpers.fake_jobs", "-m", *TEACHER, f"hydra/launcher={launcher}", "seed=0,1")
    ended = shell(f'"$@" {redirections}', *arguments, f"paths.outputs={tmp_path}")
    assert ended.returncode == 0, ended.stderr
    assert len(list(tmp_path.glob("artifacts/teacher/*/manifest.json"))) == 2


@pytest.mark.slow
def test_stages_side_by_side_go_on_without_a_display(tmp_path: Path) -> None:
    arguments = ("experiment=smoke", "stage=evaluation", "tracking=none", "threads=2", f"paths.outputs={tmp_path}")
    ended = shell('"$@" | head -1', "-m", "tests.helpers.fake_stages", *arguments)
    assert (ended.returncode, ended.stderr) == (0, LOST.format("Broken pipe") + "\n")


@pytest.mark.parametrize("redirections", [">&-", ">/dev/full", "| true"])
def test_help_and_refusals_keep_their_exit_codes(redirections: str) -> None:
    assert shell(f'"$@" {redirections}', "-m", "romgrl", "--help").returncode == 0
    assert shell(f'"$@" {redirections} 2>/dev/full', "-m", "romgrl", "stag=teacher").returncode == 2


@pytest.fixture
def full(monkeypatch: pytest.MonkeyPatch) -> Guarded:
    """What stands for the process's own stdout and cannot take anything."""
    descriptor = os.open("/dev/full", os.O_WRONLY)
    monkeypatch.setattr(display, "STREAMS", {descriptor: "stdout", 2: "stderr"})
    return Guarded(descriptor)


def test_a_display_is_not_taken_for_the_disk(full: Guarded, tmp_path: Path) -> None:
    with storage_faults(tmp_path):
        print("a line", file=io.TextIOWrapper(full, encoding="utf-8"), flush=True)


def test_a_reader_that_is_slow_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """Another process may have set the pipe that both write to not to block."""
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    monkeypatch.setattr(display, "STREAMS", {writing: "stdout", 2: "stderr"})
    data = os.urandom(300_000)
    reader = subprocess.Popen(["sh", "-c", "sleep 0.1; cksum"], stdin=reading, stdout=subprocess.PIPE)
    os.close(reading)
    assert Guarded(writing).write(data) == len(data)
    os.close(writing)
    expected = subprocess.run(["cksum"], input=data, capture_output=True, check=True).stdout
    assert reader.communicate(timeout=PATIENCE)[0] == expected


def test_a_stream_of_others_stays(capsys: pytest.CaptureFixture[str]) -> None:
    """As those of tests and notebooks do."""
    mine = sys.stdout
    display.protect()
    assert sys.stdout is mine


def test_letters_that_a_terminal_lacks_are_replaced(full: Guarded, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(display, "ENCODING_ERRORS", {full.descriptor: display.ENCODING_ERRORS[1]})
    ascii_only = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    stream = display.guard_stream(ascii_only, full)
    assert (stream.encoding, stream.errors) == ("ascii", "replace")
    print("m², \udcff and ━━", file=stream, flush=True)
    assert Labelled(stream, "speed=1").encoding == "ascii"


def test_nohup_keeps_a_job_from_its_terminal(tmp_path: Path) -> None:
    job = subprocess.Popen(
        [sys.executable, "-m", "tests.helpers.fake_stages", *TEACHER, f"paths.outputs={tmp_path}"],
        cwd=ROOT,
        env=os.environ | {"FAKE_SECONDS": "1"},
        stdout=subprocess.PIPE,
        preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_IGN),
    )
    wait_until((tmp_path / "artifacts" / "calls.txt").exists)
    job.send_signal(signal.SIGHUP)
    assert b"teacher: done" in job.communicate(timeout=PATIENCE)[0]
    assert job.returncode == 0


def test_a_terminal_that_closes_ends_a_job_in_good_order(tmp_path: Path) -> None:
    terminal, own = pty.openpty()

    def take_terminal() -> None:
        fcntl.ioctl(own, termios.TIOCSCTTY, 0)

    job = subprocess.Popen(
        [sys.executable, "-m", "tests.helpers.fake_stages", *TEACHER, f"paths.outputs={tmp_path}"],
        cwd=ROOT,
        env=os.environ | {"FAKE_SECONDS": LONG, "TERM": "xterm"},
        stdin=own,
        stdout=own,
        stderr=own,
        start_new_session=True,
        preexec_fn=take_terminal,
    )
    os.close(own)
    wait_until((tmp_path / "artifacts" / "calls.txt").exists)
    os.close(terminal)
    assert job.wait(timeout=PATIENCE) == 128 + signal.SIGHUP
    assert list(tmp_path.glob("artifacts/teacher/*.partial"))
    assert not list(tmp_path.glob("artifacts/teacher/.*.owner"))


class Failing:
    """A callback with a bug."""

    def on_multirun_end(self, **keywords: Any) -> None:
        """Fail."""
        raise ValueError("of the callback")


def test_a_callback_that_fails_is_no_warning() -> None:
    """Hydra makes one of it, and the sweep ends with 0."""
    import hydra._internal.hydra

    allowlist.guard_hydra()
    callbacks = hydra._internal.hydra.Callbacks(None)
    callbacks.callbacks = [Failing()]
    with pytest.raises(ValueError, match="of the callback"):
        callbacks.on_multirun_end(config=None)


def test_a_sweep_without_its_tables_has_an_exit_code(command: Command, tmp_path: Path) -> None:
    sweep = tmp_path / "sweep"
    sweep.mkdir()
    (sweep / "results").write_text("in the way", encoding="utf-8")
    ended = command("-m", *TEACHER, "seed=0,1", f"hydra.sweep.dir={sweep}")
    assert ended.returncode == 5
    assert re.fullmatch(r"sweep: no tables and figures: .*results.*\n", ended.stderr)


@pytest.mark.parametrize("kind", ["pipe", "terminal"])
def test_a_reader_that_stands_still_is_passed_by(monkeypatch: pytest.MonkeyPatch, kind: str) -> None:
    """As with Ctrl-S: neither a signal nor the work waits for it; once it reads again, it sees what comes then."""
    reading, writing = os.pipe() if kind == "pipe" else pty.openpty()
    monkeypatch.setattr(display, "STREAMS", {writing: "stdout", 2: "stderr"})
    monkeypatch.setattr(display, "PATIENCE_MILLISECONDS", 1)
    stream = Guarded(writing)
    assert stream.write(b"x" * 1_000_000) == 1_000_000
    while select.select([reading], [], [], 0.1)[0]:
        os.read(reading, 65536)
    stream.write(b"again")
    assert os.read(reading, 5) == b"again"
