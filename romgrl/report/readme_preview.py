"""The looping picture of the README: `make preview` makes it from the films of the newest report."""

from __future__ import annotations

import io
import sys
from collections.abc import Sequence
from pathlib import Path

import imageio_ffmpeg
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from romgrl.artifacts import open_artifact
from romgrl.errors import ArtifactError, RomgrlError
from romgrl.report.encoder import FilmError, ffmpeg, named
from romgrl.report.side_by_side_film import FILM
from romgrl.runtime.display import protect

LARGEST = 1_500_000  # bytes
WIDTH = 720  # pixels
LOOP_SECONDS = (1.0, 3.0)  # between these lies the length of the loop
QUALITIES = (80, 65, 50, 35, 20)

Frames = NDArray[np.uint8]


def newest_film(outputs: Path) -> Path:
    """The film of the newest report that is whole. Raises ArtifactError where there is none."""
    found = sorted(outputs.glob(f"artifacts/report/*/{FILM}"), key=lambda path: path.stat().st_mtime)
    if not found:
        raise ArtifactError(f"{outputs}/artifacts/report: no finished report with {FILM}; python -m romgrl makes one")
    open_artifact(found[-1].parent, stage="report", key=found[-1].parent.name)
    return found[-1]


def read_film(path: Path) -> tuple[Frames, float]:
    """Pictures (T, height, width, 3) of a film, and their number per second. Raises FilmError."""
    program = ffmpeg()
    try:
        reader = imageio_ffmpeg.read_frames(str(path))
        facts = next(reader)
        width, height = facts["size"]
        pictures = [np.frombuffer(each, np.uint8).reshape(height, width, 3) for each in reader]
    except (OSError, RuntimeError) as error:
        lines = [line.strip() for line in str(error).splitlines() if line.strip() and not line.startswith("===")]
        raise FilmError(
            f"{path}: cannot be read with {named(program)}: {lines[-1] if lines else 'no reason'}"
        ) from error
    if not pictures:
        raise FilmError(f"{path}: {named(program)} finds no picture in it")
    return np.stack(pictures), float(facts["fps"])


def loop(frames: Frames, rate: float) -> Frames:
    """The end of a film, as long as makes its first picture follow its last with the least jump."""
    small = frames[:, ::8, ::8].astype(np.float32)
    first, last = (round(seconds * rate) for seconds in LOOP_SECONDS)
    lengths = range(min(first, len(frames) - 1), min(last, len(frames) - 1) + 1)
    jumps = [float(np.abs(small[-1] - small[-1 - length]).mean()) for length in lengths]
    return frames[len(frames) - lengths[int(np.argmin(jumps))] :]


def animation(frames: Frames, rate: float) -> bytes:
    """An animated WebP that loops for ever, in the best of QUALITIES that is not too large. Raises ArtifactError."""
    step = 2 if rate > 20 else 1
    height = round(WIDTH * frames.shape[1] / frames.shape[2])
    images = [Image.fromarray(frame).resize((WIDTH, height), Image.Resampling.LANCZOS) for frame in frames[::step]]
    for quality in QUALITIES:
        data = io.BytesIO()
        shown = round(1000 * step / rate)
        images[0].save(
            data, "WEBP", save_all=True, append_images=images[1:], duration=shown, loop=0, quality=quality, method=4
        )
        if data.tell() <= LARGEST:
            return data.getvalue()
    raise ArtifactError(f"{len(images)} pictures do not fit into {LARGEST:,} bytes")


def main(arguments: Sequence[str]) -> None:
    """Write the animation of the newest report under the first argument to the second."""
    protect()
    outputs, target = map(Path, arguments)
    try:
        film = newest_film(outputs)
        frames, rate = read_film(film)
        data = animation(loop(frames, rate), rate)
    except RomgrlError as error:
        print(error, file=sys.stderr)
        sys.exit(error.exit_code)
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_bytes(data)
    print(f"{target}: {len(data) / 1e6:.2f} MB from {film}")


if __name__ == "__main__":
    main(sys.argv[1:])
