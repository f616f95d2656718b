"""Records: lengths and alignment."""

import numpy as np
import pytest

from golden_model.feature.ilbp import PATTERNS
from golden_model.records import FRAME_STATUS, MATCH, Record

FEATURES = [p.record for p in PATTERNS.values()]


@pytest.mark.parametrize("record", [*FEATURES, MATCH, FRAME_STATUS])
def test_fields_follow_each_other_within_whole_words(record: Record) -> None:
    ends = [1]
    for field, offset in record.offsets():
        assert offset == ends[-1]
        assert 8 * field.storage_bytes >= field.bits
        ends.append(offset + field.storage_bytes)
    assert ends[-1] == record.payload_bytes <= record.record_bytes
    assert record.record_bytes % 8 == 0
    assert record.dtype.itemsize == record.record_bytes


def test_status_takes_the_length_of_its_stream() -> None:
    status = np.zeros(1, FRAME_STATUS.dtype_padded_to(48))
    status["threshold"] = 2
    assert len(status.tobytes()) == 48
    assert status.view(np.uint8)[: FRAME_STATUS.record_bytes].view(FRAME_STATUS.dtype)["threshold"] == 2
