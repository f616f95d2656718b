"""Which folders of this machine may be opened: those inside the roots, once links are followed."""

from collections.abc import Sequence
from pathlib import Path

from skymosaic.common.errors import InputError
from skymosaic.common.temporary import resolved
from skymosaic.imagery.folders import Listing, list_pictures
from skymosaic.imagery.patterns import is_folder, list_folder

OPEN = "open one of them"
"""What to do with the photographs of folders inside a folder."""


class Roots:
    """Folders below which photographs may be opened in place, one at least.

    Raises
    ------
    InputError
        For a root that is no folder.
    """

    def __init__(self, folders: Sequence[Path]) -> None:
        self.folders = tuple(map(resolved, folders))
        for given, folder in zip(folders, self.folders, strict=True):
            if not is_folder(folder):
                raise InputError(f"{given}: no such folder; name another with --root")

    def find_folder(self, path: str) -> Path:
        """The folder at ``path``, without links; a relative path begins at the first root.

        Raises
        ------
        InputError
            If it lies outside of the roots, whether or not it exists, or is no folder.
        """
        try:
            folder = resolved(self.folders[0] / Path(path).expanduser())
        # A name that no file system can have, or somebody's home who is unknown.
        except (OSError, ValueError, RuntimeError):
            raise InputError(f"{path!r}: no such folder; check the path") from None
        if not self._contain(folder):
            raise InputError(f"{path}: outside of what this panel may open; end it and start it with --root {path}")
        if not is_folder(folder):
            raise InputError(f"{path}: no such folder; check the path")
        return folder

    def list_folders(self, folder: Path) -> list[Path]:
        """The folders inside ``folder`` that may be opened, and first the one around it; hidden ones are left out."""
        inside = [path for path in list_folder(folder) if not path.name.startswith(".") and is_folder(path)]
        inside.sort(key=lambda path: path.name.lower())
        return [path for path in (folder.parent, *inside) if self._contain(resolved(path))]

    def list_photographs(self, folder: Path) -> Listing:
        """The photographs of a folder as every command reads it, and what else it holds.

        Raises
        ------
        InputError
            If there are none, or one is a link that leads out of the roots.
        """
        listing = list_pictures(folder)
        if not listing.pictures:
            remedy = listing.describe_unread(OPEN) or "open another folder"
            raise InputError(f"{folder}: contains no pictures; {remedy}")
        for path in listing.pictures:
            if path.is_symlink() and not self._contain(resolved(path)):
                raise InputError(f"{path}: a link that leads out of what this panel may open; remove it")
        return listing

    def _contain(self, path: Path) -> bool:
        return any(path.is_relative_to(root) for root in self.folders)
