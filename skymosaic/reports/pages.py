"""What the reports share: their folder, and HTML from the templates beside this file, which escape every value."""

import json
from collections.abc import Mapping
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from skymosaic.errors import InputError
from skymosaic.imagery.images import save_bytes

_TEMPLATES = Environment(
    loader=FileSystemLoader(Path(__file__).parent / "templates"),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
)


def make_folder(folder: Path) -> None:
    """Make the folder of a report before the long work begins, so that a wrong name is reported at once."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made ({error.strerror}); choose another folder") from None


def render(template: str, **values: object) -> bytes:
    """Fill in a template, in UTF-8; a name that the template uses and ``values`` lacks is an error."""
    return _TEMPLATES.get_template(template).render(values).encode()


def write_report_files(folder: Path, numbers: Mapping[str, object], page: bytes) -> Path:
    """Write ``report.json`` and ``index.html``; returns the path of the latter."""
    save_bytes(folder / "report.json", (json.dumps(numbers, indent=1) + "\n").encode())
    save_bytes(folder / "index.html", page)
    return folder / "index.html"
