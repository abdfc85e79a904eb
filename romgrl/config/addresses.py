"""Paths, addresses of databases and overrides as text: each is built and read by one rule, here."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from urllib.parse import quote, unquote, urlsplit

KEPT_FILE = "kept.txt"
SQLITE = "sqlite:///"
READ_AS_IT_IS = re.compile(r"[A-Za-z0-9_/.+@%:-]+")  # by Hydra and by a shell


def keeps_numbers(directory: Path) -> bool:
    """Tell whether a directory keeps the numbers of sweeps alone (`romgrl.results.keep`); no stage goes on from it."""
    try:
        return (directory.expanduser() / KEPT_FILE).is_file()
    except (OSError, RuntimeError):  # a name that is too long, ~ of nobody
        return False


def absolute(text: str) -> str:
    """A path with ~ expanded, as seen from the working directory; text that is no path stays what it is."""
    try:
        return str(Path(text).expanduser().absolute())
    except (OSError, RuntimeError, ValueError):  # ~ of nobody
        return text


def sqlite_address(path: Path, query: str = "", start: str = SQLITE) -> str:
    """The address of an SQLite database, with quotes for what SQLAlchemy reads as something else."""
    name = re.sub(r"[%?]", lambda sign: quote(sign[0]), str(path))
    return f"{start}{name}{query and '?'}{query}"


def with_driver(address: str) -> str:
    """The address as MLflow opens it: of a plain one it makes the directory as it is written, quotes and all."""
    return address.replace(SQLITE, "sqlite+pysqlite:///", 1) if "%" in address else address


def sqlite_path(address: str) -> Path | None:
    """The file of an SQLite database; None for the address of something else."""
    if address.partition(":")[0].partition("+")[0] != "sqlite":
        return None
    return Path(unquote(urlsplit(address, allow_fragments=False).path[1:]))


def absolute_address(address: str) -> str:
    """The address of a database whose file is named from the root; other addresses stay what they are."""
    start, path = f"{address.partition(':')[0]}:///", sqlite_path(address)
    if path in (None, Path()) or not address.startswith(start):
        return address
    return sqlite_address(Path(absolute(str(path))), urlsplit(address, allow_fragments=False).query, start)


def in_quotes(value: str) -> str:
    """Text as Hydra reads it back, whatever signs it has."""
    mark = '"' if "'" in value else "'"
    return mark + re.sub(rf"(\\*)({mark}|$)", lambda found: 2 * found[1] + (found[2] and f"\\{mark}"), value) + mark


def without_quotes(text: str) -> str:
    """The value that Hydra reads from one as it was typed, in quotes or with signs behind backslashes."""
    if len(text) < 2 or text[0] != text[-1] or text[0] not in "'\"":
        return re.sub(r"\\([\\()\[\]{}:=, \t])", r"\1", text)
    read = re.sub(rf"\\+{text[0]}", lambda found: found[0][1::2], text[1:])
    return read if text[-2] == "\\" else read[:-1]


def as_typed(key: str, value: str) -> str:
    """An override as it is typed into a shell, in quotes for Hydra and for the shell where its value needs them."""
    if READ_AS_IT_IS.fullmatch(value):
        return f"{key}={value}"
    text = f"{key}={in_quotes(value)}"
    return shlex.quote(text) if "'" in value or set(text) & set('"$`\\!') else f'"{text}"'
