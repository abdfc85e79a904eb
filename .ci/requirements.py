"""Print what the package and its developers need, one requirement a line, without the package itself."""

import re
import sys
import tomllib
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[1] / "pyproject.toml"


def main() -> None:
    """Requirements of the build, of the package and of the named extras, with those that these name."""
    document = tomllib.loads(PROJECT.read_text(encoding="utf-8"))
    project = document["project"]
    waiting = [*document["build-system"]["requires"], "cmake", "ninja", *project["dependencies"]]
    waiting += [f"{project['name']}[{extra}]" for extra in sys.argv[1:]]
    found: dict[str, None] = {}
    while waiting:
        requirement = waiting.pop(0)
        own = re.fullmatch(rf"{project['name']}\[(.*)\]", requirement)
        if own is None:
            found[requirement] = None
        else:
            for extra in own[1].split(","):
                waiting += project["optional-dependencies"][extra.strip()]
    print("\n".join(found))


if __name__ == "__main__":
    main()
