"""Where a stage runs: in this process, or in a worker, a process of its own that reports over a pipe."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path

from filelock import FileLock

from romgrl.artifacts import lock_mode, storage_faults
from romgrl.config.schema import Config
from romgrl.errors import RomgrlError
from romgrl.runtime import signals
from romgrl.runtime.display import protect
from romgrl.runtime.functions import load_function
from romgrl.runtime.stage_log import StageLog

Runner = Callable[[str, Config, Mapping[str, Path], Path, StageLog], None]

PROGRESS_INTERVAL = 0.2  # seconds between reports of a worker, about as often as the bar is drawn
ENDING_SECONDS = 60.0  # that a process may need to end once it has closed its pipe, or nothing is left for it to do


def execute(entry: str, config: Config, inputs: Mapping[str, Path], output: Path, log: StageLog) -> None:
    """Run the stage function `module:function` in this process."""
    # Read when torch is imported; threads that spin while they wait are slow on cores that others use, too.
    os.environ["OMP_NUM_THREADS"] = str(config.threads)
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    prepare(config)
    with storage_faults(output):
        load_function(entry)(config, inputs, output, log)


def prepare(config: Config) -> None:
    """Seed torch and numpy and set torch's threads and rounding, the same before every stage."""
    import numpy as np
    import torch

    torch.manual_seed(config.seed)
    np.random.seed(config.seed)  # noqa: NPY002 - no stage here draws from it; one of your own may, and scipy with it
    torch.set_num_threads(config.threads)
    torch.set_flush_denormal(True)  # vanishing gradients cost up to 30 times the time


class Worker:
    """A process that runs one stage after the other; it starts with the first. Threads may share one."""

    def __init__(self) -> None:
        self._lifeline: int | None = None  # the process ends as soon as nobody holds this end of a pipe
        self._process: subprocess.Popen[bytes] | None = None
        self._connection: Connection | None = None
        self._stopped = False
        self._starting = threading.Lock()

    def run(self, entry: str, config: Config, inputs: Mapping[str, Path], output: Path, log: StageLog) -> None:
        """Run a stage to its end and pass on what it says; raises what it raised.

        Where the log fails, its failure is raised once the stage has been interrupted and has ended in good order.
        """
        connection = self._start()
        with self._reached(output.parent.name):
            connection.send((entry, config, dict(inputs), output))
        while True:
            with self._reached(output.parent.name):
                message = connection.recv()
            if message is None:
                return
            if isinstance(message, BaseException):
                raise message
            method, arguments, numbers = message
            try:
                getattr(log, method)(*arguments, **numbers)
            except BaseException:
                self._abandon(connection)
                raise

    def stop(self) -> None:
        """Interrupt the stage, which ends in good order; no other one starts here."""
        with self._starting:
            self._stopped = True
            if self._process is not None and self._process.poll() is None:
                self._process.terminate()

    def close(self) -> None:
        """End the process, which has nothing to do any more."""
        if self._connection is not None:
            self._connection.close()
        self._wait()
        if self._lifeline is not None:
            os.close(self._lifeline)
            self._lifeline = None

    def kill(self) -> None:
        """End the process at once."""
        if self._process is not None:
            self._process.kill()

    def _start(self) -> Connection:
        with self._starting:
            if self._stopped:
                raise KeyboardInterrupt
            if self._connection is None:
                self._connection, remote = Pipe()
                lifeline, self._lifeline = os.pipe()
                self._process = subprocess.Popen(
                    [sys.executable, "-m", "romgrl.pipeline.worker", str(remote.fileno()), str(lifeline)],
                    pass_fds=[remote.fileno(), lifeline],
                    start_new_session=True,  # the terminal's Ctrl-C comes to the pipeline alone, which passes it on
                )
                remote.close()
                os.close(lifeline)
            return self._connection

    @contextmanager
    def _reached(self, stage: str) -> Iterator[None]:
        """Use the pipe; where it breaks, the process has ended. Nothing but the pipe may fail inside."""
        try:
            yield
        except (EOFError, OSError) as error:
            if self._stopped:
                raise KeyboardInterrupt from None
            code = self._wait()
            status = signal.Signals(-code).name if code < 0 else f"exit code {code}"
            raise RomgrlError(f"{stage}: its process ended with {status}") from error

    def _abandon(self, connection: Connection) -> None:
        """Interrupt a stage whose words nobody takes any more, and hear it out: it waits for a full pipe."""
        self.stop()
        with suppress(EOFError, OSError):
            while isinstance(connection.recv(), tuple):
                pass

    def _wait(self) -> int:
        """The exit code of the process, which is about to end; one that does not is killed."""
        if self._process is None:
            return 0
        try:
            return self._process.wait(ENDING_SECONDS)
        except subprocess.TimeoutExpired:
            self._process.kill()
            return self._process.wait()


class PipeLog:
    """The StageLog of a worker: the pipeline's own log says and records everything."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._last_progress = 0.0

    def progress(self, step: int, total: int, **numbers: float) -> None:
        now = time.monotonic()
        if now - self._last_progress >= PROGRESS_INTERVAL:
            self._last_progress = now
            shown = {name: float(value) for name, value in numbers.items()}
            self._connection.send(("progress", (step, total), shown))

    def metrics(self, values: Mapping[str, float], step: int) -> None:
        self._connection.send(("metrics", ({name: float(value) for name, value in values.items()}, step), {}))

    def resumed(self, step: int) -> None:
        self._connection.send(("resumed", (step,), {}))

    def message(self, text: str) -> None:
        self._connection.send(("message", (text,), {}))


def serve(connection: Connection) -> None:
    """Run the stages that come over the pipe, and say after each how it ended: None is well. Ends when interrupted."""
    while True:
        try:
            entry, config, inputs, output = connection.recv()
        except EOFError:
            return
        outcome: BaseException | None = None
        try:
            signals.raise_pending()  # the first signal, which came when nothing was left to interrupt
            with working_lock(output):
                execute(entry, config, inputs, output, PipeLog(connection))
        except (KeyboardInterrupt, RomgrlError) as error:
            outcome = error
        except Exception:
            outcome = RuntimeError(f"in the process of the stage:\n{traceback.format_exc()}")
        connection.send(outcome)
        if isinstance(outcome, KeyboardInterrupt):
            return


def working_lock(output: Path) -> FileLock:
    """Held by a worker while it writes to a workspace: a killed pipeline's lock is free before its worker is gone."""
    return FileLock(output.with_name(f".{output.name}.lock"), mode=lock_mode(output.parent))


def end_with_pipeline(lifeline: int) -> None:
    """Die as soon as the pipeline has: whoever makes the stage next must be alone."""
    os.read(lifeline, 1)
    os.kill(os.getpid(), signal.SIGKILL)


def main() -> None:
    """Serve the pipe of the first file descriptor for as long as somebody holds the other end of the second."""
    protect()
    threading.Thread(target=end_with_pipeline, args=[int(sys.argv[2])], daemon=True).start()
    signals.listen(once=True)
    try:
        serve(Connection(int(sys.argv[1])))
    except (KeyboardInterrupt, OSError):  # stopped while idle, or the pipeline is gone
        sys.exit(130)


if __name__ == "__main__":
    main()
