"""python -m romgrl.results OUTPUTS DOCS [README]: write DOCS/results.md and DOCS/results/ from the sweeps in OUTPUTS.

With README, the table of the paper's sweep replaces what stands there between `<!-- results -->` and
`<!-- end of results -->`.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from romgrl.errors import RomgrlError
from romgrl.runtime.display import protect
from romgrl.runtime.surroundings import settle


def main(arguments: Sequence[str]) -> int:
    """Write the documents and say what was written; the exit code of the failure otherwise."""
    protect()
    if len(arguments) not in (2, 3):
        print(__doc__, file=sys.stderr)
        return 2
    settle()  # before Matplotlib is imported
    from romgrl.results.readme_table import write_readme
    from romgrl.results.results_document import write_document

    outputs = Path(arguments[0]).expanduser().resolve()
    try:
        written = write_document(outputs, Path(arguments[1]))
        if len(arguments) == 3:
            write_readme(outputs, Path(arguments[2]))
    except (RomgrlError, OSError) as error:
        print(error, file=sys.stderr)
        return getattr(error, "exit_code", 5)
    print(f"{written[0]}: written, with {len(written) - 1} files in {written[0].parent / 'results'}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
