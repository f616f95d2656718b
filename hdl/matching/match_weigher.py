"""Weighs matches by a fuzzy rule base and the relative orientation that most of them share."""

from amaranth import Cat, Module, Mux, Signal, Value
from amaranth.lib import data, stream
from amaranth.lib.wiring import In, Out

from golden_model.config import MatcherConfig
from golden_model.feature.ilbp import DescriptorPattern
from golden_model.feature.orientation import SECTORS
from golden_model.formats import WEIGHT
from golden_model.matching import rule_bases
from hdl.fuzzy.sugeno import RESULT, Sugeno
from hdl.lib.component import Component
from hdl.matching.correlation import SumOfAbsoluteDifferences
from hdl.matching.feature_banks import READ_CYCLES, banked_feature
from hdl.matching.mutual_neighbours import pair_layout
from hdl.matching.orientation_histogram import OrientationHistogram

WEIGHED = data.StructLayout({**RESULT.members, "turn": range(SECTORS), "peak_turn": range(SECTORS)})
"""Weight and rule of a match, its relative orientation, and the most common one."""


class MatchWeigher(Component):
    """Weight of each match; the rule base compares its relative orientation with the most common one.

    All pairs pass twice: first for the histogram of relative orientations, then to be weighed. Patterns without
    orientation skip the first pass.

    Parameters
    ----------
    config : MatcherConfig
        The rule base, for which the pattern carries a window if it needs one.
    pattern : DescriptorPattern
    max_features : int
    """

    i: stream.Interface
    """Stream of `hdl.matching.mutual_neighbours.pair_layout`. Accepted once it is counted, or with its weight."""
    i_left: data.View
    i_right: data.View
    """The pair's `banked_feature` on each side, ``READ_CYCLES`` after it is valid."""
    i_count: In(1)
    """Count the pairs instead of weighing them."""
    i_find: In(1)
    """Find the most common relative orientation, see `OrientationHistogram`."""
    o_busy: Out(1)
    """It is being searched for."""
    o: Out(stream.Signature(WEIGHED))

    def __init__(self, *, config: MatcherConfig, pattern: DescriptorPattern, max_features: int) -> None:
        self.rules = config.rules
        self.pattern = pattern
        self.max_features = max_features
        feature = banked_feature(pattern)
        super().__init__(
            i=In(stream.Signature(pair_layout(bits=pattern.bits, max_features=max_features))),
            i_left=In(feature),
            i_right=In(feature),
        )

    def elaborate(self, platform: object) -> Module:
        """Count, or wait for the features and weigh."""
        m = Module()
        orientation = Signal(range(SECTORS))
        peak = Signal(range(SECTORS))
        count = Signal()
        weigh = Signal()
        counted = Signal()
        weighed = Signal()
        # Angles wrap around: the signal's width takes the difference modulo SECTORS.
        m.d.sync += orientation.eq(self.i_right.sector - self.i_left.sector)
        if self.pattern.oriented:
            self._count(m, count, orientation, counted, peak)
        wait_cycles = READ_CYCLES + self._weigh(m, weigh, orientation, peak, weighed)

        waited = Signal(range(wait_cycles + 1))
        with m.If(self.i.ready | ~self.i.valid):
            m.d.sync += waited.eq(0)
        with m.Elif(waited != wait_cycles):
            m.d.sync += waited.eq(waited + 1)
        m.d.comb += [
            # Counting need not wait: its weight needs no features, and takes longer than the orientation.
            count.eq(self.i.valid & self.i_count),
            weigh.eq(self.i.valid & ~self.i_count & (waited == wait_cycles)),
            self.i.ready.eq(counted | weighed),
            self.o.payload.turn.eq(orientation),
            self.o.payload.peak_turn.eq(peak),
        ]
        return m

    def _count(self, m: Module, count: Value, orientation: Value, counted: Signal, peak: Signal) -> None:
        """Add the pair to the histogram, weighted by the fuzzy system for relative orientations."""
        pair = self.i.payload
        m.submodules.count_weight = weight = Sugeno(
            system=rule_bases.aerial_orientation(self.pattern.bits), value_bits=len(pair.distance)
        )
        m.submodules.histogram = histogram = OrientationHistogram(max_matches=self.max_features)
        m.d.comb += [
            weight.i.valid.eq(count),
            Cat(weight.i.payload).eq(Cat(pair.distance, pair.margin)),
            histogram.i.valid.eq(weight.o.valid),
            histogram.i.payload.relative_orientation.eq(orientation),
            histogram.i.payload.weight.eq(weight.o.payload.weight),
            weight.o.ready.eq(histogram.i.ready),
            counted.eq(weight.i.ready),
            histogram.i_find.eq(self.i_find),
            self.o_busy.eq(histogram.o_busy),
            peak.eq(histogram.o_peak),
        ]

    def _weigh(self, m: Module, weigh: Value, orientation: Value, peak: Value, weighed: Signal) -> int:
        """Evaluate the rule base. Returns how many clocks after the features its inputs are ready."""
        if self.rules is None:
            m.d.comb += [
                self.o.valid.eq(weigh),
                self.o.payload.weight.eq(WEIGHT.max_raw),
                weighed.eq(weigh & self.o.ready),
            ]
            return 1
        # The shorter way around the circle.
        ahead, behind = (orientation - peak)[: len(orientation)], (peak - orientation)[: len(orientation)]
        quantities = {"distance": self.i.payload.distance, "margin": self.i.payload.margin}
        quantities["orientation"], cycles = Mux(ahead < behind, ahead, behind), 1
        if self.rules.compares_windows:
            m.submodules.sad = sad = SumOfAbsoluteDifferences(pixels=self.pattern.window_bytes)
            m.d.comb += [Cat(sad.i_left).eq(self.i_left.window), Cat(sad.i_right).eq(self.i_right.window)]
            # Both regions have the same, as in the golden model.
            quantities["SAD_r1"] = quantities["SAD_r2"] = sad.o_sum
            cycles = sad.latency_cycles
        system = self.rules.tables(self.pattern.bits)
        values = [quantities[variable.name] for variable in system.inputs]
        m.submodules.weight = weight = Sugeno(system=system, value_bits=max(map(len, values)))
        m.d.comb += [sink.eq(value) for sink, value in zip(weight.i.payload, values, strict=True)]
        m.d.comb += [
            weight.i.valid.eq(weigh),
            weighed.eq(weight.i.ready),
            self.o.valid.eq(weight.o.valid),
            weight.o.ready.eq(self.o.ready),
            self.o.payload.weight.eq(weight.o.payload.weight),
            self.o.payload.rule.eq(weight.o.payload.rule),
        ]
        return cycles
