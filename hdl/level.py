"""Extracts the features of one level: gray pixels in, feature records out."""

from amaranth import Cat, Module, Mux, Signal, Value
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from golden_model.config import DETECTORS, FrontEndConfig
from golden_model.formats import RESPONSE_CODE
from hdl.feature.extractor import CandidateFeatures
from hdl.feature.ring_window import RingWindow
from hdl.lib.component import Component
from hdl.lib.delay import check_aligned, delayed, wait_cycles
from hdl.lib.views import view_signal
from hdl.pixel.corners import Corners, Stage
from hdl.pixel.smooth import Binomial
from hdl.pixel.window import LineBuffer, OffsetColumns
from hdl.selection.level_scan import LevelScan
from hdl.selection.record_serializer import FeatureWords
from hdl.selection.selection import CellSelection, RasterSelection
from hdl.streams import CANDIDATE, FRONT_END_SETTINGS, RowPayload, beat, carry_scan, pixel_beats, pixelwise

INGRESS_CYCLES = 16
"""Upper bound of two delays together: admission of a pixel to its beat here, and ``o_hold`` to the last admission."""
RASTER_DEPTH = 512
"""Depth of the queue of features where there is no selection."""


class Level(Component):
    """Corners, descriptors and selection of one level.

    One memory of gray lines serves corners and descriptors. The path with the smaller lag takes its gray from further
    up and left, so that a corner arrives together with the descriptor's window around it. Delaying the gray instead of
    the results costs nothing: its lines are in memory anyway.

    Parameters
    ----------
    config : FrontEndConfig
    level : {0, 1}
    width_px : int
        Largest width of this level's lines.
    pixels_per_clock : {1, 2}
        Pixels of the full frame per clock. A half-size level always has one pixel per beat.
    """

    i: data.View
    """Beats of gray ``pixel``, at most one per clock."""
    i_settings: In(FRONT_END_SETTINGS)
    """`hdl.streams.FRONT_END_SETTINGS`, stable from 2 clocks before a frame's first beat. Width and height are those of
    the full size."""
    i_threshold_code: In(RESPONSE_CODE.bits)
    """Smallest response code that survives. Stable during a frame."""
    o_hold: Out(1)
    """Admit no more pixels: a cell row would end before the previous one has left. It rises `WARNING_BEATS` beats
    early, to leave room for the pixels that are already in the pipeline."""
    o_added: Out(1)
    """The frame has one more feature."""
    o: Out(stream.Signature(RowPayload))

    lag_px: int
    """From the scan position to the candidate's pixel."""
    latency_cycles: int
    """From a beat to the arrival of its feature at the selection."""
    closing_lines: int
    """Lines at the bottom of the full frame that this level needs in order to close."""

    def __init__(self, *, config: FrontEndConfig, level: int, width_px: int, pixels_per_clock: int = 1) -> None:
        self.level = level
        self.pattern = pattern = config.pattern
        self.pixels_per_clock = max(pixels_per_clock >> level, 1)
        rate = {"pixels_per_clock": self.pixels_per_clock}
        self._corners = Corners(config=config, width_px=width_px, **rate)
        # A window of one pixel passes the gray unchanged: one structure serves all patterns.
        self._smooth = Binomial(window_px=5 if pattern.smoothed else 1, **rate)
        self._rings = RingWindow(pattern=pattern, width_px=width_px, **rate)
        # Corners need lines below the pixel as well as above it, and so does the descriptor: the larger lag decides.
        ring_lag_px = self._smooth.lag_px + self._rings.lag_px
        self.lag_px = max(self._corners.lag_px, ring_lag_px)
        check_aligned("lag_px", blocks=self.lag_px, configured=config.lag_px)
        self._scan = LevelScan(lag_px=self.lag_px, border_px=config.border_px, cells=config.selection, **rate)
        # A half-size line is two lines of the full size, and an odd last line belongs to none.
        self.closing_lines = (self._scan.closing_lines << level) + level
        # Corners of FAST may be 2 px apart in a line. A half-size pixel takes twice the time, hence twice the distance.
        spacing_cycles = (2 << level) // pixels_per_clock
        self._features = CandidateFeatures(
            pattern=pattern, spacing_cycles=spacing_cycles, level=level, lag_px=self.lag_px
        )
        self._gray_for_corners = OffsetColumns(rows=3, distance_px=self.lag_px - self._corners.lag_px, **rate)
        self._gray_for_rings = OffsetColumns(rows=self._smooth.window_px, distance_px=self.lag_px - ring_lag_px, **rate)
        offsets = (self._gray_for_corners, self._gray_for_rings)
        lines = max(offset.distance_px + offset.rows for offset in offsets) - 1
        self._lines = LineBuffer(shape=8, lines=lines, width_px=width_px, **rate)
        gray_cycles = self._lines.latency_cycles + OffsetColumns.latency_cycles
        candidate_cycles = gray_cycles + self._corners.latency_cycles + 1
        ring_cycles = gray_cycles + self._smooth.latency_cycles + self._rings.latency_cycles
        # `inside` meets the corner in front of the candidate's register, the other marks behind it; the ring pixels
        # come one clock after their candidate.
        self._scan_wait_cycles = wait_cycles("marks of the scan", self._scan.latency_cycles, until=candidate_cycles - 1)
        self._ring_wait_cycles = wait_cycles("ring pixels", ring_cycles, until=candidate_cycles + 1)
        self.latency_cycles = candidate_cycles + self._features.latency_cycles
        self._selection: CellSelection | RasterSelection
        if config.selection:
            self._selection = CellSelection(pattern=pattern, width_px=width_px, spacing_cycles=spacing_cycles)
        else:
            # The distance between features limits how many may still come after the hold.
            in_flight = (INGRESS_CYCLES + self.latency_cycles) // spacing_cycles + 1
            self._selection = RasterSelection(pattern=pattern, depth=RASTER_DEPTH, in_flight=in_flight)
        super().__init__(i=In(beat(self.pixels_per_clock, pixel=8)))
        self._candidate = view_signal(CANDIDATE)

    @property
    def stages(self) -> dict[str, Stage]:
        """Intermediate planes, by their names in `golden_model.front_end.trace`."""
        smoothed = pixel_beats(self._smooth.o, self.pixels_per_clock)
        return {
            "gray": Stage(pixel_beats(self.i, self.pixels_per_clock), "pixel", 0),
            **{
                name: stage._replace(lag_px=stage.lag_px + self._gray_for_corners.distance_px)
                for name, stage in self._corners.stages.items()
            },
            "candidates": Stage([self._candidate], "code", self.lag_px),
            "smoothed5": Stage(smoothed, "pixel", self.lag_px - self._rings.lag_px),
        }

    def elaborate(self, platform: object) -> Module:
        """Build both paths from the gray lines to the candidate, then features, selection and words."""
        m = Module()
        m.submodules.lines = lines = self._lines
        m.submodules.corners = corners = self._corners
        m.submodules.smooth = smooth = self._smooth
        m.d.comb += [
            lines.i.eq(self.i),
            corners.i.eq(self._offset_columns(m, "gray_for_corners", self._gray_for_corners)),
            corners.i_fast.eq(self.i_settings.detector == DETECTORS.index("fast")),
            corners.i_threshold_code.eq(self.i_threshold_code),
            smooth.i.eq(self._offset_columns(m, "gray_for_rings", self._gray_for_rings)),
        ]
        self._connect_candidate(m)
        self._connect_features(m)
        self._connect_selection(m)
        return m

    def _offset_columns(self, m: Module, name: str, offset: OffsetColumns) -> data.View:
        m.submodules[name] = offset
        carry_scan(m, self._lines.o, offset.i, 0)
        for column, i_column in pixelwise(self.pixels_per_clock, self._lines.o.column, offset.i.column):
            m.d.comb += [pixel.eq(column[n]) for n, pixel in enumerate(i_column)]
        return offset.o

    def _connect_candidate(self, m: Module) -> None:
        """Keep the corners inside the border, and add the marks of their scan position."""
        m.submodules.scan = scan = self._scan
        m.d.comb += [
            scan.i.eq(self.i),
            scan.i_width_px.eq(self.i_settings.width_px >> self.level),
            scan.i_height_px.eq(self.i_settings.height_px >> self.level),
            scan.i_cell_log2.eq(self.i_settings.cell_log2),
        ]
        # The scan is short, the corner pipeline long: the marks wait.
        inside = delayed(m, scan.o.inside, self._scan_wait_cycles)
        ends = delayed(m, Cat(scan.o.ends_row, scan.o.ends_level), self._scan_wait_cycles + 1)
        corners = self._corners.o
        carry_scan(m, corners, self._candidate, 1)
        m.d.comb += Cat(self._candidate.ends_row, self._candidate.ends_level).eq(ends)
        corner = pixel_beats(corners, self.pixels_per_clock)[0]
        if self.pixels_per_clock == 2:
            corner, inside = self._corner_of_two(m, inside)
        m.d.comb += [
            self._candidate.present.eq(delayed(m, corner.valid & inside & corner.code.any(), 1, reset_less=False)),
            self._candidate.code.eq(delayed(m, Mux(inside, corner.code, 0), 1)),
        ]
        for name in ("left", "right", "up", "down"):
            m.d.comb += self._candidate[name].eq(delayed(m, corner[name], 1))

    def _corner_of_two(self, m: Module, inside: Value) -> tuple[data.View, Value]:
        """Choose the pixel of the beat that is a corner; return it, and whether it is inside the border.

        Two neighbours are never both corners (`hdl.pixel.nms`), but each may be inside or outside.
        """
        left, right = pixel_beats(self._corners.o, 2)
        is_right = Signal()
        m.d.comb += is_right.eq(inside[1] & right.code.any())
        corner = data.View(left.shape(), Mux(is_right, right.as_value(), left.as_value()))
        chosen = delayed(m, is_right, 1)
        m.d.comb += self._candidate.x[0].eq(chosen)
        # The ring pixels come a clock after the candidate.
        m.d.comb += self._rings.i_second.eq(delayed(m, chosen, 1))
        return corner, Mux(is_right, 1, inside[0])

    def _connect_features(self, m: Module) -> None:
        """Delay the smoothed pixels so that the ring pixels come one clock after their candidate."""
        m.submodules.rings = rings = self._rings
        m.submodules.features = features = self._features
        carry_scan(m, self._smooth.o, rings.i, self._ring_wait_cycles)
        m.d.comb += [
            rings.i.pixel.eq(delayed(m, self._smooth.o.pixel, self._ring_wait_cycles)),
            features.i.eq(self._candidate),
        ]
        for i_ring, ring in zip(features.i_pixels, rings.o_pixels, strict=True):
            m.d.comb += [i_pixel.eq(pixel) for i_pixel, pixel in zip(i_ring, ring, strict=True)]

    def _connect_selection(self, m: Module) -> None:
        m.submodules.selection = selection = self._selection
        m.submodules.words = feature_words = FeatureWords(pattern=self.pattern, level=self.level)
        wiring.connect(m, selection.o, feature_words.i)
        wiring.connect(m, feature_words.o, wiring.flipped(self.o))
        m.d.comb += [selection.i.eq(self._features.o), self.o_added.eq(selection.o_added)]
        m.d.comb += self.o_hold.eq(selection.connect_hold(m, self.i_settings, self._scan))
