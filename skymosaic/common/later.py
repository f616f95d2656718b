"""Modules that are imported when something of them is first used: a command waits only for what it needs."""

import importlib
from typing import Any


class Later:
    """Stands for a module, by its name; the first attribute that is asked for imports it."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, attribute: str) -> Any:
        return getattr(importlib.import_module(self._name), attribute)
