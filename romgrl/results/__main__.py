"""python -m romgrl.results: write docs/results.md and the README's table from sweeps."""

from __future__ import annotations

import sys
from argparse import ArgumentParser
from collections.abc import Sequence
from pathlib import Path

from romgrl.errors import RomgrlError
from romgrl.runtime.display import protect
from romgrl.runtime.surroundings import adapt_environment


def directory(text: str) -> Path:
    """The directory that a user means."""
    return Path(text).expanduser().resolve()


def main(arguments: Sequence[str]) -> int:
    """Write the documents and say what was written; the exit code of the failure otherwise."""
    protect()
    parser = ArgumentParser("python -m romgrl.results", description="Write documents from the sweeps of a directory.")
    parser.add_argument("outputs", type=directory, help="the directory of results, as in paths.outputs")
    parser.add_argument(
        "docs",
        type=Path,
        help="where results.md goes, in place of one that is there, and results/ with the tables and figures",
    )
    readme = "a file: the table of the paper's sweep goes between its <!-- results --> and <!-- end of results -->"
    parser.add_argument("readme", type=Path, nargs="?", help=readme)
    chosen = parser.parse_args(arguments)
    adapt_environment()  # before Matplotlib is imported
    from romgrl.results.readme_table import write_readme
    from romgrl.results.results_document import write_document

    try:
        written = write_document(chosen.outputs, chosen.docs)
        if chosen.readme is not None:
            write_readme(chosen.outputs, chosen.readme)
    except (RomgrlError, OSError) as error:
        print(error, file=sys.stderr)
        return getattr(error, "exit_code", 5)
    print(f"{written[0]}: written, with {len(written) - 1} files in {written[0].parent / 'results'}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
