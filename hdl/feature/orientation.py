"""Orientation sector of a candidate from its rings, one group of angles per clock."""

from collections.abc import Sequence

from amaranth import Cat, Module, Mux, Shape, Signal, Value, signed, unsigned
from amaranth.lib.wiring import In, Out

from golden_model.feature.orientation import COSINES, HALF_SECTOR_TANGENTS, SECTORS, SINES, TANGENT_ONE
from hdl.lib.component import Component
from hdl.lib.delay import check_aligned, delayed, port_register
from hdl.lib.weighted_sum import WeightedSum


class RingMoments(Component):
    """Moments Mx, My of rings whose 16 angles arrive in groups, the last group first.

    Relative to its first angle, every group has the same weights, so that one set of adders serves all groups:
    M = P(0) + T (P(1) + T (P(2) + ...)), where P(g) are the moments of group g computed as if it were group 0, and T
    is the rotation by one group. A rotation by a quarter or a half circle only swaps and negates x and y.

    Parameters
    ----------
    radii_px : tuple of int
        Weight of each ring.
    groups : {1, 2, 4}
        Groups of a candidate; each takes one clock.
    """

    i_valid: In(1)
    """A group is at ``i_pixels``."""
    i_first: In(1)
    """The group is the first of its candidate."""
    i_pixels: Sequence[Sequence[Signal]]
    """Pixels of the group by ring and angle."""
    o_mx: Signal
    o_my: Signal
    """Mx and My, complete ``latency_cycles`` after a candidate's last group; valid until the next
    candidate's first group is added."""

    def __init__(self, *, radii_px: tuple[int, ...], groups: int) -> None:
        self.groups = groups
        group_angles = SECTORS // groups
        self._radial = [WeightedSum(weights=radii_px, shape=unsigned(8)) for _ in range(group_angles)]
        radial_shape = self._radial[0].o_sum.shape()
        self._along_x = WeightedSum(weights=COSINES[:group_angles], shape=radial_shape)
        self._along_y = WeightedSum(weights=SINES[:group_angles], shape=radial_shape)
        check_aligned("latency_cycles of the moments", x=self._along_x.latency_cycles, y=self._along_y.latency_cycles)
        self.latency_cycles = self._radial[0].latency_cycles + self._along_x.latency_cycles + 1
        # The largest moment has all pixels at 255 where the cosine is positive, and 0 elsewhere.
        bound = self._radial[0].high * sum(cosine for cosine in COSINES if cosine > 0)
        moment = signed(bound.bit_length() + 1)
        super().__init__(i_pixels=In(8).array(len(radii_px), group_angles), o_mx=Out(moment), o_my=Out(moment))

    def elaborate(self, platform: object) -> Module:
        """Radial sum per angle, projections of the sums on x and y, and the accumulator that rotates."""
        m = Module()
        m.submodules.along_x = along_x = self._along_x
        m.submodules.along_y = along_y = self._along_y
        for angle, radial in enumerate(self._radial):
            m.submodules[f"radial_{angle}"] = radial
            m.d.comb += [i_value.eq(ring[angle]) for i_value, ring in zip(radial.i_values, self.i_pixels, strict=True)]
            m.d.comb += radial.i_valid.eq(self.i_valid)
            m.d.comb += [along.i_values[angle].eq(radial.o_sum) for along in (along_x, along_y)]
        m.d.comb += [along.i_valid.eq(self._radial[0].o_valid) for along in (along_x, along_y)]
        mx = port_register(m, self.o_mx)
        my = port_register(m, self.o_my)
        if self.groups == 1:
            with m.If(along_x.o_valid):
                m.d.sync += [mx.eq(along_x.o_sum), my.eq(along_y.o_sum)]
            return m
        # Rotating by a quarter is (x, y) -> (-y, x), by a half (x, y) -> (-x, -y).
        first = delayed(m, self.i_first, self.latency_cycles - 1)
        rotated_x, rotated_y = (-self.o_my, self.o_mx) if self.groups == 4 else (-self.o_mx, -self.o_my)
        with m.If(along_x.o_valid):
            m.d.sync += [
                mx.eq(along_x.o_sum + Mux(first, 0, rotated_x)),
                my.eq(along_y.o_sum + Mux(first, 0, rotated_y)),
            ]
        return m


class Sector(Component):
    """Sector round(16 atan2(My, Mx) / 2 pi) mod 16 by two integer comparisons in the first octant; (0, 0) gives 0.

    Parameters
    ----------
    moment : Shape
        Signed shape of the moments. Its most negative number must not occur: its magnitude would not fit.
    spacing_cycles : int
        Smallest distance of two moments in clocks.
    """

    i_valid: In(1)
    i_mx: Signal
    i_my: Signal
    """Mx and My, where ``i_valid``."""
    o_sector: Out(4)
    """Valid ``latency_cycles`` after ``i_valid``, until the next result."""

    def __init__(self, *, moment: Shape, spacing_cycles: int = 2) -> None:
        self.spacing_cycles = spacing_cycles
        length = unsigned(moment.width - 1)
        self._borders = [WeightedSum(weights=(tangent, -TANGENT_ONE), shape=length) for tangent in HALF_SECTOR_TANGENTS]
        first, second = self._borders
        check_aligned("latency_cycles of the borders", first=first.latency_cycles, second=second.latency_cycles)
        self.latency_cycles = 3 + first.latency_cycles + 1
        super().__init__(i_mx=In(moment), i_my=In(moment))

    def elaborate(self, platform: object) -> Module:
        """Fold into the first octant, compare with the two sector borders inside it, unfold."""
        m = Module()
        length = self._borders[0].i_values[0].shape()
        along = Signal(length, reset_less=True)
        across = Signal(length, reset_less=True)
        left = Signal(reset_less=True)
        up = Signal(reset_less=True)
        with m.If(self.i_valid):
            m.d.sync += [
                left.eq(self.i_mx < 0),
                up.eq(self.i_my < 0),
                across.eq(Mux(self.i_mx < 0, -self.i_mx, self.i_mx)),
                along.eq(Mux(self.i_my < 0, -self.i_my, self.i_my)),
            ]

        folded = delayed(m, self.i_valid, 1, reset_less=False)
        compared = delayed(m, folded, 1, reset_less=False)
        sorted_out = delayed(m, compared, 1, reset_less=False)
        steep = Signal(reset_less=True)
        longer = Signal(length, reset_less=True)
        shorter = Signal(length, reset_less=True)
        # What is used for two clocks stays there only if the next moments do not follow in the next clock.
        held_cycles = int(self.spacing_cycles == 1)
        lengths = [delayed(m, length, held_cycles) for length in (along, across)]
        with m.If(folded):
            m.d.sync += steep.eq(along > across)
        with m.If(compared):
            m.d.sync += [longer.eq(Mux(steep, *lengths)), shorter.eq(Mux(steep, *reversed(lengths)))]

        for n, border in enumerate(self._borders):
            m.submodules[f"border_{n}"] = border
            m.d.comb += [border.i_valid.eq(sorted_out), border.i_values[0].eq(longer), border.i_values[1].eq(shorter)]
        beyond = [border.o_sum < 0 for border in self._borders]
        cycles = self._borders[0].latency_cycles
        # The folding bits wait for the comparisons with the borders, which use adders.
        octant = delayed(m, Cat(delayed(m, steep, held_cycles), delayed(m, Cat(left, up), 2)), cycles)
        sector = port_register(m, self.o_sector)
        with m.If(self._borders[0].o_valid):
            m.d.sync += sector.eq(self._unfold(m, beyond, *octant))
        return m

    @staticmethod
    def _unfold(m: Module, beyond: list[Value], steep: Value, left: Value, up: Value) -> Value:
        octant = Signal(4)
        quadrant = Signal(4)
        half = Signal(4)
        m.d.comb += [
            octant.eq(Mux(steep, SECTORS // 4 - (beyond[0] + beyond[1]), beyond[0] + beyond[1])),
            quadrant.eq(Mux(left, SECTORS // 2 - octant, octant)),
            half.eq(Mux(up, -quadrant, quadrant)),
        ]
        return half
