"""Fixtures that every test may use."""

from __future__ import annotations

import signal
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hydra.core.global_hydra import GlobalHydra

import romgrl.humanoid  # noqa: F401 - MuJoCo, before a test imports it under a MUJOCO_GL that does not work here
from romgrl.cli import compose
from romgrl.config.schema import Config
from romgrl.provenance import stage_graph
from romgrl.runtime import signals
from tests.helpers import fake_stages
from tests.helpers.jobs import Command, start
from tests.helpers.limits import PATIENCE

Composer = Callable[..., Config]


@pytest.fixture(autouse=True)
def signals_as_before() -> Iterator[None]:
    """A job that a test ran in this process leaves no signal unanswered for the next one."""
    left, handlers = set(signals._left), {number: signal.getsignal(number) for number in signals.SIGNALS}
    yield
    signals._left.clear()
    signals._left.update(left)
    for number, handler in handlers.items():
        signal.signal(number, handler)


@pytest.fixture(scope="session")
def compose_config() -> Iterator[Composer]:
    """Compose the configuration that a command line with these overrides would give."""
    yield compose.compose_config
    GlobalHydra.instance().clear()


@pytest.fixture
def smoke_config(compose_config: Composer, tmp_path: Path) -> Config:
    """The smallest configuration, on one thread, with its outputs in the test's directory."""
    return compose_config("experiment=smoke", "threads=1", f"paths.outputs={tmp_path}/outputs")


@pytest.fixture
def interrupt(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """A function that does, whatever its arguments, what a SIGINT does."""
    monkeypatch.setattr(signals, "_pending", None)
    monkeypatch.setattr(signals, "_once", False)
    return lambda *_, **__: signals._answer(signal.SIGINT, None)


@pytest.fixture
def fakes() -> Iterator[None]:
    """Replace every stage by a fake one."""
    saved = dict(stage_graph.STAGES)
    fake_stages.install()
    yield
    stage_graph.STAGES.update(saved)


@pytest.fixture
def command(tmp_path: Path) -> Command:
    """Run the command line with fake stages in a process of its own, outputs in the test's directory."""

    def execute(*arguments: str, **variables: str) -> subprocess.CompletedProcess[str]:
        if any(argument.startswith("paths.outputs=") for argument in arguments):
            process = start(*arguments, **{"HOME": str(tmp_path), **variables})
        else:
            process = start(*arguments, f"paths.outputs={tmp_path}/outputs", **variables)
        out, err = process.communicate(timeout=PATIENCE)
        return subprocess.CompletedProcess(process.args, process.returncode, out, err)

    return execute
