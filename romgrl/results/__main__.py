"""python -m romgrl.results: write docs/results.md and the README's table from sweeps."""

from __future__ import annotations

import signal
import sys
from argparse import ArgumentParser, ArgumentTypeError
from collections.abc import Callable, Sequence
from pathlib import Path

from romgrl.errors import RomgrlError, StorageError
from romgrl.runtime.display import protect
from romgrl.runtime.surroundings import adapt_environment


def path(text: str) -> Path:
    """The file or directory that a user means, which an empty text (a variable without a value) is not."""
    if not text:
        raise ArgumentTypeError("is empty; name a place")
    try:
        return Path(text).expanduser()
    except RuntimeError as error:  # ~ of nobody
        raise ArgumentTypeError(f"{text}: there is no such user") from error


def main(arguments: Sequence[str]) -> int:
    """Write the documents and say what was written; the exit code of the failure otherwise."""
    protect()
    parser = ArgumentParser("python -m romgrl.results", description="Write documents from the sweeps of a directory.")
    parser.add_argument("outputs", type=path, help="the directory of results, as in paths.outputs")
    parser.add_argument(
        "docs",
        type=path,
        help="where results.md goes, in place of one that is there, and results/ with the tables and figures",
    )
    readme = "a file: the table of the paper's sweep goes between its <!-- results --> and <!-- end of results -->"
    parser.add_argument("readme", type=path, nargs="?", help=readme)
    chosen = parser.parse_args(arguments)
    adapt_environment()  # before Matplotlib is imported
    from romgrl.results.readme_table import readme_text
    from romgrl.results.results_document import finished_sweeps, write_document

    def work() -> str:
        outputs = chosen.outputs.resolve()
        found = finished_sweeps(outputs)
        others = {} if chosen.readme is None else {chosen.readme: readme_text(found, outputs, chosen.readme)}
        written = write_document(found, outputs, chosen.docs, others)
        return f"{written[0]}: written, with {len(written) - 1} files in {written[0].parent / 'results'}"

    return exit_code(work)


def exit_code(work: Callable[[], str]) -> int:
    """Print what some work says in the end, or the line of its failure; the exit code of the program."""
    try:
        print(work())
    except RomgrlError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    except OSError as error:
        print(f"{error.filename}: {error.strerror}" if error.filename else error, file=sys.stderr)
        return StorageError.exit_code
    except KeyboardInterrupt:
        print("interrupted; what was there before is whole", file=sys.stderr)
        return 128 + signal.SIGINT
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
