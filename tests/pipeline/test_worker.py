"""A stage in a process of its own never leaves its job waiting."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from romgrl.config.schema import Config
from romgrl.pipeline.worker import Worker, prepare
from romgrl.runtime.stage_log import SilentLog, StageLog
from tests.helpers.limits import PATIENCE


def talk(config: Config, inputs: Mapping[str, Path], output: Path, log: StageLog) -> None:
    """A stage that speaks for ever, and writes down that it was interrupted."""
    try:
        while True:
            log.message("still here")
            time.sleep(0.01)
    except KeyboardInterrupt:
        (output / "interrupted").touch()
        raise


def nothing(config: Config, inputs: Mapping[str, Path], output: Path, log: StageLog) -> None:
    """A stage that is done."""


class BrokenLog(SilentLog):
    """The voice of a job whose terminal is gone."""

    def message(self, text: str) -> None:
        raise BrokenPipeError(32, "Broken pipe")


@pytest.fixture
def worker() -> Iterator[Worker]:
    """A worker that is gone after the test, whatever happened."""
    worker = Worker()
    yield worker
    worker.kill()
    worker.close()


def test_a_log_that_fails_ends_the_stage_in_good_order(worker: Worker, smoke_config: Config, tmp_path: Path) -> None:
    """A broken pipe of the terminal is none of the worker's: its process lives, and its end is not to be waited for."""
    output = tmp_path / "teacher" / "key.partial"
    output.mkdir(parents=True)
    with ThreadPoolExecutor(1) as pool:
        ran = pool.submit(worker.run, "tests.pipeline.test_worker:talk", smoke_config, {}, output, BrokenLog())
        try:
            with pytest.raises(BrokenPipeError):
                ran.result(PATIENCE)
        finally:
            worker.kill()
    assert (output / "interrupted").exists()
    with pytest.raises(KeyboardInterrupt):  # nothing starts where what was said last is not known
        worker.run("tests.pipeline.test_worker:talk", smoke_config, {}, output, SilentLog())


def test_a_process_that_does_not_end_is_killed(
    worker: Worker, smoke_config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It has nothing to do any more; the job has."""
    monkeypatch.setattr("romgrl.pipeline.worker.ENDING_SECONDS", 0.1)
    output = tmp_path / "teacher" / "key.partial"
    output.mkdir(parents=True)
    worker.run("tests.pipeline.test_worker:nothing", smoke_config, {}, output, SilentLog())
    assert worker._process is not None
    os.kill(worker._process.pid, signal.SIGSTOP)
    worker.close()
    assert worker._process.returncode == -signal.SIGKILL


def vanishes() -> bool:
    """Whether a number below the normal ones is taken for zero."""
    return (torch.tensor([1e-38]) / 10).item() == 0.0


@pytest.fixture
def torch_as_before() -> Iterator[None]:
    """Threads, rounding and random numbers of this process are after the test what they were."""
    threads, flushed, drawn = torch.get_num_threads(), vanishes(), torch.get_rng_state()
    numbers = np.random.get_state()  # noqa: NPY002
    yield
    torch.set_num_threads(threads)
    torch.set_flush_denormal(flushed)
    torch.set_rng_state(drawn)
    np.random.set_state(numbers)  # noqa: NPY002


@pytest.mark.usefixtures("torch_as_before")
def test_every_stage_starts_alike(smoke_config: Config) -> None:
    """Whatever ran before: the random numbers of its seed, its number of threads, and numbers that vanish."""
    drawn = []
    for seed, threads in ((3, 2), (3, 1), (4, 1)):
        torch.set_flush_denormal(False)
        assert not vanishes()
        prepare(replace(smoke_config, seed=seed, threads=threads))
        assert torch.get_num_threads() == threads
        assert vanishes()
        drawn.append((torch.rand(()).item(), np.random.random()))  # noqa: NPY002
    assert drawn[0] == drawn[1]
    assert set(drawn[0]).isdisjoint(drawn[2])
