"""Writes films with ffmpeg, a program of its own that may be missing, lack H.264, hang or die: one line says so."""

from __future__ import annotations

import os
import select
import subprocess
import threading
from collections import deque
from collections.abc import Iterable
from contextlib import suppress
from fractions import Fraction
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from romgrl.errors import RomgrlError

Image = NDArray[np.uint8]

CHOICE = "IMAGEIO_FFMPEG_EXE"  # the variable that names an ffmpeg; without it the one of imageio-ffmpeg is taken
QUALITY = "15"  # ffmpeg's constant rate factor: 0 loses nothing, 51 all
STALL_SECONDS = 60.0  # that ffmpeg may need for a picture, and at the end; a loaded machine takes one


class FilmError(RomgrlError):
    """No film can be written or read here; what needs none goes on without."""


class Encoder:
    """An ffmpeg that makes an H.264 film of pictures (height, width, 3), dt s apart. Raises FilmError."""

    def __init__(self, path: Path, size: tuple[int, int], dt: float) -> None:
        program = ffmpeg()
        raw = ["-f", "rawvideo", "-vcodec", "rawvideo", "-s", f"{size[1]}x{size[0]}", "-pix_fmt", "rgb24"]
        film = ["-an", "-vcodec", "libx264", "-pix_fmt", "yuv420p", "-crf", QUALITY, *even(size), "-v", "warning"]
        rate = str(Fraction(1.0 / dt).limit_denominator())
        try:
            self._process = subprocess.Popen(
                [program, "-y", *raw, "-r", rate, "-i", "-", *film, str(path)],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                start_new_session=True,  # the terminal's Ctrl-C is the job's to answer
            )
        except OSError as error:
            raise FilmError(f"{named(program)} does not start: {os.strerror(error.errno or 0)}") from error
        self._path, self._name = path, named(program)
        assert self._process.stdin is not None
        self._pipe = self._process.stdin.fileno()
        os.set_blocking(self._pipe, False)
        self._room = select.poll()
        self._room.register(self._pipe, select.POLLOUT)
        self._said: deque[bytes] = deque(maxlen=20)
        self._listener = threading.Thread(target=self._listen, name="ffmpeg", daemon=True)
        self._listener.start()

    def write(self, frame: Image) -> None:
        """Hand a picture over."""
        left = memoryview(frame.tobytes())
        while left:
            if not self._room.poll(STALL_SECONDS * 1000):
                raise FilmError(f"{self._name} hangs: it has taken no picture for {STALL_SECONDS:g} s")
            try:
                left = left[os.write(self._pipe, left) :]
            except BrokenPipeError as error:
                raise self._died() from error

    def finish(self) -> None:
        """Wait for the film, whole on the disk."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        if self._end() != 0 or not self._path.is_file() or self._path.stat().st_size == 0:
            raise self._died()

    def kill(self) -> None:
        """End the process, and leave nothing of its film."""
        self._process.kill()
        self._process.wait()
        with suppress(OSError):
            self._path.unlink(missing_ok=True)

    def _end(self) -> int:
        try:
            return self._process.wait(STALL_SECONDS)
        except subprocess.TimeoutExpired as error:
            raise FilmError(f"{self._name} hangs: the film has not ended for {STALL_SECONDS:g} s") from error

    def _died(self) -> FilmError:
        code = self._end()
        self._listener.join(1.0)
        lines = [line.decode(errors="replace").strip() for line in self._said]
        words = next((line for line in reversed(lines) if line), "it wrote no film")
        return FilmError(f"{self._name} ended with {code}: {words}")

    def _listen(self) -> None:
        assert self._process.stderr is not None
        with suppress(OSError, ValueError):
            self._said.extend(self._process.stderr)


def ffmpeg() -> str:
    """The ffmpeg to use. Raises FilmError where there is none."""
    import imageio_ffmpeg

    try:
        return str(imageio_ffmpeg.get_ffmpeg_exe())
    except (RuntimeError, OSError) as error:
        raise FilmError(str(error).splitlines()[0]) from error


def named(program: str) -> str:
    """A program, with the variable that chose it."""
    return f"{program} ({CHOICE})" if os.environ.get(CHOICE) == program else program


def even(size: tuple[int, int]) -> list[str]:
    """What makes height and width even, which the colours of a film ask for."""
    height, width = (side + side % 2 for side in size)
    return [] if (height, width) == size else ["-vf", f"scale={width}:{height}"]


def write_film(path: Path, frames: Iterable[Image], dt: float) -> None:
    """An H.264 film of frames (height, width, 3), shown at the pace they were simulated: dt s apart.

    Raises FilmError where none can be made; a half-written one does not stay.
    """
    remaining = iter(frames)
    first = next(remaining)
    encoder = Encoder(path, (first.shape[0], first.shape[1]), dt)
    try:
        for frame in chain((first,), remaining):
            encoder.write(frame)
        encoder.finish()
    except BaseException:
        encoder.kill()
        raise
