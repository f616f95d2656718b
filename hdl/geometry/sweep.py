"""Reads all matches once for a homography: its score, the list of its inliers, and where they lie."""

from amaranth import Cat, Module, Mux, Signal, Value, unsigned
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from golden_model.formats import POSITION, WEIGHT
from golden_model.geometry.acceptance import CELLS, INLIER_GAIN
from golden_model.geometry.estimator import MAX_MATCHES
from golden_model.geometry.match_gain import LEVELS
from golden_model.geometry.refit import MAX_INLIERS
from hdl.geometry.match_gain import HYPOTHESIS, PRODUCT_CYCLES, WEIGHED_PAIR, MatchGain
from hdl.geometry.sampling import COUNT
from hdl.lib.delay import delayed
from hdl.lib.line_memory import LineMemory

SUPPORT = range(MAX_MATCHES * WEIGHT.max_raw + 1)
SCORE = range(MAX_MATCHES * WEIGHT.max_raw * LEVELS + 1)
AXIS_BITS = (CELLS - 1).bit_length()


class Sweep(wiring.Component):
    """Sums of a homography's gains over all matches, one match per clock.

    Results stay until the next start. The score equals that of `golden_model.geometry.estimator.FrameMatches.score`.
    """

    i_start: In(1)
    i_hypothesis: In(HYPOTHESIS)
    """From a register; stays until the sweep has ended."""
    i_count: In(COUNT)
    """Number of matches, at least 1."""
    i_band: In(range(LEVELS + 1))
    """Smallest gain of the matches that are listed."""
    i_size: In(unsigned(32))
    """Width and height of the right frame, px, 16 bits each."""
    o_address: Out(range(MAX_MATCHES))
    i_match: In(WEIGHED_PAIR)
    """The match at that address, `LineMemory.latency_cycles` clocks later."""
    o_busy: Out(1)
    o_score: Out(SCORE)
    o_support: Out(SUPPORT)
    o_inliers: Out(COUNT)
    """Number of matches with a gain of at least `INLIER_GAIN`."""
    o_cells: Out(range(CELLS**2 + 1))
    """Number of cells of the right frame in which they lie."""
    o_list: Out(1)
    """``o_listed_address`` is the next in the list of matches in the band."""
    o_listed_address: Out(range(MAX_MATCHES))
    o_listed: Out(range(MAX_INLIERS + 1))
    """How many are listed."""

    # Match, gain, product with the weight, sum.
    latency_cycles = LineMemory.latency_cycles + MatchGain.latency_cycles + PRODUCT_CYCLES + 1
    """From the address of a match to the sums with it."""

    def elaborate(self, platform: object) -> Module:
        """Count through the matches; sum, list and mark what comes back."""
        m = Module()
        reading = Signal()
        last = reading & (self.o_address + 1 == self.i_count)
        with m.If(self.i_start):
            m.d.sync += [reading.eq(1), self.o_address.eq(0), self.o_busy.eq(1)]
        with m.Elif(reading):
            m.d.sync += [reading.eq(~last), self.o_address.eq(self.o_address + 1)]
        with m.If(delayed(m, last, self.latency_cycles - 1, reset_less=False)):
            m.d.sync += self.o_busy.eq(0)
        m.submodules.gain = gain = MatchGain()
        m.d.comb += [gain.i_hypothesis.eq(self.i_hypothesis), gain.i_match.eq(self.i_match.pair)]
        gain_cycles = LineMemory.latency_cycles + MatchGain.latency_cycles
        has_gain = delayed(m, reading, gain_cycles, reset_less=False)
        self._sum(m, gain.o_gain, has_gain)
        self._list(m, gain.o_gain, has_gain, delayed(m, self.o_address, gain_cycles))
        self._mark(m, (gain.o_gain >= INLIER_GAIN) & has_gain)
        return m

    def _sum(self, m: Module, gain: Value, has_gain: Value) -> None:
        weight = delayed(m, self.i_match.weight, MatchGain.latency_cycles)
        product = delayed(m, weight * gain, PRODUCT_CYCLES)
        share = delayed(m, Mux(gain.any(), weight, 0), PRODUCT_CYCLES)
        counts = delayed(m, has_gain, PRODUCT_CYCLES, reset_less=False)
        with m.If(self.i_start):
            m.d.sync += [self.o_score.eq(0), self.o_support.eq(0)]
        with m.Elif(counts):
            m.d.sync += [self.o_score.eq(self.o_score + product), self.o_support.eq(self.o_support + share)]

    def _list(self, m: Module, gain: Value, has_gain: Value, address: Value) -> None:
        has_room = self.o_listed != MAX_INLIERS
        m.d.comb += [self.o_list.eq(has_gain & (gain >= self.i_band) & has_room), self.o_listed_address.eq(address)]
        with m.If(self.i_start):
            m.d.sync += self.o_listed.eq(0)
        with m.Elif(self.o_list):
            m.d.sync += self.o_listed.eq(self.o_listed + 1)

    def _mark(self, m: Module, is_inlier: Value) -> None:
        """Count inliers, and the cells that had none before."""
        sides = self.i_size.word_select(0, 16), self.i_size.word_select(1, 16)
        pair = self.i_match.pair
        axes = [self._cell(m, *each) for each in zip((pair.right_x, pair.right_y), sides, strict=True)]
        cell = delayed(m, Cat(axes), MatchGain.latency_cycles - AXIS_BITS)
        occupied = Signal(CELLS**2)
        with m.If(self.i_start):
            m.d.sync += [self.o_inliers.eq(0), self.o_cells.eq(0), occupied.eq(0)]
        with m.Elif(is_inlier):
            m.d.sync += self.o_inliers.eq(self.o_inliers + 1)
            m.d.sync += [
                occupied.bit_select(cell, 1).eq(1),
                self.o_cells.eq(self.o_cells + (occupied.bit_select(cell, 1) == 0)),
            ]

    @staticmethod
    def _cell(m: Module, position: Value, side_px: Value) -> Value:
        """An eighth of the frame's side in which a position lies: a bit per clock, the leading one first."""
        bits: list[Value] = []
        remainder = position
        for bit in reversed(range(AXIS_BITS)):
            # An eighth of a side has side_px / 8 px of 16 units each.
            bound = side_px << bit + POSITION.fraction_bits - AXIS_BITS
            beyond = remainder >= bound
            remainder = delayed(m, Mux(beyond, remainder - bound, remainder)[: POSITION.bits], 1)
            bits = [delayed(m, beyond, 1), *(delayed(m, each, 1) for each in bits)]
        return Cat(bits)
