"""python -m romgrl.results.keep: keep what documents are written from, without policies and rollouts."""

from __future__ import annotations

import json
import sys
from argparse import ArgumentParser
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path

from romgrl.artifacts import MANIFEST, read_manifest, storage_faults, write_bytes
from romgrl.errors import ArtifactError
from romgrl.results.__main__ import exit_code, path
from romgrl.results.evaluation_index import Catalogue, catalogue, trace
from romgrl.results.kept import KEPT_FILE, KEPT_TABLES, KEPT_TEXT, open_numbers
from romgrl.results.sweep_record import JOBS, SWEEP, JobEnd, Sweep, public, settings, sweeps
from romgrl.runtime.display import protect


def main(arguments: Sequence[str]) -> int:
    """Keep what is there and say how much; the exit code of the failure otherwise."""
    protect()
    parser = ArgumentParser("python -m romgrl.results.keep", description="Keep the numbers of sweeps.")
    parser.add_argument("outputs", type=path, help="the directory of results, as in paths.outputs")
    parser.add_argument("place", type=path, help="the directory that keeps them, beside those of other sweeps")
    chosen = parser.parse_args(arguments)

    def work() -> str:
        jobs = keep(chosen.outputs.expanduser().resolve(), chosen.place)
        return f"{chosen.place}: keeps the numbers of {jobs} finished job{'' if jobs == 1 else 's'}"

    return exit_code(work)


def keep(outputs: Path, place: Path) -> int:
    """Copy records, manifests and tables of every finished job; how many jobs. Raises ArtifactError and StorageError.

    A manifest goes last, so that what a fault cut short counts as missing.
    """
    found = sweeps(outputs)
    if not found:
        raise ArtifactError(f"{outputs}: holds no sweep")
    with storage_faults(place):
        place.mkdir(parents=True, exist_ok=True)
        write_bytes(place / KEPT_FILE, KEPT_TEXT.encode())
        known = catalogue(outputs)
        ends = {sweep.directory: [relative(end) for end in sweep.ends if end.error is None] for sweep in found}
        for directory in sorted({way for several in ends.values() for way in ways(several, outputs, known)}):
            keep_artifact(outputs / directory, place / directory)
        for sweep in found:
            if ends[sweep.directory]:
                keep_record(sweep, ends[sweep.directory], place / "sweeps" / sweep.directory.name)
    return sum(map(len, ends.values()))


def relative(end: JobEnd) -> JobEnd:
    """The end of a job, without what is about the machine that it ran on."""
    places = {stage: "/".join(("artifacts", *Path(path).parts[-2:])) for stage, path in end.artifacts.items()}
    return replace(end, overrides=plain(end.overrides), artifacts=places)


def plain(overrides: Sequence[str]) -> list[str]:
    """The overrides that say what a job makes."""
    wanted = settings(overrides)
    return [text for text in overrides if text.lstrip("+").partition("=")[0] in wanted]


def ways(ends: Sequence[JobEnd], outputs: Path, known: Catalogue) -> Iterator[Path]:
    """Where the artifacts of jobs are, and all that these were made from."""
    for end in ends:
        for made in map(Path, end.artifacts.values()):
            if made.parent.name not in KEPT_TABLES:
                continue
            yield made
            for stage, several in trace(read_manifest(outputs / made), known).items():
                yield from (Path("artifacts", stage, each.key) for each in several if stage in KEPT_TABLES)


def keep_artifact(source: Path, target: Path) -> None:
    """Verify an artifact and copy its tables, then its manifest. Raises ArtifactError."""
    manifest = open_numbers(source, stage=source.parent.name)
    target.mkdir(parents=True, exist_ok=True)
    for name in sorted(manifest.files):
        if (source / name).is_file() and Path(name).match(KEPT_TABLES[manifest.stage] or "/"):
            write_bytes(target / name, (source / name).read_bytes())
    write_bytes(target / MANIFEST, (source / MANIFEST).read_bytes())


def keep_record(sweep: Sweep, ends: Sequence[JobEnd], target: Path) -> None:
    """What a sweep was asked for and how its finished jobs ended."""
    target.mkdir(parents=True, exist_ok=True)
    document = json.loads((sweep.directory / SWEEP).read_text(encoding="utf-8"))
    document |= {"command": public(sweep.command), "jobs": [plain(job) for job in sweep.jobs]}
    write_bytes(target / JOBS, "".join(json.dumps(asdict(end)) + "\n" for end in ends).encode())
    write_bytes(target / SWEEP, (json.dumps(document, indent=1) + "\n").encode())


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
