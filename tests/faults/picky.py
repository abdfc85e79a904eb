"""A store that answers, but does not take everything, and what is sent to it."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

from mlflow.exceptions import RestException

from romgrl.tracking.journal import Outbox, journal_directory, journals
from romgrl.tracking.recorder import default_uri
from romgrl.tracking.sending.sender import Sender
from romgrl.tracking.sending.store import Store
from romgrl.tracking.sending.syncing import Sync, send_all


class Picky(Store):
    """A store that fails at the requests that `refuses` picks, whenever they are sent."""

    def __init__(self, outputs: Path, error: Exception, refuses: Callable[..., bool]) -> None:
        self.told: list[str] = []
        super().__init__(default_uri(outputs), outputs, tell=lambda topic, text: self.told.append(text))
        self.error, self.refuses = error, refuses

    def request(self, method: str, *arguments: Any, **named: Any) -> Any:
        if self.refuses(method, *arguments, **named):
            raise self.error
        return super().request(method, *arguments, **named)


def send(store: Store, outputs: Path) -> list[str]:
    """Send every journal as `stage=sync` does; what was refused."""
    refused = []
    for path in journals(outputs):
        with closing(Outbox(path)) as outbox:
            sender = Sender(outbox, store, {})
            send_all(sender, store)
            refused += sender.refused
    return refused


def synced(outputs: Path, **to: str | None) -> list[tuple[str, str]]:
    """What a sync says."""
    said: list[tuple[str, str]] = []
    settings = {"uri": None, "experiment": None} | to
    Sync(lambda kind, text: said.append((kind, text)), **settings, outputs=outputs).run()
    return said


def beside(outputs: Path, suffix: str) -> list[Path]:
    return sorted(journal_directory(outputs).glob(f"*.{suffix}"))


def refused(code: str) -> RestException:
    return RestException({"error_code": code, "message": "value too long for type character varying(250)"})
