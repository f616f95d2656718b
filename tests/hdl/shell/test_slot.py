import numpy as np
import pytest

from golden_model.records import WORD_BYTES
from hdl.settings import PAGE_BYTES
from hdl.shell.slot import HEADER, HEADER_BYTES, slot_pages


def test_the_header_is_whole_words_that_fit_in_front_of_the_packet() -> None:
    assert HEADER.itemsize % WORD_BYTES == 0
    assert HEADER.itemsize <= HEADER_BYTES
    assert HEADER.fields is not None
    ends = [0]
    for name in HEADER.names or ():
        dtype, offset = HEADER.fields[name][:2]
        assert offset == ends[-1]
        # No field crosses the border of two words, which arrive one after the other.
        assert offset // WORD_BYTES == (offset + dtype.itemsize - 1) // WORD_BYTES
        ends.append(offset + dtype.itemsize)
    assert np.dtype(HEADER).isnative


@pytest.mark.parametrize(("words", "pages"), [(1, 1), (496, 1), (497, 2), (1008, 2), (1009, 3)])
def test_a_slot_has_pages_for_its_header_and_its_words(words: int, pages: int) -> None:
    assert slot_pages(words) == pages
    assert (pages - 1) * PAGE_BYTES < HEADER_BYTES + words * WORD_BYTES <= pages * PAGE_BYTES
