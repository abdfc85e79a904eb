"""What can go wrong, and the exit code of each."""


class RomgrlError(Exception):
    """Base of every error that ends a run with one line instead of a traceback."""

    exit_code = 1


class ConfigurationError(RomgrlError):
    """A configuration key has a value that is not allowed."""

    exit_code = 2


class ArtifactError(RomgrlError):
    """An artifact is missing, corrupted or does not fit the stage that reads it."""

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
