"""What a file of numbers says of itself."""

import json
from collections.abc import Mapping
from datetime import UTC, datetime

from golden_model.version import VERSION


def provenance() -> dict[str, str]:
    """What writes it, and when: ``program``, ``version`` and ``written``, in UTC."""
    return {"program": "skymosaic", "version": VERSION, "written": datetime.now(UTC).isoformat(timespec="seconds")}


def to_json(numbers: Mapping[str, object]) -> bytes:
    """A file of JSON that also says what wrote it, and when."""
    return (json.dumps({**provenance(), **numbers}, indent=1) + "\n").encode()
