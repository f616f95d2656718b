"""Records: lengths, alignment, and the bytes of their fields."""

import numpy as np
import pytest

from golden_model.feature.ilbp import PATTERNS
from golden_model.records import FRAME_STATUS, MATCH, Record, Tag, feature_record

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


def test_bytes_are_little_endian_behind_the_tag() -> None:
    feature = np.zeros(1, feature_record(16).dtype)
    feature["tag"], feature["x"], feature["descriptor"] = Tag.FEATURE, 0x1234, np.arange(16)
    stored = feature.tobytes()
    assert feature.dtype.fields
    offset = feature.dtype.fields["x"][1]
    assert stored[0] == Tag.FEATURE
    assert stored[offset : offset + 2] == b"\x34\x12"
    assert bytes(range(16)) in stored


def test_status_takes_the_length_of_its_stream() -> None:
    status = np.zeros(1, FRAME_STATUS.dtype_padded_to(48))
    status["threshold"] = 2
    assert len(status.tobytes()) == 48
    assert status.view(np.uint8)[: FRAME_STATUS.record_bytes].view(FRAME_STATUS.dtype)["threshold"] == 2
