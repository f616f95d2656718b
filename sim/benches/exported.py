"""Imports the host programs of an export unchanged, to run them over a simulated bus."""

import contextlib
import importlib
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

from hdl.build import Build
from hdl.export.host import write_host


@contextlib.contextmanager
def host_programs(build: Build) -> Iterator[Callable[[str], ModuleType]]:
    """Write the programs for a build; inside the context they can be imported by name."""
    with tempfile.TemporaryDirectory() as folder:
        write_host(Path(folder), build)
        names = [path.stem for path in Path(folder).glob("*.py")]
        sys.path.insert(0, folder)
        try:
            yield importlib.import_module
        finally:
            sys.path.remove(folder)
            for name in names:
                sys.modules.pop(name, None)
