"""Texts of a block's export, as Jinja templates: its test bench, its README, and its description for FuseSoC."""

from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

_TEMPLATES = Environment(
    loader=FileSystemLoader(Path(__file__).parent),
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
)


def render(template: str, **values: object) -> str:
    """Fill in a template of this folder; a name that is used and not given is an error."""
    return _TEMPLATES.get_template(template).render(values)
