"""Imports the host programs of an export unchanged, to run them over a simulated bus."""

import contextlib
import importlib
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Literal, Unpack

from golden_model.config import Config
from hdl.export.accelerator import Build, write_host


@contextlib.contextmanager
def host_programs(
    kind: Literal["pynq", "serial", "live"], config: Config, **build: Unpack[Build]
) -> Iterator[Callable[[str], ModuleType]]:
    """Write the programs for a build; inside the context they can be imported by name.

    Parameters
    ----------
    kind : {"pynq", "serial", "live"}
    config, **build
        As for `hdl.export.accelerator.export`.
    """
    with tempfile.TemporaryDirectory() as folder:
        write_host(Path(folder), kind, config, **build)
        names = [path.stem for path in Path(folder).glob("*.py")]
        sys.path.insert(0, folder)
        try:
            yield importlib.import_module
        finally:
            sys.path.remove(folder)
            for name in names:
                sys.modules.pop(name, None)
