"""Folder, files and HTML of the reports; the templates beside this file escape every value."""

import contextlib
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from golden_model.text import encodable
from skymosaic.common.errors import InputError
from skymosaic.common.later import Later
from skymosaic.common.provenance import to_json
from skymosaic.common.temporary import PAGE, staged_folder
from skymosaic.imagery.images import save_bytes

OWN_NAMES = (
    rf"{re.escape(PAGE)}|report\.json|mosaic(_\d+)?\.jpg|corners_(left|right)\.png|matches\.png"
    r"|(footprints_\d+|fly_again)\.(geojson|kml)|mask\.png"
)
"""Regular expression of the names of a mosaic report's files."""
jinja2 = Later("jinja2")


def open_templates(folder: Path) -> Any:
    """The templates of a folder; they escape every value, and a name that is used and not given is an error."""
    return jinja2.Environment(
        loader=jinja2.FileSystemLoader(folder),
        autoescape=True,
        # Not the markup of a macro, whose values are finalized already.
        finalize=lambda value: encodable(value) if type(value) is str else value,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )


@contextlib.contextmanager
def staged_report(folder: Path) -> Iterator[Path]:
    """Stage a report: at the end, the files in the yielded folder replace those of an earlier report in ``folder``.

    Raises
    ------
    InputError
        If it cannot be written.
    """
    try:
        with staged_folder(folder, OWN_NAMES) as staged:
            try:
                yield staged
            except InputError as error:
                raise InputError(str(error).replace(str(staged), str(folder))) from None
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror}); choose another folder") from None


def list_own_pictures(folder: Path) -> list[Path]:
    """List the pictures of a report."""
    return [path for path in folder.glob("*.[jp][pn]g") if re.fullmatch(OWN_NAMES, path.name)]


def render(template: str, **values: object) -> bytes:
    """Fill in a template of this folder, in UTF-8."""
    return str(open_templates(Path(__file__).parent / "templates").get_template(template).render(values)).encode()


def write_report_files(folder: Path, numbers: Mapping[str, object], page: bytes) -> None:
    """Write ``report.json`` and ``index.html``."""
    save_bytes(folder / "report.json", to_json(numbers))
    save_bytes(folder / PAGE, page)
