"""The block-test drivers: they carry everything unchanged, and notice designs that break the rules."""

import numpy as np
import pytest
from amaranth.hdl import Cat, Module, Signal, signed
from amaranth.lib import data, fifo, stream, wiring
from amaranth.lib.wiring import In, Out

from hdl.streams import beat, carry_scan
from sim.benches.drivers import run_beats
from sim.simulators.recording import Pauses
from tests.hdl.drivers import run_streams

PAYLOAD = data.StructLayout({"number": 8, "offset": 4})
PAYLOADS = [{"number": n, "offset": n % 7} for n in range(60)]
PAUSES = (Pauses(), Pauses(gaps=128, stalls=128, seed=3), Pauses(stalls=230, seed=4))


class Queue(wiring.Component):
    """A FIFO that adds ``i_bias`` to the number."""

    def __init__(self) -> None:
        super().__init__(
            {"i": In(stream.Signature(PAYLOAD)), "o": Out(stream.Signature(PAYLOAD)), "i_bias": In(8)}
        )  # fmt: skip

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.submodules.queue = queue = fifo.SyncFIFOBuffered(width=12, depth=3)
        taken = data.View(PAYLOAD, queue.r_data)
        m.d.comb += [
            queue.w_en.eq(self.i.valid),
            queue.w_data.eq(self.i.payload),
            self.i.ready.eq(queue.w_rdy),
            queue.r_en.eq(self.o.ready),
            self.o.valid.eq(queue.r_rdy),
            self.o.payload.number.eq(taken.number + self.i_bias),
            self.o.payload.offset.eq(taken.offset),
        ]
        return m


class Withdrawn(wiring.Component):
    """Breaks the stream rules: offers each number for one clock only."""

    o: Out(stream.Signature(8))

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.d.sync += self.o.payload.eq(self.o.payload + 1)
        m.d.comb += self.o.valid.eq(1)
        return m


class Pair(wiring.Component):
    """Each pixel with the one sent before it, and its negative, two clocks later."""

    latency_cycles = 2

    def __init__(self) -> None:
        payload = {"pair": data.ArrayLayout(8, 2), "negative": signed(9)}
        super().__init__({"i": In(beat(pixel=8)), "o": Out(beat(**payload))})

    def elaborate(self, platform: object) -> Module:
        m = Module()
        carry_scan(m, self.i, self.o, self.latency_cycles)
        pair = Signal.like(self.o.pair)
        with m.If(self.i.valid):
            m.d.sync += pair.eq(Cat(self.i.pixel, pair[0]))
        m.d.sync += [self.o.pair.eq(pair), self.o.negative.eq(-pair[0])]
        return m


@pytest.mark.parametrize("pauses", PAUSES)
def test_streams_carry_every_payload(pauses: Pauses) -> None:
    received = run_streams(Queue(), {"i": PAYLOADS}, {"o": 60}, settings={"i_bias": 250}, pauses=pauses)
    assert [(got.number, got.offset) for got in received["o"]] == [((n + 250) % 256, n % 7) for n in range(60)]


def test_a_withdrawn_payload_is_noticed() -> None:
    with pytest.raises(AssertionError, match="a payload was withdrawn before it was taken"):
        run_streams(Withdrawn(), {}, {"o": 10}, pauses=Pauses(stalls=100, seed=1))


def test_a_stream_that_hangs_is_stopped() -> None:
    with pytest.raises(AssertionError, match=r"not done within 300 cycles; received: {'o': 60}"):
        run_streams(Queue(), {"i": PAYLOADS}, {"o": 61}, cycle_limit=300)


@pytest.mark.parametrize("pauses", PAUSES[:2])
def test_beats_carry_every_pixel_of_two_frames(pauses: Pauses) -> None:
    frames = np.random.default_rng(5).integers(0, 256, (2, 5, 9))
    sent, received = run_beats(Pair(), [{"pixel": frame} for frame in frames], pauses=pauses)
    assert np.all(received.cycles - sent.cycles == Pair.latency_cycles)
    assert (np.diff(sent.cycles) > 1).any() == bool(pauses.gaps)
    before = np.concatenate([[0], frames.ravel()[:-1]]).reshape(frames.shape)
    for number, beats in enumerate(received.split()):
        assert np.array_equal(beats.plane("pair", (5, 9)), np.stack([frames[number], before[number]], axis=-1))
        assert np.array_equal(beats.plane("negative", (5, 9)), -frames[number])


def test_planes_move_by_the_lag() -> None:
    frame = np.arange(45).reshape(5, 9)
    _, received = run_beats(Pair(), [{"pixel": frame}])
    plane = received.plane("negative", (5, 9), lag_px=2)
    assert np.array_equal(plane[:3, :7], -frame[2:, 2:])
    assert not plane[3:].any()
    assert not plane[:, 7:].any()
