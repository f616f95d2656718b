"""The dialog that opens a folder of this machine."""

import asyncio
from pathlib import Path

from nicegui import ui

from skymosaic.errors import InputError
from skymosaic.panel.session import Session

MAX_FOLDERS = 500
"""A folder with more folders in it shows the first ones; the others are opened by their path."""


class FolderDialog:
    """A path to type, the folders to go to from there, and the button that opens the photographs of that folder."""

    def __init__(self, session: Session) -> None:
        self._session = session
        with ui.dialog() as self._dialog, ui.card().classes("folder-dialog").props('aria-label="Open a folder"'):
            ui.html("Open a folder of this machine", tag="h2", sanitize=False)
            ui.label("Its photographs are read where they are; nothing is copied.").classes("hint")
            self._path = ui.input("Folder").props("outlined dense").classes("path")
            self._path.on("keydown.enter", lambda: self._look(self._path.value))
            self._folders = ui.element("ul").classes("folders").props('aria-label="Folders"')
            self._fault = ui.label().classes("fault").props('role="alert"')
            with ui.element("div").classes("bar"):
                ui.button("Cancel", on_click=self._dialog.close).props("flat no-caps")
                ui.button("Open", icon="folder_open", on_click=self._open).props("unelevated no-caps")

    async def show(self) -> None:
        """Open the dialog at the folder that it showed last, at first at the first root."""
        self._dialog.open()
        await self._look(self._path.value or str(self._session.roots.folders[0]))

    async def _look(self, path: str) -> None:
        """Show the folders inside the one at ``path``."""
        roots = self._session.roots
        try:
            folder = await asyncio.to_thread(roots.find_folder, path)
            inside = await asyncio.to_thread(roots.list_folders, folder)
        except InputError as error:
            self._fault.set_text(str(error))
            return
        self._fault.set_text("")
        self._path.set_value(str(folder))
        self._folders.clear()
        with self._folders:
            for each in inside[:MAX_FOLDERS]:
                self._build_folder(each, "the folder above" if each == folder.parent else each.name)

    def _build_folder(self, folder: Path, title: str) -> None:
        with ui.element("li"):
            button = ui.button(title, icon="folder", on_click=lambda: self._look(str(folder)))
            button.props("flat dense no-caps align=left")

    async def _open(self) -> None:
        try:
            await self._session.open_folder(self._path.value)
        except InputError as error:
            self._fault.set_text(str(error))
        else:
            self._dialog.close()
