"""Histogram of the relative orientations of matches, and its peak."""

from amaranth import Module, Signal, Value
from amaranth.lib import data, stream
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from golden_model.feature.orientation import SECTORS
from golden_model.formats import WEIGHT
from hdl.lib.component import Component
from hdl.lib.delay import delayed
from hdl.lib.multiplier import Multiplier, multiply

SQUARE_CYCLES = Multiplier.latency_cycles
FIND_CYCLES = 5
"""Clocks from the address of the preceding bin to the smoothed bin."""


class OrientationHistogram(Component):
    """Adds up squared weights by relative orientation, then finds the most common one.

    Equals `golden_model.matching.matcher.common_orientation`.

    The bins are smoothed around the circle by 4 h + 3 h₋ + 3 h₊; the first maximum wins. After a search, and after
    reset, the bins are cleared.

    Parameters
    ----------
    max_matches : int
        Largest number of matches in one histogram.
    """

    i: stream.Interface
    """Stream of ``relative_orientation`` and ``weight`` of a match. Not accepted while busy; each takes
    ``SQUARE_CYCLES`` + 1 clocks."""
    i_find: In(1)
    """Starts the search for the peak; no match may be pending."""
    o_busy: Out(1)
    """High from the clock after ``i_find`` until the peak is known and the bins are cleared."""
    o_peak: Out(range(SECTORS))
    """Relative orientation of the last peak."""

    def __init__(self, *, max_matches: int) -> None:
        self._bin = range(max_matches * WEIGHT.max_raw**2 + 1)
        match = data.StructLayout({"relative_orientation": range(SECTORS), "weight": WEIGHT.bits})
        super().__init__(i=In(stream.Signature(match)))

    def elaborate(self, platform: object) -> Module:
        """A memory that is cleared bin by bin, updated by each match, and read in order to find the peak."""
        m = Module()
        bins: Memory = Memory(shape=self._bin, depth=SECTORS, init=[])
        m.submodules.bins = bins
        read = bins.read_port()
        write = bins.write_port()
        step = Signal(range(SECTORS + FIND_CYCLES))
        # A smoothed bin weighs 4 + 3 + 3 bins.
        height = Signal(range(10 * self._bin[-1] + 1), reset_less=True)
        orientation, weight = self.i.payload.relative_orientation, self.i.payload.weight
        is_new = Signal()
        square = multiply(m, "square", weight, weight, valid=is_new)
        smoothed = self._smooth(m, read.data)
        is_bin = delayed(m, step >= FIND_CYCLES - 1, 1)
        m.d.sync += step.eq(step + 1)
        with m.FSM(init="Clear"):
            with m.State("Clear"):
                m.d.comb += [self.o_busy.eq(1), write.en.eq(1), write.addr.eq(step)]
                with m.If(step == SECTORS - 1):
                    m.d.sync += step.eq(0)
                    m.next = "Add"
            with m.State("Add"):
                m.d.comb += is_new.eq(self.i.valid & (step == 0))
                m.d.comb += [read.addr.eq(orientation), write.addr.eq(orientation)]
                m.d.comb += write.data.eq(read.data + square)
                # A match is taken only when its square is ready, so a bin is never read before the last sum is written.
                m.d.comb += [write.en.eq(self.i.ready), self.i.ready.eq(self.i.valid & (step == SQUARE_CYCLES))]
                with m.If(~self.i.valid | self.i.ready):
                    m.d.sync += step.eq(0)
                with m.If(self.i_find):
                    m.d.sync += [step.eq(0), height.eq(0), self.o_peak.eq(0)]
                    m.next = "Find"
            with m.State("Find"):
                m.d.comb += [self.o_busy.eq(1), read.addr.eq(step - 1)]
                # Strictly larger: of equal peaks the smallest orientation wins, as in the golden model.
                with m.If(is_bin & (smoothed > height)):
                    m.d.sync += [height.eq(smoothed), self.o_peak.eq(step - FIND_CYCLES)]
                with m.If(step == SECTORS + FIND_CYCLES - 1):
                    m.d.sync += step.eq(0)
                    m.next = "Clear"
        return m

    @staticmethod
    def _smooth(m: Module, height: Value) -> Value:
        """Smooth the bins, which come in order, one per clock; each is ready 3 clocks after the bin itself."""
        middle = delayed(m, height, 1)
        around = delayed(m, delayed(m, middle, 1) + height, 1)
        return delayed(m, (delayed(m, middle, 1) << 2) + (around << 1) + around, 1)
