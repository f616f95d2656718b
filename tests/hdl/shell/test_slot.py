import pytest

from golden_model.records import WORD_BYTES
from hdl.settings import PAGE_BYTES
from hdl.shell.slot import HEADER_BYTES, slot_pages


@pytest.mark.parametrize(("words", "pages"), [(1, 1), (496, 1), (497, 2), (1008, 2), (1009, 3)])
def test_a_slot_has_pages_for_its_header_and_its_words(words: int, pages: int) -> None:
    assert slot_pages(words) == pages
    assert (pages - 1) * PAGE_BYTES < HEADER_BYTES + words * WORD_BYTES <= pages * PAGE_BYTES
