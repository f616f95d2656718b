# amaranth: UnusedElaboratable=no
"""Packets that are on pass in order; `tests/formal` proves the rest, what a switch and a clear do among it."""

import numpy as np

from golden_model.records import FRAME_STATUS, MATCH, Tag
from hdl.axi.packet_gate import PacketGate
from hdl.blocks.vectors import of_stream, packet, padded_status
from sim.benches.rows import Row, check


def test_packets_pass() -> None:
    records, status = np.zeros(3, MATCH.dtype), np.zeros(1, FRAME_STATUS.dtype)[0]
    records["tag"], records["distance"], status["tag"] = Tag.MATCH, range(3), Tag.FRAME_STATUS
    words = [word for n in (0, 1, 3, 2) for word in packet(records[:n], padded_status(status, MATCH.record_bytes))]
    gate = PacketGate(record_bytes=MATCH.record_bytes)
    check(Row(lambda: of_stream(gate, "", words, words, i_enable=1), remembers=True))
