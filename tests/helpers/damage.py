"""Ways to spoil an artifact: on the disk by accident, and by somebody who knows its format."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

Document = dict[str, Any]


def sign(document: Document) -> str:
    """manifest.json with the digest and the checksum that its content should have, worked out from their definition."""
    files = document["files"]
    lines = "".join(f"{name} {files[name]['sha256']}\n" for name in sorted(files))
    document["digest"] = hashlib.sha256(lines.encode()).hexdigest()
    document.pop("checksum", None)
    document["checksum"] = hashlib.sha256(json.dumps(document, indent=2, sort_keys=True).encode()).hexdigest()
    return json.dumps(document, indent=2, sort_keys=True)


def forge(directory: Path, change: Callable[[Document], object]) -> None:
    """Change the manifest and make it true to itself again."""
    path = directory / "manifest.json"
    document = json.loads(path.read_text(encoding="utf-8"))
    change(document)
    path.write_text(sign(document), encoding="utf-8")


def replace_file(directory: Path, name: str, content: bytes, arrays: Document | None = None) -> None:
    """Put other content into an artifact, and into its manifest what that content is."""
    (directory / name).write_bytes(content)
    record = {"sha256": hashlib.sha256(content).hexdigest(), "size": len(content), "arrays": arrays or {}}
    forge(directory, lambda document: document["files"].update({name: record}))
