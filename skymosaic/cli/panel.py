"""The command that serves the front panel."""

import importlib
import sys
import threading
import webbrowser
from pathlib import Path
from typing import Annotated

import typer
from platformdirs import user_data_path

from skymosaic.cli.session import session


def panel(
    port: Annotated[int, typer.Option(min=0, max=65535, help="0 takes any free port.")] = 8080,
    board: Annotated[list[str] | None, typer.Option(help="HOST[:PORT] of a board that may be chosen.")] = None,
    root: Annotated[
        list[Path] | None, typer.Option(help="Folder whose photographs may be opened in place; default: your home.")
    ] = None,
    runs: Annotated[
        Path | None, typer.Option(help="Folder of finished runs; default: in your data folder.", show_default=False)
    ] = None,
    browser: Annotated[bool, typer.Option(help="Open the page in a browser, when started on a terminal.")] = True,
) -> None:
    """Serve the front panel, a web page for this machine only: choose, run, and see why."""
    # NiceGUI is an extra, and takes a second to import: only this command needs it.
    server = importlib.import_module("skymosaic.panel.server")

    def announce(address: str, note: str) -> None:
        if note:
            session.warn(note)
        session.numbers["address"] = address
        session.show(f"the panel is at {address} (Ctrl-C ends it)")
        if browser and sys.stdout.isatty():
            # A browser that runs in the terminal would keep the server waiting.
            threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()
        # Before the server runs for hours: with --json, whoever started it wants the address now.
        session.end(0)
        sys.stdout.flush()

    boards = tuple(f"board:{address}" for address in board or ())
    kept = runs or user_data_path("skymosaic", appauthor=False) / "runs"
    server.serve(port, boards, root or [Path.home()], kept, announce)
