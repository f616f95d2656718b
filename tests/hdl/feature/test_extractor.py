"""Ring window and features together equal the golden model, for corners at chosen positions.

It stands for tests of its parts, whose wrong lines it notices in samples: `ring_window` and `subpixel`.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from amaranth import Module
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out
from numpy.typing import NDArray

from golden_model.feature import ilbp, subpixel
from golden_model.feature.ilbp import DescriptorPattern
from golden_model.matching.correlation import windows
from hdl.blocks.vectors import Block, pixel_rows, rows
from hdl.feature.extractor import CandidateFeatures, feature_layout
from hdl.feature.ring_window import RingWindow
from hdl.lib.delay import delayed
from hdl.pixel.nms import NEIGHBOURHOOD
from hdl.streams import COORDINATE, beat, carry_scan
from sim.benches.rows import check

NEIGHBOURS = {"left": (-1, 0), "right": (1, 0), "up": (0, -1), "down": (0, 1)}


class Describer(wiring.Component):
    """Takes pixels and candidates of the same scan position as beats, and sends features as beats."""

    def __init__(self, *, pattern: DescriptorPattern, spacing_cycles: int, level: int, width_px: int) -> None:
        self.window = RingWindow(pattern=pattern, width_px=width_px)
        self.features = CandidateFeatures(
            pattern=pattern, spacing_cycles=spacing_cycles, level=level, lag_px=self.window.lag_px
        )
        self.latency_cycles = self.window.latency_cycles - 1 + self.features.latency_cycles
        super().__init__(
            {
                "i": In(beat(pixel=8, ends_row=1, ends_level=1, **NEIGHBOURHOOD)),
                "o": Out(beat(present=1, ends_row=1, ends_level=1, column=COORDINATE, feature=feature_layout(pattern))),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.submodules.window, m.submodules.features = window, features = self.window, self.features
        m.d.comb += window.i.pixel.eq(self.i.pixel)
        carry_scan(m, self.i, window.i, 0)
        carry_scan(m, self.i, features.i, window.latency_cycles - 1)
        present = self.i.valid & self.i.code.any()
        m.d.comb += features.i.present.eq(delayed(m, present, window.latency_cycles - 1, reset_less=False))
        for name in ("ends_row", "ends_level", *NEIGHBOURHOOD):
            m.d.comb += features.i[name].eq(delayed(m, self.i[name], window.latency_cycles - 1))
        for i_ring, ring in zip(features.i_pixels, window.o_pixels, strict=True):
            m.d.comb += [i_pixel.eq(pixel) for i_pixel, pixel in zip(i_ring, ring, strict=True)]
        carry_scan(m, self.i, self.o, self.latency_cycles)
        m.d.comb += self.o.column.eq(features.o.x)
        for name in ("present", "ends_row", "ends_level", "feature"):
            m.d.comb += self.o[name].eq(features.o[name])
        return m


def golden_features(
    pixels: NDArray[np.uint8],
    code: NDArray[np.uint16],
    *,
    pattern: DescriptorPattern,
    level: int,
    at: tuple[NDArray[np.int64], NDArray[np.int64]],
) -> list[dict[str, int]]:
    """The features at (x, y), by the names of `feature_layout`."""
    x, y = at
    sector, descriptor = ilbp.describe(pixels, pixels, x, y, pattern)
    full_x, full_y = subpixel.refine(code, x, y, level)
    fields: dict[str, NDArray[Any]] = {"response": code[y, x], "x": full_x, "y": full_y, "sector": sector}
    octets = {"descriptor": descriptor}
    if pattern.carries_window:
        octets["window"] = windows(pixels, x, y, size_px=3)
    return [
        {name: int(values[n]) for name, values in fields.items()}
        | {name: int.from_bytes(values[n].tobytes(), "little") for name, values in octets.items()}
        for n in range(len(x))
    ]


@pytest.mark.parametrize(
    ("name", "spacing_cycles", "level", "codes"),
    [("ilbp-128", 4, 0, range(8000)), ("ilbp-128", 2, 1, (15, 17)), ("thesis-ilbp-4", 1, 0, range(8000))],
)
def test_features_equal_the_golden_model(name: str, spacing_cycles: int, level: int, codes: Sequence[int]) -> None:
    """Between codes of 15 and 17, the vertex of a corner of 32 lies halfway between two sixteenths of a pixel."""
    pattern = ilbp.PATTERNS[name]
    lag_px = max(pattern.radii_px)
    shape = height, width = 2 * lag_px + 4, 2 * lag_px + 10
    dut = Describer(pattern=pattern, spacing_cycles=spacing_cycles, level=level, width_px=width)
    rng = np.random.default_rng(17)
    sent: list[Any] = []
    answers: list[Any] = []
    for _ in range(1 + (lag_px < 10)):
        pixels = rng.integers(0, 256, shape, dtype=np.uint8)
        code = rng.choice(codes, shape).astype(np.uint16)
        candidates = np.zeros(shape, bool)
        # As dense as suppression allows, and in the first and last columns that have a complete ring.
        candidates[lag_px : height - lag_px : 2, lag_px : width - lag_px : max(2, spacing_cycles)] = True
        candidates[lag_px + 2] = False
        candidates[lag_px + 2, [lag_px, width - lag_px - 1]] = True
        code[candidates] = 32 if len(codes) == 2 else code[candidates] + 9000
        planes = {"code": np.where(candidates, code, 0)}
        planes |= {side: np.roll(code, (-dy, -dx), (0, 1)) for side, (dx, dy) in NEIGHBOURS.items()}
        planes |= {mark: rng.integers(0, 2, shape) for mark in ("ends_row", "ends_level")}
        at_scan = {plane: np.roll(values, (lag_px, lag_px), (0, 1)) for plane, values in planes.items()}
        sent += pixel_rows(pixel=pixels, **at_scan)
        y, x = np.nonzero(candidates)
        found = golden_features(pixels, code, pattern=pattern, level=level, at=(x, y))
        features = dict(zip(zip(x + lag_px, y + lag_px, strict=True), found, strict=True))
        for scan_y, scan_x in np.ndindex(shape):
            marks = {mark: int(at_scan[mark][scan_y, scan_x]) for mark in ("ends_row", "ends_level")}
            feature = features.get((scan_x, scan_y))
            there = {"column": scan_x - lag_px, "feature": feature} if feature else {}
            answers.append({"x": scan_x, "y": scan_y, "present": feature is not None, **there, **marks})
    check(Block(dut, "", {"i": sent}, {"o": rows("o", answers)}))
