"""Pairs of photographs with known homographies, read from a folder; for benchmarks and experiments."""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from golden_model.arrays import Array
from skymosaic.common.errors import InputError, reading

LIST_NAME = "pairs.csv"
ELEMENTS = tuple(f"h{row}{column}" for row in range(3) for column in range(3))
COLUMNS = ("name", "group", "left", "right", *ELEMENTS)


@dataclass(frozen=True, eq=False)
class KnownPair:
    """Two files and the true homography (3, 3) from left to right pixels, pixel centres at integers."""

    name: str
    group: str
    left: Path
    right: Path
    truth: Array


def read_pairs(folder: Path) -> list[KnownPair]:
    """Read the pairs that ``folder``/pairs.csv lists.

    Its columns are name, group, left, right (files, relative to the folder) and h00 to h22, the homography by rows.

    Raises
    ------
    InputError
        If the list is missing, has no pairs, lacks a column, or contains a homography that is not nine numbers.
    """
    path = folder / LIST_NAME
    with reading(path, f"name a folder with a {LIST_NAME}"), path.open(newline="", encoding="utf-8") as file:
        reader = csv.DictReader(file)
        missing = [column for column in COLUMNS if column not in (reader.fieldnames or ())]
        if missing:
            raise InputError(f"{path}: lacks {', '.join(missing)}; its columns are {', '.join(COLUMNS)}")
        pairs = [_parse_row(folder, row, reader.line_num) for row in reader]
    if not pairs:
        raise InputError(f"{path}: lists no pair; add a line for each")
    return pairs


def list_files(folder: Path) -> list[Path]:
    """List the files of the pairs, and the list itself; raises as `read_pairs`."""
    return [folder / LIST_NAME, *(file for pair in read_pairs(folder) for file in (pair.left, pair.right))]


def _parse_row(folder: Path, row: dict[str, str], line: int) -> KnownPair:
    try:
        truth = np.array([float(row[element]) for element in ELEMENTS]).reshape(3, 3)
    except (TypeError, ValueError):
        raise InputError(f"{folder / LIST_NAME}, line {line}: h00 to h22 must be nine numbers") from None
    return KnownPair(row["name"], row["group"], folder / row["left"], folder / row["right"], truth)
