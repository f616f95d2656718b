"""The blocks answer their vectors, and the vectors reach what they are there for.

Rows are in `catalogue`, `pixel`, `axi` and `painting`; a new one needs no other list to be tested. Rows pass through
`vectors`, `flat` and `chain`, and in `test_export` through `testbench`: what is wrong there fails here, or in Icarus.
"""

from functools import partial

import numpy as np
import pytest
from amaranth.hdl import unsigned
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out
from numpy.typing import NDArray

from golden_model.matching import rule_bases
from golden_model.records import FRAME_STATUS, HOMOGRAPHY, MATCH, WORD_BYTES, Record
from hdl.blocks.catalogue import CATALOGUE, make_block
from hdl.blocks.flat import FlatBlock
from hdl.blocks.painting import FRAME_PX
from hdl.blocks.pixel import BlockConfig
from hdl.blocks.vectors import Row, packet
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


def test_the_memory_of_the_painter_has_both_frames_behind_a_canvas_that_both_have_changed() -> None:
    block = make_block("painter", {})
    assert block.memory is not None
    pixels = np.array(block.memory.words, np.uint64).view(np.uint8).reshape(-1, 4)
    stored = pixels[-2 * FRAME_PX**2 :]
    sent = np.array([beat["i_data"] for beat in block.inputs["i"]])
    # UG934 has green in the lowest byte, then blue, red; memory blue, green, red.
    np.testing.assert_array_equal(stored[:, :3].astype(int) @ (1 << 8, 1, 1 << 16), sent)
    assert min(beat["o_counts_painted"] for beat in block.outputs["o"]) > 0
    assert (pixels[: -len(stored), 3] > 0).sum() > FRAME_PX**2


def test_padding_is_zero_whatever_was_in_memory() -> None:
    padded = FRAME_STATUS.dtype_padded_to(FRAME_STATUS.record_bytes + 16)
    # A copy of an array need not have its padding.
    dirty = np.frombuffer(bytearray(b"\xff" * padded.itemsize), padded)
    for name in padded.names or ():
        dirty[name] = 0
    assert {word["data"] for word in packet(dirty)} == {0}


def test_a_member_without_bits_has_no_port_and_two_ports_of_one_name_are_refused() -> None:
    empty: wiring.Component = wiring.Component({"i": In(stream.Signature(unsigned(0))), "o": Out(unsigned(0))})
    assert set(FlatBlock(empty).signature.members) == {"clk", "rst", "i_valid", "i_ready"}
    both: wiring.Component = wiring.Component({"i": In(stream.Signature(unsigned(4))), "i_valid": In(1)})
    for component, name in ((both, "i_valid"), (wiring.Component({"clk": In(1)}), "clk")):
        with pytest.raises(ValueError, match=f"two ports would be called {name}; rename"):
            FlatBlock(component)
