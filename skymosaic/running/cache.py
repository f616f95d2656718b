"""The cache of features and links: an interrupted run continues where it stopped."""

import functools
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path

from golden_model.cache import Cache, cache_folder, digest
from golden_model.code_digest import digest_code
from skymosaic.common.errors import InputError

PACKAGES = ("skymosaic", "numpy", "opencv-contrib-python-headless", "scipy", "simplejpeg")
"""Packages whose versions are part of every key."""
DEFAULT_CACHE_BYTES = 2 << 30
"""About 5,000 photographs of 1280 working px; a folder that the user named has no limit."""


def open_cache(folder: Path | None, tell: Callable[[str], None]) -> Cache:
    """The cache in a folder that the user named, or the user's own, whose size is limited.

    Raises
    ------
    InputError
        If a folder that the user named cannot be created.
    """

    def note(reason: str) -> None:
        tell(f"note: features and links are not kept for the next run: {reason}")

    if folder is None:
        return Cache(cache_folder() / "flights", tell=note, limit_bytes=DEFAULT_CACHE_BYTES)
    try:
        return Cache(folder, required=True, tell=note)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made ({error.strerror}); choose another cache") from None


@functools.cache
def versions() -> dict[str, str]:
    """The versions of `PACKAGES`."""
    return {package: version(package) for package in PACKAGES}


def key_of(compute: Callable[..., object], *parts: object) -> str:
    """A file name for what the function ``compute``, as its code is now, makes of ``parts`` (by their ``repr``)."""
    how = compute.__qualname__, digest_code(compute.__module__), versions()
    return digest(repr((how, parts)))
