"""The page that lists finished runs, with their files, and deletes them."""

from pathlib import Path

from nicegui import ui

from golden_model.text import one_line
from skymosaic.panel.pages.page_layout import page_layout, show_files
from skymosaic.panel.session import Session


def build_runs_page(session: Session) -> None:
    """Build the list of finished runs; it is made anew whenever the page is loaded."""
    with page_layout(session, "/runs"), ui.element("section").classes("stack runs").props('aria-label="Finished runs"'):
        ui.html("Finished runs", tag="h2", sanitize=False)
        ui.label("They are kept on this machine until they are deleted.").classes("hint")
        for folder, title, finished in session.runs:
            _build_run(session, folder, title, finished)


def _build_run(session: Session, folder: Path, title: str, finished: str) -> None:
    def delete() -> None:
        if button.text == "Delete":
            button.set_text("Delete for good")
        else:
            session.runs.delete(folder.name)
            card.delete()

    with ui.element("div").classes("card") as card:
        with ui.element("div").classes("card-head"):
            ui.label(one_line(title)).classes("name")
            button = ui.button("Delete", icon="delete", on_click=delete).props("flat dense no-caps size=sm")
        ui.label(finished).classes("hint")
        show_files(f"/run/{folder.name}", folder)
