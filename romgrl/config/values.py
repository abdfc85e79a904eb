"""The values that a key takes, and the one line that everything else gets."""

from __future__ import annotations

import difflib
import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import Field, fields, is_dataclass
from functools import cache
from typing import Any, NamedTuple

from romgrl.config.fields import MISSING
from romgrl.config.schema import PRESETS, Config
from romgrl.errors import LONGEST, one_line

NAMES = {"int": "a whole number", "float": "a number", "str": "printable text", "bool": "true or false"}
TYPES: dict[str, tuple[type, ...]] = {"int": (int,), "float": (int, float), "str": (str, int, float), "bool": (bool,)}
LARGEST_SHOWN = 1 << 256  # Python refuses to write whole numbers of thousands of digits


class Kind(NamedTuple):
    """The type of a key: of its value, or of each entry of its list."""

    item: str
    many: bool
    optional: bool


RENAMED = {"robustness.watch": "robustness.horizon"}  # old names, which overrides may go on using


@cache
def schema_keys(schema: type = Config, prefix: str = "") -> dict[str, Field[Any]]:
    """Map every dotted key of the schema to its field; groups are walked, not listed, in all their kinds."""
    keys: dict[str, Field[Any]] = {}
    for entry in fields(schema):
        factory = entry.default_factory
        if isinstance(factory, type) and is_dataclass(factory):
            for kind in entry.metadata.get("kinds", {"": factory}).values():
                keys |= schema_keys(kind, f"{prefix}{entry.name}.")
        else:
            keys[prefix + entry.name] = entry
    return keys


def keys_of(config: Config) -> dict[str, Field[Any]]:
    """The keys that a configuration has: those of the chosen kind where a group is one of several."""
    foreign = foreign_keys(lambda key: value_of(config, key))
    return {key: entry for key, entry in schema_keys().items() if key not in foreign}


def kind_key(group: Field[Any]) -> str:
    """The key that says which keys a group has, where it is one of several, as `rom.model`; empty for others."""
    return f"{group.name}.{group.metadata['by']}" if "by" in group.metadata else ""


def first_kind(key: str) -> str:
    """What `key` says where nothing is said: the first kind of its group."""
    (group,) = (entry for entry in fields(Config) if key == kind_key(entry))
    return str(next(iter(group.metadata["kinds"])))


def of_no_kind(chosen: Callable[[str], Any]) -> set[str]:
    """The other keys of a group whose kind is none that there is: what they must be is not known."""
    keys: set[str] = set()
    for group in fields(Config):
        kinds, key = group.metadata.get("kinds", {}), kind_key(group)
        if kinds and not is_kind(chosen(key), kinds):
            keys |= {name for name in schema_keys() if name.startswith(f"{group.name}.")} - {key}
    return keys


def is_kind(value: Any, kinds: Mapping[str, type]) -> bool:
    """Tell whether a value names a kind."""
    return isinstance(value, str) and value in kinds


def foreign_keys(chosen: Callable[[str], Any]) -> dict[str, str]:
    """The keys that the chosen kind of a group lacks and others have; with each, the key that chooses.

    chosen: the value of that key; the first kind stands for one that there is not.
    """
    found: dict[str, str] = {}
    for group in fields(Config):
        kinds, key = group.metadata.get("kinds", {}), kind_key(group)
        if len(kinds) > 1:
            kind = chosen(key)
            own = schema_keys(kinds[kind if is_kind(kind, kinds) else first_kind(key)], f"{group.name}.")
            everything = (schema_keys(kind, f"{group.name}.") for kind in kinds.values())
            found |= {name: key for keys in everything for name in keys if name not in own}
    return found


def schema_groups() -> list[str]:
    """The groups of the schema, and the presets."""
    return [*key_groups(), *PRESETS]


def key_groups() -> list[str]:
    """The groups that have keys of their own."""
    return [*dict.fromkeys(name.partition(".")[0] for name in schema_keys() if "." in name)]


def as_before(key: str, value: Any) -> bool:
    """Tell whether a value of a key is what artifacts were made with before the key was there."""
    entry = schema_keys().get(key)
    before = MISSING if entry is None else entry.metadata["before"]
    return before is not MISSING and (value in before if isinstance(before, tuple) else bool(before == value))


def value_of(config: Any, key: str) -> Any:
    """Value at a dotted key."""
    for part in key.split("."):
        config = getattr(config, part)
    return config


@cache
def kind_of(entry: Field[Any]) -> Kind:
    """Read the annotation of a key, such as `float`, `list[int]` or `float | None`."""
    name = str(entry.type).removesuffix("| None").strip()
    return Kind(name.removeprefix("list[").removesuffix("]"), name.startswith("list["), str(entry.type) != name)


def allowed(entry: Field[Any]) -> str:
    """Describe the values that a key takes, as in `0 <= number <= 1` or `cpu, cuda`."""
    if entry.metadata["choices"]:
        return ", ".join(entry.metadata["choices"])
    kind = kind_of(entry)
    many = "two numbers, the lower one first" if entry.metadata["span"] else "a list of at least one"
    text = f"{many}, each {NAMES[kind.item]}" if kind.many else NAMES[kind.item]
    low, high, above = (entry.metadata[name] for name in ("low", "high", "above"))
    bounds = [f"> {shown_bound(above)}"] if above is not None else [f">= {shown_bound(low)}"] if low is not None else []
    bounds += [f"<= {shown_bound(high)}"] if high is not None else []
    text += f" {' and '.join(bounds)}" if bounds else ""
    text += f" {entry.metadata['unit']}" if entry.metadata["unit"] and bounds else ""
    return f"{text}, or null" if kind.optional else text


def shown_bound(bound: float) -> str:
    """Write a bound with all digits of a whole number below a billion billions."""
    return str(int(bound)) if bound == int(bound) and abs(bound) < 1e18 else f"{bound:g}"


def fits(value: Any, entry: Field[Any]) -> bool:
    """Tell whether a value has the type of a key, of every entry of its list, and lies in its range and choices."""
    kind = kind_of(entry)
    if value is None:
        return kind.optional
    if kind.many:
        items = isinstance(value, list) and len(value) > 0 and all(in_range(item, kind.item, entry) for item in value)
        return items and (not entry.metadata["span"] or (len(value) == 2 and value[0] <= value[1]))
    return in_range(value, kind.item, entry)


def in_range(value: Any, item: str, entry: Field[Any]) -> bool:
    """Tell whether one number, text or truth value has the type `item` and lies in the range and choices of a key."""
    if not has_type(value, item):
        return False
    low, high, above, choices = (entry.metadata[name] for name in ("low", "high", "above", "choices"))
    if item == "str":
        return str(value) in choices if choices else str(value).isprintable() and str(value).strip() != ""
    if item == "bool":
        return True
    return bool(
        abs(value) <= sys.float_info.max  # not nan either
        and (low is None or value >= low)
        and (high is None or value <= high)
        and (above is None or value > above)
    )


def has_type(value: Any, item: str) -> bool:
    """Tell whether a value has the type `item`; true and false are no numbers, 1e6 is a whole one."""
    if item == "int" and isinstance(value, float):
        return value.is_integer()
    return isinstance(value, TYPES[item]) and isinstance(value, bool) == (item == "bool")


def convert(value: Any, entry: Field[Any]) -> Any:
    """Give a value that fits the very type of its key: 4 becomes 4.0 where a number may have a fraction."""
    if isinstance(value, list):
        return [convert(item, entry) for item in value]
    item = kind_of(entry).item
    if value is None or item == "bool":
        return value
    return {"int": int, "float": float, "str": str}[item](value)


def show(value: Any) -> str:
    """Write a value as YAML would."""
    if value is None:
        return "null"
    if isinstance(value, list):
        return f"[{', '.join(map(show, value))}]"
    if isinstance(value, int) and not isinstance(value, bool) and abs(value) >= LARGEST_SHOWN:
        return f"a whole number of {value.bit_length()} bits"
    return str(value).lower() if isinstance(value, bool) else str(value)


def refusal(key: str, value: Any, permitted: str) -> str:
    """Write the one line that every bad value gets."""
    return f"{one_line(key)}: {one_line(show(value)) or repr(value)} is not allowed; allowed: {permitted}"


def bad_value(key: str, value: Any) -> str:
    """The line of a value that does not fit its key; a misspelt choice gets the nearest one."""
    entry = schema_keys()[key]
    quoted = isinstance(value, str) and kind_of(entry).item != "str" and is_plain_scalar(value)
    line = refusal(key, repr(value) if quoted else value, allowed(entry))
    if key in PRESETS and isinstance(value, dict):
        return f"{line}; the first line of a preset is `# @package _global_`"
    return line + suggestion(show(value), entry.metadata["choices"])


def is_plain_scalar(text: str) -> bool:
    """Tell whether text would be a number, a truth value or nothing, were it not quoted."""
    try:
        float(text)
    except ValueError:
        return text.lower() in ("null", "true", "false")
    return True


def suggestion(name: str, choices: Iterable[str]) -> str:
    """Ask for the choice that is close to a misspelt one, or say nothing."""
    close = difflib.get_close_matches(name[:LONGEST], list(choices), n=1)
    return f" (did you mean {close[0]}?)" if close else ""


def unknown_key(key: str, where: str = "") -> str:
    """Write the one line that an unknown key gets, with the nearest known one; `where`: " in FILE"."""
    known = [*schema_keys(), *schema_groups()]
    asked = key[:LONGEST].lower()
    group, _, leaf = asked.rpartition(".")
    siblings = {name.rpartition(".")[2]: name for name in known if name.rpartition(".")[0] == group}
    anywhere = {name.rpartition(".")[2]: name for name in reversed(schema_keys())}
    close = [siblings[name] for name in difflib.get_close_matches(leaf, siblings, n=1, cutoff=0.6)]
    close += difflib.get_close_matches(asked, schema_keys(), n=1, cutoff=0.8) if group else []
    close += [anywhere[name] for name in difflib.get_close_matches(leaf, anywhere, n=1, cutoff=0.75)]
    hint = f"did you mean {close[0]}?" if close else "--cfg job lists all keys"
    hint = f"it is called {RENAMED[key]}" if key in RENAMED else hint
    return f"{one_line(key)}{where}: unknown key; {hint}"
