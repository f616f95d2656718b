"""The DMA model, by the sentences of AMD's product guide PG021 that the exported driver relies on."""

import numpy as np
import pytest

from golden_model.arrays import Pixels
from tests.system.board.axi_dma import (
    ADDRESS_HIGH,
    ADDRESS_LOW,
    CONTROL,
    LENGTH,
    RECEIVE_OFFSET,
    RESET,
    RUN,
    STATUS,
    Dma,
    ReceiveChannel,
    SendChannel,
    Status,
)
from tests.system.board.pynq_board import Board

BASE = 0x1_2000_0000


class Both(Dma):
    """A DMA with both channels."""

    send: SendChannel
    receive: ReceiveChannel


@pytest.fixture
def board() -> Board:
    return Board(np.arange(4096, dtype=np.uint32).astype(np.uint8), BASE)


@pytest.fixture
def dma(board: Board) -> Both:
    """It runs."""
    dma = Both(SendChannel(board, address_bits=40), ReceiveChannel(board, address_bits=40))
    for offset in (0, RECEIVE_OFFSET):
        dma.write(offset + CONTROL, RUN)
    return dma


def start(dma: Both, offset: int, length: int, address: int = BASE) -> None:
    dma.write(offset + ADDRESS_LOW, address & 0xFFFF_FFFF)
    dma.write(offset + ADDRESS_HIGH, address >> 32)
    dma.write(offset + LENGTH, length)


def status(dma: Both, offset: int = RECEIVE_OFFSET) -> Status:
    return Status(dma.read(offset + STATUS))


def packet(length: int) -> Pixels:
    return np.full(length, 7, np.uint8)


@pytest.mark.parametrize("offset", [0, RECEIVE_OFFSET])
def test_a_channel_runs_with_rs_and_starts_by_a_length_while_it_runs(board: Board, offset: int) -> None:
    dma = Both(SendChannel(board), ReceiveChannel(board))
    assert (status(dma, offset), dma.read(offset + CONTROL)) == (Status.HALTED, 0x0001_0002)
    dma.write(offset + CONTROL, RUN)
    # It is not idle before its first transfer.
    assert status(dma, offset) == Status(0)
    start(dma, offset, 0)
    dma.write(offset + CONTROL, 0)
    assert status(dma, offset) == Status.HALTED
    start(dma, offset, 64)
    dma.write(offset + CONTROL, RUN)
    assert status(dma, offset) == Status(0)
    assert not dma.send.outgoing.size
    # A length has 26 bits.
    dma.write(offset + LENGTH, 1 << 26)
    assert dma.read(offset + LENGTH) == 0
    dma.write(offset + LENGTH, (1 << 26) - 1)
    assert dma.read(offset + LENGTH) == (1 << 26) - 1


def test_address_bits_beyond_those_that_are_built_are_lost(dma: Both) -> None:
    dma.receive.address_bits = 32
    for offset, kept in ((0, BASE), (RECEIVE_OFFSET, BASE & 0xFFFF_FFFF)):
        dma.write(offset + ADDRESS_LOW, BASE & 0xFFFF_FFFF)
        dma.write(offset + ADDRESS_HIGH, 1 << 8 | BASE >> 32)
        assert dma.read(offset + ADDRESS_HIGH) << 32 | dma.read(offset + ADDRESS_LOW) == kept


def test_a_send_reads_memory_and_is_idle_when_all_has_left(dma: Both, board: Board) -> None:
    start(dma, 0, 24, BASE + 8)
    assert Status.IDLE not in status(dma, 0)
    np.testing.assert_array_equal(dma.send.outgoing, board.dram[8:32])
    dma.send.sent(16)
    assert Status.IDLE not in status(dma, 0)
    dma.send.sent(8)
    assert status(dma, 0) == Status.IDLE | Status.IOC_IRQ


def test_a_packet_shorter_than_its_buffer_ends_at_tlast_and_length_says_how_much(dma: Both, board: Board) -> None:
    start(dma, RECEIVE_OFFSET, 64, BASE + 256)
    dma.receive.receive(packet(16), last=False)
    assert Status.IDLE not in status(dma)
    dma.receive.receive(packet(8), last=True)
    assert status(dma) == Status.IDLE | Status.IOC_IRQ
    assert dma.read(RECEIVE_OFFSET + LENGTH) == 24
    assert (board.dram[256:280] == 7).all()
    assert board.dram[280] == 280 % 256
    # A write of 1 clears the interrupt, and the next transfer is not idle until it has ended.
    dma.write(RECEIVE_OFFSET + STATUS, Status.IOC_IRQ)
    assert status(dma) == Status.IDLE
    start(dma, RECEIVE_OFFSET, 8)
    assert Status.IDLE not in status(dma)


def test_a_packet_longer_than_its_buffer_is_an_internal_error_and_halts(dma: Both) -> None:
    start(dma, RECEIVE_OFFSET, 16)
    assert dma.receive.room_words == 2
    dma.receive.receive(packet(16), last=False)
    assert status(dma) == Status.HALTED | Status.INTERNAL_ERROR | Status.ERR_IRQ
    assert not dma.read(RECEIVE_OFFSET + CONTROL) & RUN


@pytest.mark.parametrize(
    ("address", "error"),
    [(BASE + 40, Status.SLAVE_ERROR), (BASE + 4090, Status.DECODE_ERROR), (0, Status.DECODE_ERROR)],
)
def test_an_error_of_the_memory_halts(dma: Both, board: Board, address: int, error: Status) -> None:
    board.bad_address = BASE + 47
    start(dma, RECEIVE_OFFSET, 64, address)
    dma.receive.receive(packet(8), last=True)
    start(dma, 0, 8, address)
    dma.send.sent(dma.send.outgoing.size)
    assert status(dma, 0) == Status.HALTED | Status.ERR_IRQ | error
    # A failed write is an internal error, too.
    assert status(dma, RECEIVE_OFFSET) == Status.HALTED | Status.ERR_IRQ | Status.INTERNAL_ERROR | error


@pytest.mark.parametrize("offset", [0, RECEIVE_OFFSET])
def test_after_an_error_only_a_reset_of_the_engine_helps_and_it_resets_both_channels(dma: Both, offset: int) -> None:
    start(dma, RECEIVE_OFFSET, 8, 0)
    dma.receive.receive(packet(8), last=True)
    dma.write(RECEIVE_OFFSET + CONTROL, RUN)
    assert Status.HALTED in status(dma)
    start(dma, 0, 64)
    dma.write(offset + CONTROL, RESET)
    assert dma.read(offset + CONTROL) & RESET
    while dma.read(offset + CONTROL) & RESET:
        pass
    for each in (0, RECEIVE_OFFSET):
        assert dma.read(each + CONTROL) == 0x0001_0002
        assert status(dma, each) == Status.HALTED
    assert not dma.send.outgoing.size


def test_words_taken_early_belong_to_the_next_transfer_and_a_reset_drops_them(dma: Both) -> None:
    dma.receive.receive(packet(32), last=False)
    assert dma.receive.room_words == 0
    start(dma, RECEIVE_OFFSET, 64)
    assert dma.receive.room_words == 4
    dma.receive.receive(packet(8), last=True)
    assert dma.read(RECEIVE_OFFSET + LENGTH) == 40
    dma.receive.receive(packet(8), last=True)
    dma.write(RECEIVE_OFFSET + CONTROL, RESET)
    assert dma.receive.room_words == 4
