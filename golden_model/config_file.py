"""Configurations as TOML files, which change values of a preset."""

import dataclasses
import re
import tomllib
from pathlib import Path
from typing import Any

from golden_model.config import Config, preset_config
from golden_model.fuzzy.fll import SUFFIXES
from golden_model.fuzzy.rules import MatchRules, load_rules
from golden_model.small_files import read_small_file

TABLES = ("front_end", "matcher")
"""The tables of a configuration file."""


def load_config(path: str | Path, preset: str = "aerial") -> Config:
    """Read a configuration from a TOML file.

    The file changes values of a preset in the tables ``[front_end]`` and ``[matcher]``. The preset is the one that the
    file names under ``preset``, otherwise the argument.

    Raises
    ------
    ValueError
        If the file cannot be read, is not TOML, or has an unknown key or an impossible value. The message is one line
        with the file, the key and the valid values.
    """
    try:
        tables = tomllib.loads(read_small_file(path).decode("utf-8-sig"))
        _read_rules(tables, Path(path))
        config = preset_config(tables.pop("preset", preset))
        _check_keys("", tables, ("preset", *TABLES))
        changed = {name: _replace_values(name, getattr(config, name), values) for name, values in tables.items()}
        return dataclasses.replace(config, **changed)
    except OSError as error:
        raise ValueError(f"{path}: cannot be read ({error.strerror}); give a TOML file") from error
    # RecursionError: arrays that are nested hundreds of times.
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ValueError(f"{path}: not valid TOML: {error}") from error
    # Last, because TOMLDecodeError is a ValueError, too.
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def to_toml(config: Config) -> str:
    """TOML text from which `load_config` restores these tables; values that are None are omitted."""
    lines = [f"preset = {_toml_value(config.preset)}"]
    for table in TABLES:
        values = vars(getattr(config, table))
        lines += ["", f"[{table}]"]
        lines += [f"{key} = {_toml_value(value)}" for key, value in values.items() if value is not None]
    return "\n".join(lines) + "\n"


def _read_rules(tables: dict[str, Any], path: Path) -> None:
    """Replace a rule base that is FLL, or an ``.fll`` or ``.fis`` file beside the configuration, by its rules."""
    matcher = tables.get("matcher")
    if type(matcher) is not dict or type(written := matcher.get("rule_base")) is not str:
        return
    if "\n" in written:
        matcher["rule_base"] = MatchRules(written, "matcher.rule_base")
    elif written.endswith(SUFFIXES):
        matcher["rule_base"] = load_rules(path.parent / written)


def _replace_values(table: str, defaults: Any, values: Any) -> Any:
    """A copy of the dataclass instance ``defaults`` with the ``values`` of a table of the file."""
    if type(values) is not dict:
        raise ValueError(f"{table} is {values!r}; it must be a table, [{table}]")
    _check_keys(f"{table}.", values, tuple(field.name for field in dataclasses.fields(defaults)))
    try:
        return dataclasses.replace(defaults, **values)
    except ValueError as error:
        raise ValueError(f"{table}.{error}") from error


def _check_keys(prefix: str, values: dict[str, Any], known: tuple[str, ...]) -> None:
    for key in values:
        if key not in known:
            raise ValueError(f"unknown key {prefix}{key}; valid: {', '.join(known)}")


def _toml_value(value: bool | int | str | MatchRules) -> str:
    if isinstance(value, MatchRules):
        # Escaped are what ends or changes a string of several lines.
        text = re.sub(r'[\\"\x00-\x08\x0b-\x1f\x7f]', lambda found: f"\\u{ord(found[0]):04x}", value.text)
        return f'"""\n{text}"""'
    if isinstance(value, bool):
        return str(value).lower()
    return f'"{value}"' if isinstance(value, str) else str(value)
