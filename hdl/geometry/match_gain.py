"""How well a homography fits a match: the truncated quadratic of the error, by comparisons instead of a division."""

from amaranth import Cat, Const, Module, Mux, Shape, Signal, Value, signed
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from golden_model.formats import POSITION, WEIGHT
from golden_model.geometry import match_gain
from golden_model.geometry.fixed_point import ENTRY
from golden_model.geometry.match_gain import ERROR, LEVEL_BITS, LEVELS, TERM_SHIFT
from hdl.lib.delay import delayed, port_register
from hdl.lib.multiplier import multiply_wide

PAIR = data.StructLayout(dict.fromkeys(("left_x", "left_y", "right_x", "right_y"), POSITION.bits))
"""Positions of a match, as match records have them."""
WEIGHED_PAIR = data.StructLayout({"pair": PAIR, "weight": WEIGHT.bits})
HYPOTHESIS = data.ArrayLayout(signed(ENTRY.bits), 9)
"""A homography row by row, see `golden_model.geometry.fixed_point.quantise`."""
PRODUCT_CYCLES = 2
"""A product passes the multiplier's own M and P registers; its operands come from registers."""
TERM_CYCLES = PRODUCT_CYCLES + 2
ERROR_CYCLES = PRODUCT_CYCLES + 2


class MatchGain(wiring.Component):
    """Gain of a match under a hypothesis, one pair of them per clock; equal to `golden_model.geometry.match_gain`.

    The three terms are linear in the left position. Two products of the third term, the depth, with the right position
    give the errors in x and y, and three squares follow; then one comparison per bit of the gain. This takes 11
    multipliers of at most 25 x 18 bits.
    """

    i_hypothesis: In(HYPOTHESIS)
    """From a register; may change in every clock."""
    i_match: In(PAIR)
    """From a register; may change in every clock."""
    o_gain: Out(range(LEVELS + 1))
    """0 where the match does not support the hypothesis."""

    # Terms; errors; squares and their sums; the first comparison, one per bit; the gain.
    latency_cycles = TERM_CYCLES + ERROR_CYCLES + (PRODUCT_CYCLES + 1) + (1 + LEVEL_BITS) + 1
    """From hypothesis and match to their gain."""

    def elaborate(self, platform: object) -> Module:
        """Terms, errors, squares, comparisons. No register has a reset or waits."""
        m = Module()
        x, y, depth = (self._term(m, platform, row) for row in range(3))
        right = [delayed(m, self.i_match[name], TERM_CYCLES) for name in ("right_x", "right_y")]
        error_x = self._error(m, platform, x, right[0], depth)
        error_y = self._error(m, platform, y, right[1], depth)
        in_front = Signal(range(match_gain.MAX_DEPTH + 1), reset_less=True)
        # A depth of 0 makes every error too large: behind the camera no match counts.
        m.d.sync += in_front.eq(Mux(depth < 0, 0, depth >> match_gain.DEPTH_SHIFT))
        distance = delayed(m, in_front, ERROR_CYCLES - 1)
        square_x, square_y, square = (delayed(m, side * side, PRODUCT_CYCLES) for side in (error_x, error_y, distance))
        squared_error = Signal(range(match_gain.MAX_SQUARED_ERROR + 1), reset_less=True)
        squared_depth = Signal(range(match_gain.MAX_SQUARED_DEPTH + 1), reset_less=True)
        m.d.sync += [
            # Times 8 and times 9, see `golden_model.geometry.match_gain.DEPTH_FACTOR`.
            squared_error.eq((square_x + square_y) << 3),
            squared_depth.eq((square << 3) + square),
        ]
        self._compare(m, squared_error, squared_depth)
        return m

    def _term(self, m: Module, platform: object, row: int) -> Signal:
        """Compute ``h0 x + h1 y + h2 2^16`` for a row of the hypothesis, rounded."""
        h0, h1, h2 = (self.i_hypothesis[3 * row + column] for column in range(3))
        product_x = multiply_wide(m, platform, h0, self.i_match.left_x)
        product_y = multiply_wide(m, platform, h1, self.i_match.left_y)
        linear = delayed(m, product_x + product_y, 1)
        constant = delayed(m, h2, PRODUCT_CYCLES + 1)
        half = 1 << TERM_SHIFT - 1
        rounded = Signal(_shape(match_gain.MAX_SUM + half), name=f"rounded{row}")
        term = Signal(_shape(match_gain.MAX_TERM), name=f"term{row}", reset_less=True)
        m.d.comb += rounded.eq(linear + (constant << POSITION.bits) + half)
        m.d.sync += term.eq(rounded >> TERM_SHIFT)
        return term

    @staticmethod
    def _error(m: Module, platform: object, term: Value, right: Value, depth: Value) -> Signal:
        """Compute the error of one coordinate times the depth, limited."""
        product = multiply_wide(m, platform, depth, right)
        waiting = delayed(m, term, PRODUCT_CYCLES)
        miss = Signal(_shape(match_gain.MAX_MISS), reset_less=True)
        m.d.sync += miss.eq((waiting << POSITION.bits) - product)
        shifted = miss >> match_gain.ERROR_SHIFT
        error = Signal(signed(ERROR.bits), reset_less=True)
        # It fits where all bits above the format's are copies of its sign.
        excess = shifted[ERROR.bits - 1 :]
        limit = Mux(miss < 0, Const(ERROR.min_raw, signed(ERROR.bits)), ERROR.max_raw)
        m.d.sync += error.eq(Mux(excess.all() | ~excess.any(), shifted, limit))
        return error

    def _compare(self, m: Module, squared_error: Value, squared_depth: Value) -> None:
        """Compute the level, 32 squared_error / squared_depth rounded down: each step decides one of its bits."""
        near = delayed(m, squared_error < squared_depth, 1)
        divisor = delayed(m, squared_depth, 1)
        # Where the error is not smaller, bits are cut, but then the level does not matter.
        remainder = delayed(m, squared_error[: len(squared_depth)], 1)
        level: Value = Const(0, 0)
        for _ in range(LEVEL_BITS):
            doubled = remainder << 1
            left_over = doubled - divisor
            fits = left_over >= 0
            level = delayed(m, Cat(fits, level), 1)
            remainder = delayed(m, Mux(fits, left_over, doubled)[: len(divisor)], 1)
            divisor = delayed(m, divisor, 1)
            near = delayed(m, near, 1)
        gain = port_register(m, self.o_gain)
        m.d.sync += gain.eq(Mux(near, LEVELS - level, 0))


def _shape(largest: int) -> Shape:
    """Shape of signed numbers up to this magnitude."""
    return Shape.cast(range(-largest, largest + 1))
