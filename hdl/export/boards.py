"""The boards that can be exported for, known without loading the hardware.

A board is a Tcl file in ``constraints/boards/``: its part, family, clock and memory. The file of its family in
``constraints/systems/`` builds what surrounds the accelerator.
"""

import re
from pathlib import Path

SOURCES = next(path for path in (folder / "constraints" for folder in Path(__file__).parents[1:3]) if path.is_dir())
"""The files that an export copies: in a wheel this package's data, in the repository a folder at the top."""
BOARDS = tuple(sorted(path.stem for path in (SOURCES / "boards").glob("*.tcl")))

SERIAL_BOARD = "ulx3s"
"""A board without a processor: the accelerator is behind its serial port, and open tools build the bitstream."""
ALL_BOARDS = (*BOARDS, SERIAL_BOARD)


def check_board(board: str) -> None:
    """Raise ValueError for an unknown board, naming the valid ones."""
    if board not in ALL_BOARDS:
        raise ValueError(f"unknown board {board!r}; valid: {', '.join(ALL_BOARDS)}")


def board_facts(board: str) -> dict[str, str]:
    """Read a board's Tcl file; every board has ``part``, ``family`` and ``clock_mhz``.

    Raises
    ------
    ValueError
        For an unknown board, naming the valid ones.
    """
    check_board(board)
    # Read from the Tcl that Vivado runs, so that a board is described once.
    text = (SOURCES / "boards" / f"{board}.tcl").read_text()
    return dict(re.findall(r"^    (\w+) +\{?(.*?)\}?$", text, re.MULTILINE))
