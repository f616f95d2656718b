"""Turns candidates into features: position, orientation sector and descriptor."""

from collections.abc import Sequence

from amaranth import Cat, Module, Signal, Value
from amaranth.lib import data
from amaranth.lib.wiring import In, Out

from golden_model.feature.ilbp import DescriptorPattern
from hdl.feature.ilbp import RingDescriptor
from hdl.feature.subpixel import SubPixel
from hdl.lib.component import Component
from hdl.lib.delay import delayed
from hdl.streams import CANDIDATE, COORDINATE

_LEVEL_CONSTANTS = ("level", "reserved", "index", "frame")
"""Fields that are the same for all features of a level, or filled in after it."""


def feature_layout(pattern: DescriptorPattern) -> data.StructLayout:
    """Layout of a feature inside its level: the fields of `feature_record` except level, index and frame."""
    record = pattern.record
    return data.StructLayout({field.name: field.bits for field in record.fields if field.name not in _LEVEL_CONSTANTS})


def feature_beat(pattern: DescriptorPattern) -> data.StructLayout:
    """Layout of a beat: pixel column ``x``, its feature if ``present``, and whether a cell row or the level ends."""
    return data.StructLayout(
        {"present": 1, "ends_row": 1, "ends_level": 1, "x": COORDINATE, "feature": feature_layout(pattern)}
    )


def feature_or_end(pattern: DescriptorPattern) -> data.StructLayout:
    """Layout after the selection: a feature, or, where ``ends_row``, no feature but the end of a cell row."""
    return data.StructLayout({"feature": feature_layout(pattern), "ends_row": 1, "ends_level": 1})


class CandidateFeatures(Component):
    """Computes position, orientation sector and descriptor of every candidate.

    Parameters
    ----------
    pattern : DescriptorPattern
    spacing_cycles : {1, 2, 4}
        Minimum distance of two candidates in clocks.
    level : {0, 1}
    lag_px : int
        How far the candidate's pixel is left of and above the scan position.

    Raises
    ------
    ValueError
        For a smoothed pattern that carries a gray window.
    """

    i: In(CANDIDATE)
    i_pixels: Sequence[Sequence[Signal]]
    """`hdl.feature.ring_window.RingWindow.o_pixels` of the same scan position, by ring and angle, one clock after
    ``i``."""
    o: data.View
    """`feature_beat`, ``latency_cycles`` after the candidate."""

    def __init__(self, *, pattern: DescriptorPattern, spacing_cycles: int, level: int, lag_px: int) -> None:
        if pattern.carries_window and pattern.smoothed:
            raise ValueError(f"{pattern.name} carries a gray window, but its rings are smoothed")
        self.pattern = pattern
        self.lag_px = lag_px
        self._descriptor = RingDescriptor(pattern=pattern, spacing_cycles=spacing_cycles)
        self._position = SubPixel(level=level, lag_px=lag_px, spacing_cycles=spacing_cycles)
        self.latency_cycles = max(self._descriptor.latency_cycles, self._position.latency_cycles)
        super().__init__(i_pixels=In(8).array(len(pattern.radii_px), pattern.angles), o=Out(feature_beat(pattern)))

    def elaborate(self, platform: object) -> Module:
        """Compute descriptor and position side by side, and delay the faster one to the other's latency."""
        m = Module()
        m.submodules.descriptor = descriptor = self._descriptor
        m.submodules.position = position = self._position
        m.d.comb += [descriptor.i_candidate.eq(self.i.present), position.i.eq(self.i)]
        for i_ring, ring in zip(descriptor.i_pixels, self.i_pixels, strict=True):
            m.d.comb += [i_pixel.eq(pixel) for i_pixel, pixel in zip(i_ring, ring, strict=True)]

        feature = self.o.feature
        for wait_cycles, source, target in (
            (self.latency_cycles - position.latency_cycles, position.o_x, feature.x),
            (self.latency_cycles - position.latency_cycles, position.o_y, feature.y),
            (self.latency_cycles - descriptor.latency_cycles, descriptor.o_sector, feature.sector),
            (self.latency_cycles - descriptor.latency_cycles, descriptor.o_descriptor, feature.descriptor),
            (self.latency_cycles, self.i.code, feature.response),
            (self.latency_cycles, (self.i.x - self.lag_px)[: len(self.i.x)], self.o.x),
        ):
            m.d.comb += target.eq(delayed(m, source, wait_cycles))
        if self.pattern.carries_window:
            # Ring pixels come one clock after the candidate.
            m.d.comb += feature.window.eq(delayed(m, self._window(), self.latency_cycles - 1))
        # Only the marks are reset: the rest has no effect without them.
        marks = Cat(self.i.present, self.i.valid & self.i.ends_row, self.i.valid & self.i.ends_level)
        delayed_marks = delayed(m, marks, self.latency_cycles, reset_less=False)
        m.d.comb += Cat(self.o.present, self.o.ends_row, self.o.ends_level).eq(delayed_marks)
        return m

    def _window(self) -> Value:
        """Return the 3x3 gray window: the pixels of the innermost square rings."""
        offsets = [offset for ring in self.pattern.offsets for offset in ring]
        pixels = [pixel for ring in self.i_pixels for pixel in ring]
        pixel_at = dict(zip(offsets, pixels, strict=True))
        return Cat(pixel_at[dx, dy] for dy in (-1, 0, 1) for dx in (-1, 0, 1))
