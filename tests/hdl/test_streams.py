"""Records have the same bytes in hardware as in NumPy."""

import numpy as np
import pytest

from golden_model.feature.ilbp import PATTERNS
from golden_model.records import FRAME_STATUS, MATCH, Record
from hdl.streams import record_layout

FEATURES = [pattern.record for pattern in PATTERNS.values()]


@pytest.mark.parametrize("record", [MATCH, FRAME_STATUS, *FEATURES])
@pytest.mark.parametrize("length_bytes", [None, 48])
def test_record_layout_has_the_bytes_of_the_dtype(record: Record, length_bytes: int | None) -> None:
    rng = np.random.default_rng(2)
    layout = record_layout(record, length_bytes)
    expected = np.zeros((), record.dtype_padded_to(length_bytes or record.record_bytes))
    values: dict[int | str, int] = {"tag": int(record.tag)}
    for field in record.fields:
        values[field.name] = int.from_bytes(rng.bytes(-(-field.bits // 8))) % (1 << field.bits)
        expected[field.name] = (
            np.frombuffer(values[field.name].to_bytes(field.bits // 8, "little"), np.uint8)
            if field.is_bytes
            else values[field.name]
        )
    expected["tag"] = record.tag
    bits = layout.const(values).as_bits()
    assert bits.to_bytes(layout.size // 8, "little") == expected.tobytes()
