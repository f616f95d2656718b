"""Weighs matches by a fuzzy rule base, given the relative orientation that most of them share."""

from __future__ import annotations

from amaranth import Cat, Module, Mux, Signal, Value
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from golden_model.config import MatcherConfig
from golden_model.feature.ilbp import DescriptorPattern
from golden_model.feature.orientation import SECTORS
from golden_model.formats import WEIGHT
from golden_model.matching import rule_bases
from golden_model.matching.fuzzy import MAX_RULES
from hdl.matching.correlation import SumOfAbsoluteDifferences
from hdl.matching.feature_banks import READ_CYCLES, BankedFeature
from hdl.matching.fuzzy import Sugeno
from hdl.matching.mutual_neighbours import Pair
from hdl.matching.orientation_histogram import OrientationHistogram

WEIGHED = data.StructLayout(
    {"weight": WEIGHT.bits, "rule": range(MAX_RULES), "turn": range(SECTORS), "peak_turn": range(SECTORS)}
)


class MatchWeigher(wiring.Component):
    """Weight of each match; the rule base compares its relative orientation with the most common one.

    All pairs pass twice: first they are counted in the histogram of relative orientations, then they are weighed.
    Patterns without orientation skip the first pass.

    Parameters
    ----------
    config : MatcherConfig
        The rule base.
    pattern : DescriptorPattern
    max_features : int

    Members
    -------
    i : In(stream of Pair)
        Accepted when it was counted, or when its weight is accepted.
    i_left, i_right : In(BankedFeature)
        Features of the pair, ``READ_CYCLES`` after it is valid.
    i_count : In(1)
        Count the pairs instead of weighing them.
    i_find : In(1), o_busy : Out(1)
        Find the most common relative orientation; see `OrientationHistogram`.
    o : Out(stream of {weight: 8, rule: 5, turn: 4, peak_turn: 4})

    Raises
    ------
    ValueError
        If the rule base needs a window that the pattern does not carry.
    """

    i: stream.Interface
    i_left: data.View
    i_right: data.View
    i_count: Signal
    i_find: Signal
    o_busy: Signal
    o: stream.Interface

    def __init__(self, *, config: MatcherConfig, pattern: DescriptorPattern, max_features: int) -> None:
        if config.rule_base == "ilbp" and not pattern.carries_window:
            raise ValueError(
                f"rule base 'ilbp' needs the gray window around each feature, which {pattern.name} does not carry; "
                "use a thesis-ilbp descriptor or the rule base 'aerial'"
            )
        self.rule_base = config.rule_base
        self.pattern = pattern
        self.max_features = max_features
        feature = BankedFeature(pattern=pattern)
        super().__init__(
            {
                "i": In(stream.Signature(Pair(bits=pattern.bits, max_features=max_features))),
                "i_left": In(feature),
                "i_right": In(feature),
                "i_count": In(1),
                "i_find": In(1),
                "o_busy": Out(1),
                "o": Out(stream.Signature(WEIGHED)),
            }
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
        # Modulo SECTORS, as angles wrap around: the signal's width cuts the difference.
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
        """Add the pair to the histogram, weighted by the fuzzy system that serves only this histogram."""
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
        distance, margin = self.i.payload.distance, self.i.payload.margin
        if self.rule_base == "none":
            m.d.comb += [
                self.o.valid.eq(weigh),
                self.o.payload.weight.eq(WEIGHT.max_raw),
                weighed.eq(weigh & self.o.ready),
            ]
            return 1
        if self.rule_base == "aerial":
            ahead, behind = (orientation - peak)[: len(orientation)], (peak - orientation)[: len(orientation)]
            system, cycles = rule_bases.aerial(self.pattern.bits), 1
            values = [distance, margin, Mux(ahead < behind, ahead, behind)]
        else:
            m.submodules.sad = sad = SumOfAbsoluteDifferences(pixels=self.pattern.window_bytes)
            m.d.comb += [Cat(sad.i_left).eq(self.i_left.window), Cat(sad.i_right).eq(self.i_right.window)]
            system, cycles = rule_bases.ilbp(self.pattern.bits), sad.latency_cycles
            values = [distance, sad.o_sum, sad.o_sum]
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
