"""Records have the same bytes in hardware as in NumPy; the skid buffer loses no payload."""

import numpy as np
import pytest

from golden_model.feature.ilbp import PATTERNS
from golden_model.records import FRAME_STATUS, MATCH, Record
from hdl.lib.skid_buffer import SkidBuffer
from hdl.streams import record_layout
from sim.simulators.recording import NO_PAUSES, Pauses
from tests.hdl.drivers import run_streams

FEATURES = [pattern.record for pattern in PATTERNS.values()]


@pytest.mark.parametrize("record", [MATCH, FRAME_STATUS, *FEATURES])
@pytest.mark.parametrize("length_bytes", [None, 48])
def test_record_layout_has_the_bytes_of_the_dtype(record: Record, length_bytes: int | None) -> None:
    rng = np.random.default_rng(2)
    layout = record_layout(record, length_bytes)
    expected = np.zeros((), record.dtype_padded_to(length_bytes or record.record_bytes))
    values: dict[int | str, int] = {"tag": int(record.tag)}
    for field in record.fields:
        values[field.name] = int.from_bytes(rng.bytes(-(-field.bits // 8))) % (1 << field.bits)
        expected[field.name] = (
            np.frombuffer(values[field.name].to_bytes(field.bits // 8, "little"), np.uint8)
            if field.is_bytes
            else values[field.name]
        )
    expected["tag"] = record.tag
    bits = layout.const(values).as_bits()
    assert bits.to_bytes(layout.size // 8, "little") == expected.tobytes()


@pytest.mark.parametrize("gaps", [0, 128])
@pytest.mark.parametrize("stalls", [0, 128])
def test_skid_buffer_passes_every_payload_on(gaps: int, stalls: int) -> None:
    payloads = list(range(100, 200))
    pauses = Pauses(gaps=gaps, stalls=stalls, seed=4)
    assert run_streams(SkidBuffer(shape=8), {"i": payloads}, {"o": len(payloads)}, pauses=pauses)["o"] == payloads


def test_skid_buffer_takes_one_payload_a_clock() -> None:
    payloads = list(range(100))
    limit = len(payloads) + SkidBuffer.latency_cycles + 2
    dut = SkidBuffer(shape=8)
    assert run_streams(dut, {"i": payloads}, {"o": 100}, pauses=NO_PAUSES, cycle_limit=limit)["o"] == payloads
