"""What can go wrong, and the exit code of each."""

LONGEST = 80  # characters of a value that a line shows
LONGEST_LINE = 2000


def one_line(text: str, longest: int = LONGEST) -> str:
    """Make text that came from outside fit to print: on one line, without control characters, not too long."""
    text = " ".join(text.split())
    if not text.isprintable():
        text = "".join(sign if sign.isprintable() else ascii(sign)[1:-1] for sign in text)
    return text if len(text) <= longest else f"{text[: longest - 3]}..."


class RomgrlError(Exception):
    """Base of every error that ends a run with one line instead of a traceback."""

    exit_code = 1


class ConfigurationError(RomgrlError):
    """A configuration key has a value that is not allowed."""

    exit_code = 2


class ArtifactError(RomgrlError):
    """An artifact is missing, corrupted or does not fit the stage that reads it."""

    def __init__(self, text: str) -> None:
        super().__init__(one_line(text, LONGEST_LINE))

    exit_code = 3


class DivergenceError(RomgrlError):
    """A training or a simulation left the finite numbers."""

    exit_code = 4


class TrackingError(RomgrlError):
    """The store of MLflow cannot be reached, and something is left to bring to it; nothing is lost."""

    exit_code = 3


class StorageError(RomgrlError):
    """A disk is full, read-only or broken."""

    exit_code = 5


class LaunchError(RomgrlError):
    """A job of a sweep ended without a result."""
