"""What a file of numbers says of itself."""

from datetime import UTC, datetime

from golden_model.version import VERSION


def provenance() -> dict[str, str]:
    """What writes it, and when: ``program``, ``version`` and ``written``, in UTC."""
    return {"program": "skymosaic", "version": VERSION, "written": datetime.now(UTC).isoformat(timespec="seconds")}
