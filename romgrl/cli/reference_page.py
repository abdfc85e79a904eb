"""Writes docs/configuration.md from the schema and conf/: python -m romgrl.cli.reference_page."""

from __future__ import annotations

import sys
from argparse import ArgumentParser
from collections.abc import Sequence
from dataclasses import Field, fields
from pathlib import Path
from typing import Any

from romgrl.cli.compose import compose_config
from romgrl.cli.config_files import CONF
from romgrl.cli.exit_codes import exit_code_of
from romgrl.config.schema import PRESETS, Config
from romgrl.config.values import allowed, keys_of, kind_key, schema_keys, show, value_of
from romgrl.report.markdown_table import markdown_table

REFERENCE_PAGE = Path(__file__).resolve().parents[2] / "docs" / "configuration.md"
REFERENCE_HEAD = """# Configuration

Every key with its unit, the values it takes and its default. Set keys on the command line as `key=value`, and groups as
`group=choice`; `python -m romgrl --cfg job` prints the result. Written from the schema by `make docs`: edit
`romgrl/config/` (schema.py, worlds.py, learners.py: meaning, unit, range) or `conf/` (values) instead.
"""


def render() -> str:
    """The whole page as Markdown."""
    config = compose_config()
    keys = schema_keys()
    groups = list(dict.fromkeys(name.rpartition(".")[0] for name in keys))
    return "\n".join([REFERENCE_HEAD, *(group_section(group, keys, config) for group in groups)])


def group_section(group: str, keys: dict[str, Field[Any]], config: Config) -> str:
    """One group: what it is, its choices, and a table of its keys."""
    lines = [f"## {group or 'Top level'}", "", *docs_of(group, config), ""]
    for chosen in [group] if group else PRESETS:
        choices = sorted(path.stem for path in (CONF / chosen).glob("*.yaml"))
        lines += [f"Choices of `{chosen}`: {', '.join(choices)}.", ""] if choices else []
    rows = []
    for name, entry in keys.items():
        if name.rpartition(".")[0] == group:
            default = show(value_of(config, name)) if name in keys_of(config) else f"needs {kinds_with(name)}"
            unit = entry.metadata["unit"]
            cells = (
                f"`{name}`",
                entry.metadata["doc"],
                unit,
                allowed(entry).replace(f" {unit}", "", 1) if unit else allowed(entry),
                f"`{default.removeprefix(f'{Path.cwd()}/')}`",
            )
            rows.append(cells)
    return "\n".join([*lines, markdown_table(("key", "meaning", "unit", "values", "default"), rows)])


def docs_of(group: str, config: Config) -> list[str]:
    """What a group is; where it is one of several kinds, what each of them is, by the key that chooses it."""
    several = [entry for entry in fields(Config) if entry.name == group and len(entry.metadata.get("kinds", ())) > 1]
    if not several:
        return [doc_of(type(getattr(config, group)) if group else Config)]
    (entry,) = several
    return [f"- `{kind_key(entry)}={kind}`: {doc_of(each)}" for kind, each in entry.metadata["kinds"].items()]


def doc_of(group: type) -> str:
    """The docstring of a group of keys, on one line."""
    return " ".join((group.__doc__ or "").split())


def kinds_with(key: str) -> str:
    """The choices of the key that decides whether a group has `key`, as in `rom.model=spring_leg`."""
    group = next(entry for entry in fields(Config) if key.startswith(f"{entry.name}."))
    kinds = [kind for kind, keys in group.metadata["kinds"].items() if key.rpartition(".")[2] in schema_keys(keys)]
    return f"{kind_key(group)}={'|'.join(kinds)}"


def main(arguments: Sequence[str]) -> int:
    """Write the page; the exit code of the failure otherwise."""
    what = "Write docs/configuration.md of this checkout from the schema and conf/."
    ArgumentParser("python -m romgrl.cli.reference_page", description=what).parse_args(arguments)
    try:
        REFERENCE_PAGE.write_text(render(), encoding="utf-8")
    except OSError as error:
        return exit_code_of(error)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
