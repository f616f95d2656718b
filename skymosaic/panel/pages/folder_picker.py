"""What opens a folder of this machine: a path to type, and the folders to go to from there."""

import asyncio
from functools import partial
from pathlib import Path

from nicegui import ui

from golden_model.text import one_line
from skymosaic.common.errors import InputError
from skymosaic.panel.inputs import Inputs

MAX_FOLDERS = 500
"""A folder with more folders in it shows the first ones; the others are opened by their path."""


class FolderPicker:
    """A part of the page that unfolds, with the button that opens the photographs of the folder it shows."""

    def __init__(self, inputs: Inputs) -> None:
        self._inputs = inputs
        self._shown = Path()
        with ui.expansion("Open a folder", icon="folder_open", on_value_change=self._unfold) as self._expansion:
            self._path = ui.input("Folder").props("outlined dense")
            self._path.on("keydown.enter", lambda: self._look(self._chosen))
            self._folders = ui.element("ul").classes("folders").props('aria-label="Folders"')
            self._fault = ui.label().classes("fault").props('role="alert"')
            ui.button("Open", on_click=self._open).props("outline no-caps")
            ui.label("Photographs are read where they are; nothing is copied.").classes("hint")
        self._expansion.classes("advanced folder-picker")

    @property
    def _chosen(self) -> str:
        """The path in the field; that of the folder shown need not be text in UTF-8, and is not read from there."""
        typed = str(self._path.value)
        return str(self._shown) if typed == one_line(str(self._shown)) else typed

    async def _unfold(self) -> None:
        """Show the first root, unless another folder was shown before."""
        if self._expansion.value and not self._path.value:
            await self._look(str(self._inputs.roots.folders[0]))

    async def _look(self, path: str) -> None:
        """Show the folders inside the one at ``path``."""
        roots = self._inputs.roots
        try:
            folder = await asyncio.to_thread(roots.find_folder, path)
            inside = await asyncio.to_thread(roots.list_folders, folder)
        except InputError as error:
            self._fault.set_text(str(error))
            return
        self._fault.set_text("")
        self._shown = folder
        self._path.set_value(one_line(str(folder)))
        self._folders.clear()
        with self._folders:
            for each in inside[:MAX_FOLDERS]:
                title = "the folder above" if each == folder.parent else one_line(each.name)
                with ui.element("li"):
                    button = ui.button(title, icon="folder", on_click=partial(self._look, str(each)))
                    button.props("flat dense no-caps align=left")

    async def _open(self) -> None:
        try:
            await self._inputs.open_folder(self._chosen)
        except InputError as error:
            self._fault.set_text(str(error))
        else:
            self._fault.set_text("")
            self._expansion.set_value(False)
