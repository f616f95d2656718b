"""The project's folder in the user's cache: compiled simulators, and features of flights."""

from contextlib import suppress
from pathlib import Path

from platformdirs import user_cache_path


def cache_folder() -> Path:
    """The project's folder in the user's cache: on Linux in ``XDG_CACHE_HOME``, or ``~/.cache`` if that is not set."""
    return user_cache_path("skymosaic", appauthor=False)


def make_private(folder: Path) -> None:
    """Create a folder for its owner alone, or make it so: who can write to builds can run code as their owner."""
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    # It may be another user's.
    with suppress(OSError):
        folder.chmod(0o700)
