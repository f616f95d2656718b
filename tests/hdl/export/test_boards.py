"""Every board has the files that its export copies, and the facts that its scripts need."""

import re

import pytest

from hdl.export.boards import ALL_BOARDS, BOARDS, SERIAL_BOARD, SOURCES, board_facts


@pytest.mark.parametrize("board", BOARDS)
def test_facts_are_read_from_the_file_that_vivado_runs(board: str) -> None:
    facts = board_facts(board)
    text = (SOURCES / "boards" / f"{board}.tcl").read_text()
    assert f"{{{facts['part']}}}" in text or f" {facts['part']}" in text
    assert re.fullmatch(r"xc7\w+-\d|xck26-\S+", facts["part"])
    assert 10 <= float(facts["clock_mhz"]) <= 400
    assert (SOURCES / "systems" / f"{facts['family']}.tcl").exists()


def test_the_board_without_a_processor_is_none_of_vivados() -> None:
    assert SERIAL_BOARD not in BOARDS
    assert set(ALL_BOARDS) == {*BOARDS, SERIAL_BOARD}
    with pytest.raises(ValueError, match=f"unknown board 'breadboard'; valid: .*{SERIAL_BOARD}"):
        board_facts("breadboard")
