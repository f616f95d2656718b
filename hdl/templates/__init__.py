"""Texts of an export beside its netlist, as Jinja templates: test bench, README, and descriptions for tools."""

from pathlib import Path
from xml.sax.saxutils import escape

from jinja2 import Environment, FileSystemLoader, StrictUndefined

_TEMPLATES = Environment(
    loader=FileSystemLoader(Path(__file__).parent),
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
)
_TEMPLATES.filters["xml"] = escape


def render(template: str, **values: object) -> str:
    """Fill in a template of this folder; a name that is used and not given is an error."""
    return _TEMPLATES.get_template(template).render(values)
