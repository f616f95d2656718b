"""Draws the samples of a pass: four different ranks for each lane."""

import itertools

from amaranth import Array, Cat, Const, Module, Mux, Signal, Value, unsigned
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from golden_model.geometry.estimator import MAX_MATCHES
from golden_model.geometry.program import LANES
from golden_model.geometry.sampling import DRAW_BITS, RANDOM_BITS, SAMPLE, SHARE_BITS, SHARES, SHIFTS, STEPS
from hdl.lib.delay import delayed
from hdl.lib.multiplier import Multiplier

COUNT = unsigned(MAX_MATCHES.bit_length())
DRAWS = LANES * SAMPLE
FIRST_DRAW = Multiplier.latency_cycles + 1
"""Clocks from the start to the first random number: the number of matches to draw from is computed before."""


class SampleDraws(wiring.Component):
    """Ranks of the samples of a pass; equal to `golden_model.geometry.sampling`.

    One multiplier of 16 x 12 bits serves the number of matches to draw from, and then the draws, one per clock.
    """

    i_restart: In(1)
    """The generator begins with ``i_seed``."""
    i_seed: In(RANDOM_BITS)
    i_start: In(1)
    """Begins a pass; the one before must be complete."""
    i_count: In(COUNT)
    """Number of matches, at least 4."""
    i_step: In(range(STEPS))
    o_valid: Out(1)
    """There is a rank: `DRAWS` of them in consecutive clocks."""
    o_rank: Out(range(MAX_MATCHES))

    latency_cycles = FIRST_DRAW + Multiplier.latency_cycles + 1
    """From ``i_start`` to the first rank."""

    def elaborate(self, platform: object) -> Module:
        """Compute the number, draw, and replace what was drawn before."""
        m = Module()
        clock = Signal(range(FIRST_DRAW + DRAWS + 1))
        state = Signal(RANDOM_BITS)
        size = Signal(COUNT, reset_less=True)
        drawing = clock > FIRST_DRAW - 1
        with m.If(self.i_start | (clock != 0)):
            m.d.sync += clock.eq(Mux(clock == FIRST_DRAW + DRAWS - 1, 0, clock + 1))
        with m.If(self.i_restart):
            m.d.sync += state.eq(self.i_seed)
        with m.Elif(drawing):
            m.d.sync += state.eq(self._advance(m, state))
        number = (clock - FIRST_DRAW)[: SAMPLE.bit_length() - 1]
        # How many ranks the k-th is drawn from.
        room = size - (SAMPLE - 1) + number
        m.submodules.multiplier = multiplier = Multiplier(
            a=unsigned(DRAW_BITS), b=COUNT, product=unsigned(DRAW_BITS + COUNT.width)
        )
        share = Array(Const(each, DRAW_BITS) for each in SHARES)[self.i_step]
        m.d.comb += [
            multiplier.i_valid.eq(1),
            multiplier.i_a.eq(Mux(drawing, state[RANDOM_BITS - DRAW_BITS :], share)),
            multiplier.i_b.eq(Mux(drawing, room, self.i_count)),
        ]
        with m.If(clock == FIRST_DRAW - 1):
            part = multiplier.o_product + (1 << SHARE_BITS) - 1 >> SHARE_BITS
            m.d.sync += size.eq(Mux(part < SAMPLE, SAMPLE, part))
        drawn = delayed(m, drawing, multiplier.latency_cycles, reset_less=False)
        last = delayed(m, room - 1, multiplier.latency_cycles)
        is_first = delayed(m, number == 0, multiplier.latency_cycles)
        self._replace(m, multiplier.o_product >> DRAW_BITS, last[: len(self.o_rank)], is_first)
        m.d.sync += self.o_valid.eq(drawn)
        return m

    @staticmethod
    def _advance(m: Module, state: Signal) -> Value:
        left, right, last = SHIFTS
        first = Signal(RANDOM_BITS)
        second = Signal(RANDOM_BITS)
        m.d.comb += [first.eq(state ^ (state << left)), second.eq(first ^ (first >> right))]
        return second ^ (second << last)

    def _replace(self, m: Module, rank: Value, last: Value, is_first: Value) -> None:
        """Send the rank, or ``last`` where it has been drawn before in this sample."""
        before = [Signal.like(self.o_rank, name=f"before{n}", reset_less=True) for n in range(SAMPLE - 1)]
        known = Signal(SAMPLE - 1)
        is_known = Signal()
        m.d.comb += is_known.eq(~is_first & (known & Cat(rank == each for each in before)).any())
        chosen = Signal.like(self.o_rank)
        m.d.comb += chosen.eq(Mux(is_known, last, rank))
        m.d.sync += [
            self.o_rank.eq(chosen),
            before[0].eq(chosen),
            *(older.eq(newer) for newer, older in itertools.pairwise(before)),
            known.eq(Mux(is_first, 1, known << 1 | 1)),
        ]
