"""What all pages share: style, header, columns, and the display of files and command lines."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from nicegui import ui

from golden_model.text import encodable
from skymosaic.panel.results import SINGLE_FILES
from skymosaic.panel.session import Session
from skymosaic.reports.pages import open_templates

PAGES = {"/": "Mosaic", "/tracking": "Tracking", "/runs": "Runs"}
LOGO = (
    '<svg viewBox="0 0 32 32" aria-hidden="true"><g fill="none" stroke-width="2.4">'
    '<rect x="4" y="9" width="16" height="14" rx="2" stroke="#38d9ff" transform="rotate(-8 12 16)"/>'
    '<rect x="13" y="9" width="16" height="14" rx="2" stroke="#ffb020" transform="rotate(7 21 16)"/></g></svg>'
)

_TEMPLATES = open_templates(Path(__file__).parent)


def fill_in(name: str, **values: object) -> str:
    """Fill in a template of this folder, which escapes every value."""
    return str(_TEMPLATES.get_template(name).render(values))


def show_command(words: str) -> None:
    """Show a command line to copy; it runs in the archive's folder of the result."""
    ui.label("The same result again, in the unpacked archive's folder:").classes("hint")
    code = ui.code(encodable(words), language="bash").classes("command")
    code.copy_button.props('aria-label="Copy the command line"')


def show_files(address: str, folder: Path) -> None:
    """Show links to the pages of a run, by their folders, and to its files, one by one."""
    with ui.element("div").classes("bar"):
        ui.label("Files:").classes("hint")
        for name in SINGLE_FILES:
            if (folder / name).exists():
                page = Path(name).parent.name
                ui.link(page or name, f"{address}/{name}", new_tab=bool(page)).classes("file")


@contextmanager
def page_layout(session: Session, path: str) -> Iterator[list[Callable[[], object]]]:
    """Build style and header of the page at ``path``; the context builds the two columns below.

    What it appends to the list is called then, and whenever something that the page shows has changed.
    """
    ui.add_css(Path(__file__).with_name("style.css"))
    ui.colors(primary="#0f6e78")
    with ui.element("header").classes("top"):
        ui.html(LOGO, sanitize=False)
        ui.html("skymosaic", tag="h1", sanitize=False)
        with ui.element("nav").props('aria-label="Pages"'):
            for target, title in PAGES.items():
                link = ui.link(title, target)
                if target == path:
                    link.props('aria-current="page"')
        ui.element("div").classes("grow")
        download = ui.button("Download everything", icon="download")
        download.props('outline dense no-caps color=white href="/archive"')
    updates: list[Callable[[], object]] = [lambda: download.set_visibility(bool(session.results))]
    with ui.element("div").classes("layout"):
        yield updates

    def update() -> None:
        for each in updates:
            each()

    session.changed.subscribe(update)
    update()
