"""One line for objects that hold arrays."""

from dataclasses import is_dataclass
from typing import Any, TypeVar

import numpy as np

from golden_model.text import one_line

Class = TypeVar("Class", bound=type)


def brief(cls: Class) -> Class:
    """Decorate a class: printed, its instances are one line, in which arrays are their type and shape."""
    type.__setattr__(cls, "__repr__", lambda self: one_line(_describe(self)))
    return cls


def _describe(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"{value.dtype}{list(value.shape)}"
    if not is_dataclass(value) and not hasattr(value, "_asdict"):
        return repr(value)
    fields = value._asdict() if hasattr(value, "_asdict") else vars(value)
    return f"{type(value).__name__}({', '.join(f'{name}={_describe(each)}' for name, each in fields.items())})"
