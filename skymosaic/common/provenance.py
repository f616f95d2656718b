"""What a file of numbers says of itself."""

import json
import math
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from golden_model.version import VERSION


def provenance() -> dict[str, str]:
    """What writes it, and when: ``program``, ``version`` and ``written``, in UTC."""
    return {"program": "skymosaic", "version": VERSION, "written": datetime.now(UTC).isoformat(timespec="seconds")}


def to_json(numbers: Mapping[str, object]) -> bytes:
    """A file of JSON that also says what wrote it, and when."""
    return (json.dumps({**provenance(), **finite(numbers)}, indent=1) + "\n").encode()


def finite(value: Any) -> Any:
    """``value`` with None for infinity and NaN, which JSON does not know, and text for paths."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): finite(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(each) for each in value]
    return str(value) if isinstance(value, Path) else value
