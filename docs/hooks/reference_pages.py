"""Generates the reference pages from the code they describe: commands, options, records, presets, and blocks."""

import os
from itertools import groupby
from pathlib import Path

import click
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from typer.cli import get_docs_for_click
from typer.main import get_command

from golden_model.config import PRESETS
from golden_model.config_file import to_toml
from golden_model.feature.ilbp import PATTERNS
from golden_model.records import FRAME_STATUS, HOMOGRAPHY, MATCH, Record, feature_record
from skymosaic.cli.commands import app
from skymosaic.common.options import options_of
from skymosaic.mosaicking.options import LiveOptions, MosaicOptions
from skymosaic.registration.options import FeatureOptions, RegistrationOptions
from skymosaic.tracking.tracker import TrackerOptions

TOP = Path(__file__).parents[2]
BLOCK_PACKAGES = {"golden_model": "golden_model.md", "hdl": "hardware.md"}
"""The packages whose modules are all documented, and their pages."""
LINKED = "golden_model.records"
"""The module to which other pages lead."""
DOCUMENTED_ELSEWHERE = ("golden_model.config", "golden_model.config_file")
"""Modules with a page of their own, `docs/reference/configuration.md`."""
_TITLES = {"golden_model": "Golden model", "hdl": "Hardware"}


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the generated pages below ``reference/``."""
    pages = {
        "command_line.md": describe_commands(),
        "options.md": describe_options(),
        "records.md": describe_records(),
        "presets.md": show_presets(),
    }
    pages |= {page: list_modules(package) for package, page in BLOCK_PACKAGES.items()}
    for name, text in pages.items():
        files.append(File.generated(config, f"reference/{name}", content=text))
    return files


def describe_commands() -> str:
    """Describe every command with its arguments and options, as ``--help`` does."""
    group = get_command(app)
    context = click.Context(group, info_name="skymosaic")
    parts = [
        "# Command line\n",
        f"{group.help}\n",
        "What all commands have in common, and their exit statuses: [The command line](../how-to/command_line.md).\n",
    ]
    for name in group.list_commands(context):
        _, command, _ = group.resolve_command(context, [name])
        assert command is not None
        parts.append(get_docs_for_click(obj=command, ctx=context, indent=1, name=f"skymosaic {name}"))
    return "\n".join(parts)


def describe_options() -> str:
    """Describe every option of the library, group by group."""
    users = {
        "extract": FeatureOptions,
        "register": RegistrationOptions,
        "LiveMosaic": LiveOptions,
        "Tracker": TrackerOptions,
    }
    parts = [
        "# Options\n",
        "The fields of `skymosaic.MosaicOptions`, which are also keyword arguments of `mosaic` and `mosaics`: "
        "`mosaic(images, scale=0.5)`, or `mosaic(images, MosaicOptions(scale=0.5))`. `register` takes those of "
        "`RegistrationOptions`, `extract` those of `FeatureOptions`, `LiveMosaic` those of `LiveOptions`, `Tracker` "
        "those of `TrackerOptions`.\n",
    ]
    for group, members in groupby(options_of(MosaicOptions), key=lambda each: each.group):
        parts += [f"## {group}\n", "| option | command line | default | what it does |\n|---|---|---|---|"]
        for each in members:
            also = [f"`{user}`" for user, cls in users.items() if each.name in cls.__dataclass_fields__]
            words = [each.help, *([f"Valid: {each.valid}."] if each.valid else [])]
            words += [f"Only for more than two: {each.not_for_two}."] if each.not_for_two else []
            words += [f"Only for two photographs: {each.not_for_more}."] if each.not_for_more else []
            words += [f"Also of {', '.join(also)}."] if also else []
            flag = f"{each.flags} {each.unit_name.upper()}".rstrip()
            parts.append(f"| `{each.name}` | `{flag}` | `{each.default!r}` | {' '.join(words)} |")
        parts.append("")
    return "\n".join(parts)


def describe_records() -> str:
    """Describe the fields of every record, with their offsets."""
    descriptor_bytes = PATTERNS["ilbp-128"].bits // 8
    shown = {
        "Feature": (feature_record(descriptor_bytes), "with the descriptor `ilbp-128`"),
        "Match": (MATCH, "one for each mutual match"),
        "Frame status": (FRAME_STATUS, "one at the end of each frame"),
        "Homography": (HOMOGRAPHY, "one for each packet of matches, from builds with `--homography`"),
    }
    parts = [
        "# Records\n",
        "The accelerator sends records: little-endian, a whole number of 64-bit words, the first byte is the kind. "
        "[`golden_model.records`](golden_model.md#golden_model.records) declares them; the hardware's layouts, the "
        "NumPy dtypes and the board's driver follow from it.\n",
    ]
    for title, (record, words) in shown.items():
        parts += [f"## {title}\n", f"{words[0].upper()}{words[1:]}: {record.record_bytes} bytes.\n", _fields(record)]
    return "\n".join(parts)


def _fields(record: Record) -> str:
    rows = [f"| 0 | `tag` | 8 | {record.tag.value} |"]
    rows += [f"| {offset} | `{field.name}` | {field.bits} | |" for field, offset in record.offsets()]
    return "\n".join(("| byte | field | bits | value |", "|---|---|---|---|", *rows, ""))


def show_presets() -> str:
    """Show the two presets as the files that `--config` reads."""
    parts = ["# Presets\n", "Each preset, as a file for `--config`. What the keys mean: [Keys](configuration.md).\n"]
    for name, config in PRESETS.items():
        parts += [f"## {name}\n", f"```toml\n{to_toml(config)}```\n"]
    return "\n".join(parts)


def list_modules(package: str) -> str:
    """Write a directive for every module of a package; mkdocstrings fills it from the docstrings.

    With ``SITE_MODULES=few`` in the environment there are few, and the site is built in half the time.
    """
    modules = sorted(".".join(path.relative_to(TOP).with_suffix("").parts) for path in (TOP / package).rglob("*.py"))
    documented = [
        module for module in modules if not module.endswith("__init__") and module not in DOCUMENTED_ELSEWHERE
    ]
    if os.environ.get("SITE_MODULES") == "few":
        documented = [module for module in documented if module == LINKED or module in documented[:3]]
    return "\n\n".join([f"# {_TITLES[package]}", *(f"::: {module}" for module in documented)]) + "\n"
