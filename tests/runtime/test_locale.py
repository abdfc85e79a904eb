"""Text is UTF-8 on the disk, whatever the locale, and what a terminal cannot show ends nothing."""

from __future__ import annotations

import ast
import os
from pathlib import Path

import pytest

from tests.helpers.jobs import ROOT, Command

NO_FILES = {"os", "Image", "archive"}  # whose `open` opens no text
POSITION = {"read_text": 0, "write_text": 1}  # of the encoding
C_LOCALE = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}


def leaves_it_to_the_locale(call: ast.Call) -> bool:
    """Tell whether a call reads or writes text without saying in which encoding."""
    keywords = {keyword.arg: keyword.value for keyword in call.keywords}
    method = isinstance(call.func, ast.Attribute)
    name = getattr(call.func, "attr", getattr(call.func, "id", ""))
    if "encoding" in keywords:
        return False
    if name in POSITION:
        return len(call.args) <= POSITION[name]
    if name in ("open", "fdopen"):
        if getattr(getattr(call.func, "value", None), "id", "") in NO_FILES - ({"os"} if name == "fdopen" else set()):
            return False
        mode = keywords.get("mode", next(iter(call.args[0 if method and name == "open" else 1 :]), None))
        by_default = "newline" in keywords or not method or name == "fdopen"
        return by_default if mode is None else "b" not in str(getattr(mode, "value", "b"))
    return any(getattr(keywords.get(name), "value", False) is True for name in ("text", "universal_newlines"))


@pytest.mark.parametrize("room", ["romgrl", "benchmarks", "tests"])
def test_every_text_has_an_encoding(room: str) -> None:
    """ruff's PLW1514 sees those calls only whose receiver it knows to be a path. Environments of peers are not ours."""
    found = []
    for path in sorted((ROOT / room).rglob("*.py")):
        if any(part.startswith(".") for part in path.relative_to(ROOT).parts):
            continue
        calls = [node for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(node, ast.Call)]
        found += [f"{path.relative_to(ROOT)}:{call.lineno}" for call in calls if leaves_it_to_the_locale(call)]
    assert found == []


@pytest.mark.parametrize(
    ("code", "found"),
    [
        ("a.b.read_text()", True),
        ("path.write_text(text)", True),
        ("path.open('a')", True),
        ("open(path)", True),
        ("os.fdopen(1, 'w')", True),
        ("path.open(newline='')", True),
        ("subprocess.run(command, text=True)", True),
        ("path.open('rb')", False),
        ("os.open(path, flags)", False),
        ("workspace.open()", False),
        ("path.read_text('utf-8')", False),
        ("path.write_text(text, encoding='utf-8')", False),
    ],
)
def test_the_search_itself(code: str, found: bool) -> None:
    (statement,) = ast.parse(code).body
    assert isinstance(statement, ast.Expr)
    assert isinstance(statement.value, ast.Call)
    assert leaves_it_to_the_locale(statement.value) is found


def test_a_sweep_in_a_locale_of_ascii(command: Command, tmp_path: Path) -> None:
    """Its tables have letters that the locale has not; an environment has what nobody can read."""
    variables = C_LOCALE | {"SOMETHING": os.fsdecode(b"\xff\xfe")}
    ended = command("-m", "experiment=smoke", "stage=evaluation", "tracking=none", "seed=0", **variables)
    assert (ended.returncode, ended.stderr) == (0, "")
    assert ended.stdout.isascii()
    assert "error, student [m?]" in ended.stdout  # its one table
    alone = command("experiment=smoke", "stage=evaluation", "tracking=none", "seed=0", **variables)
    assert alone.stdout.isascii()
    assert "+----" in alone.stdout  # the box of a table, as rich draws it without letters for it
    (table,) = tmp_path.glob("outputs/sweeps/*/results/table.md")
    assert "error, student [m²]" in table.read_text(encoding="utf-8")


def test_a_name_that_is_no_text_is_refused_on_a_line(command: Command) -> None:
    ended = command("stage=teacher", "tracking.experiment='" + os.fsdecode(b"a\xff") + "'")
    assert (ended.returncode, ended.stdout) == (2, "")
    assert ended.stderr == "tracking.experiment: a\\udcff is not allowed; allowed: printable text\n"
