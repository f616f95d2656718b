"""Records: lengths and alignment."""

import enum

import numpy as np
import pytest

from golden_model.feature.ilbp import PATTERNS
from golden_model.geometry.estimator import EstimateCause
from golden_model.painting.pose import PoseCause
from golden_model.records import FRAME_STATUS, HOMOGRAPHY, MATCH, Cause, Record

FEATURES = [p.record for p in PATTERNS.values()]


_FEATURE = "level:1 sector:4 reserved:8 index:16 response:15 x:16 y:16 frame:32 descriptor:"
_ELEMENTS = "h00:32 h01:32 h02:32 h10:32 h11:32 h12:32 h20:32 h21:32 h22:32"


@pytest.mark.parametrize(
    ("record", "tag", "length_bytes", "fields"),
    [
        (PATTERNS["ilbp-128"].record, 1, 32, f"{_FEATURE}128"),
        (PATTERNS["ilbp-256"].record, 1, 48, f"{_FEATURE}256"),
        (PATTERNS["thesis-ilbp-4"].record, 1, 32, f"{_FEATURE}32 window:72"),
        (
            MATCH, 2, 24, "verdict:1 rule:5 weight:8 left_index:16 right_index:16 left_x:16 left_y:16 right_x:16 "
            "right_y:16 distance:16 margin:16 turn:4 peak_turn:4 reference:16",
        ),
        (
            FRAME_STATUS, 3, 24, "good:1 causes:16 frame:32 width:16 height:16 features:16 matches:16 kept:16 "
            "threshold:15 cycles:32",
        ),
        (
            HOMOGRAPHY, 6, 64, "causes:8 inliers:16 frame:32 score:32 support:32 cycles:32 cells:16 reference:16 "
            f"{_ELEMENTS}",
        ),
    ],
)  # fmt: skip
def test_records_are_those_that_hosts_read(record: Record, tag: int, length_bytes: int, fields: str) -> None:
    assert (record.tag, record.record_bytes) == (tag, length_bytes)
    assert " ".join(f"{field.name}:{field.bits}" for field in record.fields) == fields


@pytest.mark.parametrize(
    ("kind", "names"),
    [
        (Cause, "short_line long_line early_end missing_start too_many_features invalid_settings cleared"),
        (
            EstimateCause,
            "bad_frame too_few_matches too_many_matches invalid_settings no_hypothesis too_few_inliers too_few_cells",
        ),
        (PoseCause, "out_of_range singular unknown_reference unanchored"),
    ],
)
def test_each_cause_has_a_bit(kind: type[enum.IntFlag], names: str) -> None:
    expected = {name: 1 << n for n, name in enumerate(names.split())}
    assert {name.lower(): int(value) for name, value in kind.__members__.items()} == expected


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
