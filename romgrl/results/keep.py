"""python -m romgrl.results.keep: keep what documents are written from, without policies and rollouts."""

from __future__ import annotations

import json
import sys
from argparse import ArgumentParser
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path

from romgrl.artifacts import MANIFEST, Manifest, read_manifest, storage_faults, write_bytes
from romgrl.config.addresses import KEPT_FILE, keeps_numbers
from romgrl.errors import ArtifactError
from romgrl.results.__main__ import exit_code, path
from romgrl.results.evaluation_index import Catalogue, artifact_place, catalogue, manifest_of, other_name, trace
from romgrl.results.kept import KEPT_TABLES, KEPT_TEXT, open_numbers
from romgrl.results.sweep_cells import located
from romgrl.results.sweep_record import JOBS, SWEEP, JobEnd, Sweep, public, public_words, read_sweep, settings, sweeps
from romgrl.runtime.display import protect


def main(arguments: Sequence[str]) -> int:
    """Keep what is there and say how much; the exit code of the failure otherwise."""
    protect()
    parser = ArgumentParser("python -m romgrl.results.keep", description="Keep the numbers of sweeps.")
    parser.add_argument("outputs", type=path, help="the directory of results, as in paths.outputs")
    parser.add_argument("place", type=path, help="the directory that keeps them, beside those of other sweeps")
    chosen = parser.parse_args(arguments)

    def work() -> str:
        jobs = keep(chosen.outputs.resolve(), chosen.place)
        return f"{chosen.place}: keeps the numbers of {jobs} finished job{'' if jobs == 1 else 's'}"

    return exit_code(work)


def keep(outputs: Path, place: Path) -> int:
    """Copy records of sweeps, manifests and tables; returns how many jobs have finished.

    All is read and verified before anything is written; what is there already must be the same, or an earlier record of
    the same sweep. Raises ArtifactError and StorageError.
    """
    require_apart(outputs, place)
    found = sweeps(outputs)
    if not found:
        raise ArtifactError(f"{outputs}: holds no sweep")
    known = catalogue(outputs)
    made = {each for sweep in found for end in finished(sweep) for each in artifacts_behind(end, outputs, known)}
    names: dict[Path, Path] = {}
    files: dict[Path, bytes] = {}
    for directory in sorted(made):
        names[directory] = name_there(open_numbers(outputs / directory, stage=directory.parent.name), place)
        if not (place / names[directory] / MANIFEST).is_file():
            tables = artifact_files(outputs / directory)
            files |= {names[directory] / name: content for name, content in tables.items()}
    for sweep in found:
        files |= record_files(sweep, outputs, place, names)
    jobs = sum(len({frozenset(settings(end.overrides).items()) for end in finished(sweep)}) for sweep in found)
    if not jobs:
        raise ArtifactError(f"{outputs}: no job of its sweeps has finished")
    with storage_faults(place):
        for file, content in {Path(KEPT_FILE): KEPT_TEXT.encode(), **files}.items():
            (place / file).parent.mkdir(parents=True, exist_ok=True)
            write_bytes(place / file, content)
    return jobs


def require_apart(outputs: Path, place: Path) -> None:
    """Raise ArtifactError unless a place is no directory of results, nor within one or around it."""
    here = place.resolve()
    if here == outputs or here in outputs.parents or outputs in here.parents:
        raise ArtifactError(f"{place}: is not allowed; allowed: a directory that is apart from {outputs}")
    if not keeps_numbers(here) and any((here / name).exists() for name in ("artifacts", "sweeps")):
        raise ArtifactError(f"{place}: holds results, not kept numbers; name another directory")


def name_there(manifest: Manifest, place: Path) -> Path:
    """Where a place keeps an artifact: other bits of the same settings are kept beside the first."""
    usual = Path("artifacts", manifest.stage, manifest.key)
    first = place / usual
    same = not (first / MANIFEST).is_file() or read_manifest(first).digest == manifest.digest
    return usual if same else usual.with_name(other_name(manifest))


def finished(sweep: Sweep) -> list[JobEnd]:
    """The ends of the jobs that ended well."""
    return [end for end in sweep.ends if end.error is None]


def artifacts_behind(end: JobEnd, outputs: Path, known: Catalogue) -> Iterator[Path]:
    """Where the artifacts of a job are, and all that these were made from. Raises ArtifactError for what is missing."""
    for place in end.artifacts.values():
        if Path(place).parent.name not in KEPT_TABLES:
            continue
        directory = located(outputs, Path(place))
        for name, several in trace(manifest_of(directory), known).items():
            if name in KEPT_TABLES and not several:
                raise ArtifactError(f"{directory}: its {name} is not there any more")
            yield from (artifact_place(outputs, each).relative_to(outputs) for each in several if name in KEPT_TABLES)


def artifact_files(directory: Path) -> dict[str, bytes]:
    """The tables of an artifact and its manifest, which goes last: what a fault cuts short counts as missing."""
    manifest = read_manifest(directory)
    patterns = KEPT_TABLES[manifest.stage]
    names = [name for name in sorted(manifest.files) if any(Path(name).match(pattern) for pattern in patterns)]
    return {name: (directory / name).read_bytes() for name in [*names, MANIFEST]}


def record_files(sweep: Sweep, outputs: Path, place: Path, names: Mapping[Path, Path]) -> dict[Path, bytes]:
    """What a sweep was asked for and how its jobs ended, without what is about a machine; names: of kept artifacts.

    Raises ArtifactError where the place has another sweep of that name, or knows more of this one.
    """
    directory = Path("sweeps", sweep.directory.name)
    ends = [plain(end, outputs, names) for end in sweep.ends]
    if (place / directory).exists():
        before = read_sweep(place / directory)
        if (before.name, before.started) != (sweep.name, sweep.started) or any(end not in ends for end in before.ends):
            raise ArtifactError(f"{place / directory}: keeps another sweep; keep {outputs} in another directory")
    document = json.loads((sweep.directory / SWEEP).read_text(encoding="utf-8"))
    document |= {"command": public(sweep.command), "jobs": [public_words(job) for job in sweep.jobs]}
    return {
        directory / JOBS: "".join(json.dumps(asdict(end)) + "\n" for end in ends).encode(),
        directory / SWEEP: (json.dumps(document, indent=1) + "\n").encode(),
    }


def plain(end: JobEnd, outputs: Path, names: Mapping[Path, Path]) -> JobEnd:
    """The end of a job, without what is about the machine that it ran on."""
    made = {stage: Path("artifacts", *Path(path).parts[-2:]) for stage, path in end.artifacts.items()}
    places = {stage: str(names.get(path, path)) for stage, path in made.items()}
    error = None if end.error is None else end.error.replace(f"{outputs}/", "")
    return replace(end, overrides=public_words(end.overrides), artifacts=places, error=error)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
