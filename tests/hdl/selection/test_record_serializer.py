from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.feature.ilbp import PATTERNS, DescriptorPattern
from golden_model.records import Tag
from hdl.feature.extractor import feature_layout
from hdl.selection.record_serializer import FeatureWords
from sim.simulators.recording import Pauses
from tests.hdl.drivers import run_streams

FEATURES = 40
ENDS_AFTER = {11: [0], 12: [0, 1], 39: [1]}
"""Features after which a cell row ends; 1 if that row is the last of the level."""


def random_records(rng: np.random.Generator, pattern: DescriptorPattern, level: int) -> NDArray[np.void]:
    """Records with random bits in every field that the level knows."""
    record = pattern.record
    records = np.zeros(FEATURES, record.dtype)
    records["tag"], records["level"] = Tag.FEATURE, level
    known = {name for name, _ in feature_layout(pattern)}
    for field in record.fields:
        if field.name in known:
            values = records[field.name]
            values[:] = rng.integers(0, 256 if field.is_bytes else 1 << field.bits, values.shape)
    return records


@pytest.mark.parametrize("name", ["ilbp-128", "ilbp-256", "thesis-ilbp-1", "thesis-ilbp-4"])
@pytest.mark.parametrize(("level", "pauses"), [(0, Pauses()), (1, Pauses(gaps=90, stalls=120, seed=3))])
def test_words_are_the_records(name: str, level: int, pauses: Pauses) -> None:
    pattern = PATTERNS[name]
    records = random_records(np.random.default_rng(13), pattern, level)
    known = [field for field, _ in feature_layout(pattern)]
    items: list[dict[str, Any]] = []
    expected: list[tuple[Any, ...]] = []
    for number, record in enumerate(records):
        items.append({"feature": {field: int.from_bytes(record[field].tobytes(), "little") for field in known}})
        expected += [(word, 0, 0) for word in np.frombuffer(record.tobytes(), "<u8").tolist()]
        for ends_level in ENDS_AFTER.get(number, []):
            # The other fields of an end's payload are ignored.
            items.append({**items[-1], "ends_row": 1, "ends_level": ends_level})
            expected.append((None, 1, ends_level))

    dut = FeatureWords(pattern=pattern, level=level)
    received = run_streams(dut, {"i": items}, {"o": len(expected)}, pauses=pauses)["o"]
    words = [(None if word.ends_row else word.data, word.ends_row, word.ends_level) for word in received]
    assert words == expected
