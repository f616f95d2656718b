"""The blocks answer their vectors, and the vectors reach what they are there for.

Rows are in `catalogue`, `pixel`, `axi` and `painting`; a new one needs no other list to be tested.
"""

from functools import partial

import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.matching import rule_bases
from golden_model.records import HOMOGRAPHY, MATCH, WORD_BYTES, Record
from hdl.blocks.catalogue import CATALOGUE, make_block
from hdl.blocks.pixel import BlockConfig
from hdl.blocks.vectors import Row
from tests.hdl.rows import row_test

pytestmark = pytest.mark.usefixtures("unused_blocks")


AROUND_A_MEMORY = ("painter",)
"""`tests/hdl/painting/test_painter.py` has the memory, and the exported bench."""
ROWS = {name: partial(make_block, name, {}) for name in CATALOGUE if name not in AROUND_A_MEMORY}
AT_TWO = {
    f"{name} at two": partial(make_block, name, {"pixels_per_clock": 2})
    for name, entry in CATALOGUE.items()
    if "pixels_per_clock" in entry.settings
}
# The homography takes half a minute.
test_rows = row_test(ROWS | AT_TWO, slow=("homography",))


def records(rows: list[Row], port: str, record: Record) -> NDArray[np.void]:
    """The records in the words of a packet; words that are not compared are 0."""
    words = [row.get(f"{port}_data", 0) for row in rows]
    return np.array(words, np.uint64).view(record.dtype)


def test_vectors_of_the_rules_have_each_rule_decide_and_begin_at_zero() -> None:
    block = make_block("fuzzy", {})
    assert len({row["o_weight"] for row in block.outputs["o"]}) > 5
    rules = rule_bases.aerial_orientation(BlockConfig().pattern.bits).rules
    assert {row["o_rule"] for row in block.outputs["o"]} == set(range(len(rules)))
    assert set(block.inputs["i"][0].values()) == {0}


def test_vectors_of_the_matcher_have_kept_and_rejected_matches() -> None:
    rows = list(make_block("matcher", {}).outputs["o_matches"])
    ends = [number for number, row in enumerate(rows) if row["o_matches_last"]]
    record_words = MATCH.record_bytes // WORD_BYTES
    assert ends == [record_words - 1, len(rows) - 1]
    matches = records(rows[record_words:-record_words], "o_matches", MATCH)
    assert len(matches) > 20
    assert set(matches["verdict"].tolist()) == {0, 1}


def test_vectors_of_the_estimator_have_a_homography() -> None:
    (record,) = records(list(make_block("homography", {}).outputs["o"]), "o", HOMOGRAPHY)
    assert record["causes"] == 0
    assert record["inliers"] > 8
