# amaranth: UnusedElaboratable=no
"""Features become the words of their records."""

from functools import partial
from typing import Any

import numpy as np

from golden_model.feature.ilbp import PATTERNS
from golden_model.records import Tag
from hdl.blocks.vectors import Block, of_stream
from hdl.feature.extractor import feature_layout
from hdl.selection.record_serializer import FeatureWords
from tests.hdl.rows import row_test

FEATURES = 40
ENDS_AFTER = {11: [0], 12: [0, 1], 39: [1]}
"""Features after which a cell row ends; 1 if that row is the last of the level."""


def record_words(name: str, level: int) -> Block:
    """Records with random bits in every field that the level knows."""
    pattern, rng = PATTERNS[name], np.random.default_rng(13)
    records = np.zeros(FEATURES, pattern.record.dtype)
    records["tag"], records["level"] = Tag.FEATURE, level
    known = {field for field, _ in feature_layout(pattern)}
    for field in pattern.record.fields:
        if field.name in known:
            values = records[field.name]
            values[:] = rng.integers(0, 256 if field.is_bytes else 1 << field.bits, values.shape)
    items: list[dict[str, Any]] = []
    answers: list[dict[str, int]] = []
    for number, record in enumerate(records):
        feature = {field: int.from_bytes(record[field].tobytes(), "little") for field in sorted(known)}
        items.append({"feature": feature, "ends_row": 0})
        words = np.frombuffer(record.tobytes(), "<u8").tolist()
        answers += [{"data": word, "ends_row": 0, "ends_level": 0} for word in words]
        for ends_level in ENDS_AFTER.get(number, []):
            # The other fields of an end's payload are ignored.
            items.append({**items[-1], "ends_row": 1, "ends_level": ends_level})
            answers.append({"ends_row": 1, "ends_level": ends_level})
    return of_stream(FeatureWords(pattern=pattern, level=level), "", items, answers)


NAMES = ("ilbp-128", "ilbp-256", "thesis-ilbp-1", "thesis-ilbp-4")
test_rows = row_test({f"{name} level {n % 2}": partial(record_words, name, n % 2) for n, name in enumerate(NAMES)})
