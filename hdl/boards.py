"""The boards that can be exported for, known without loading the hardware.

A board is a Tcl file in ``constraints/boards/``: its part, clocks, DMAs and the settings of its processing system.
"""

from pathlib import Path

SOURCES = Path(__file__).parents[1] / "constraints"
"""What an export copies; in an installed wheel, data beside the package."""
BOARDS = tuple(sorted(path.stem for path in (SOURCES / "boards").glob("*.tcl")))
