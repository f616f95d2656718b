"""Files of fuzzy systems, by their suffix, and the systems that are shipped."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from skymosaic.errors import InputError
from skymosaic.fuzzy.fcl import read_fcl, write_fcl
from skymosaic.fuzzy.fll import read_fll, write_fll
from skymosaic.fuzzy.system import FuzzySystem

READERS: dict[str, Callable[[str], FuzzySystem]] = {".fll": read_fll, ".fcl": read_fcl}
WRITERS: dict[str, Callable[[FuzzySystem], str]] = {".fll": write_fll, ".fcl": write_fcl}
SHIPPED = Path(__file__).parent / "systems"
"""The thesis's three systems as FLL."""
LONGEST_BYTES = 1 << 16


def load_system(path: Path) -> FuzzySystem:
    """Read a system from an ``.fll`` or ``.fcl`` file.

    Raises
    ------
    InputError
        For a file that cannot be read, or describes no zero-order Sugeno system with one output.
    """
    read = READERS.get(path.suffix.lower())
    if read is None:
        raise InputError(f"{path}: unknown kind of file; fuzzy systems end in {', '.join(READERS)}")
    try:
        if path.stat().st_size > LONGEST_BYTES:
            raise InputError(f"{path}: larger than {LONGEST_BYTES >> 10} kB, which no system of at most 32 rules needs")
        return read(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check the path") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: is not text in UTF-8; save it as such") from None
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None
