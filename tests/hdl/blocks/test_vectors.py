"""Vectors say what is specified: lags, margins, padding."""

import numpy as np

from golden_model.records import FRAME_STATUS, MATCH
from hdl.blocks.painting import FRAME_PX, make_painter
from hdl.blocks.vectors import answer_rows, packet, padded_status, pixel_rows

PLANE = np.arange(20, dtype=np.uint8).reshape(4, 5)


def test_pixels_come_in_raster_order() -> None:
    beats = pixel_rows(pixel=PLANE)
    assert [beat["i_pixel"] for beat in beats] == list(range(20))
    assert beats[7] == {"i_x": 2, "i_y": 1, "i_pixel": 7}


def test_an_answer_comes_later_by_its_lag_and_not_from_the_margin() -> None:
    beats = answer_rows(lag_px=1, margin_px=1, code=PLANE)
    specified = {(beat["o_x"], beat["o_y"]): beat["o_code"] for beat in beats if "o_code" in beat}
    # The pixels inside are those with x from 1 to 3 and y from 1 to 2.
    assert specified == {(x + 1, y + 1): PLANE[y, x] for y in (1, 2) for x in (1, 2, 3)}
    assert len(beats) == PLANE.size


def test_the_memory_of_the_painter_has_both_frames_behind_a_canvas_that_both_have_changed() -> None:
    block = make_painter()
    assert block.memory is not None
    pixels = np.array(block.memory.words, np.uint64).view(np.uint8).reshape(-1, 4)
    stored = pixels[-2 * FRAME_PX**2 :]
    sent = np.array([beat["i_data"] for beat in block.inputs["i"]])
    # UG934 has green in the lowest byte, then blue, red; memory blue, green, red.
    np.testing.assert_array_equal(stored[:, :3].astype(int) @ (1 << 8, 1, 1 << 16), sent)
    painted = [beat["o_counts_painted"] for beat in block.outputs["o"]]
    assert min(painted) > 0
    assert (pixels[: -len(stored), 3] > 0).sum() > FRAME_PX**2


def test_a_packet_ends_with_its_last_word_and_leaves_out_what_is_unspecified() -> None:
    records = np.zeros(2, MATCH.dtype)
    records["left_x"] = 3
    status = padded_status(np.zeros(1, FRAME_STATUS.dtype)[0], MATCH.record_bytes, matches=2)
    words = packet(records, status, unspecified=(1,))
    assert [word["last"] for word in words] == [0] * (len(words) - 1) + [1]
    missing = [number for number, word in enumerate(words) if "data" not in word]
    assert missing == [len(words) - MATCH.record_bytes // 8 + 1]
    assert status["matches"] == 2


def test_padding_is_zero_whatever_was_in_memory() -> None:
    padded = FRAME_STATUS.dtype_padded_to(FRAME_STATUS.record_bytes + 16)
    # A copy of an array need not have its padding.
    memory = bytearray(b"\xff" * padded.itemsize)
    dirty = np.frombuffer(memory, padded)
    for name in padded.names or ():
        dirty[name] = 0
    assert any(memory)
    assert {word["data"] for word in packet(dirty)} == {0}
