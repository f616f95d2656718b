"""Windows of a frame in block RAM, and bilinear interpolation in them."""

from amaranth import Cat, Const, Module, Mux, Signal, Value
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from golden_model.painting.positions import POSITION
from golden_model.painting.sampling import WEIGHT_BITS
from golden_model.painting.windows import WINDOW_PX
from hdl.lib.delay import delayed, wait_cycles
from hdl.lib.line_memory import LineMemory
from hdl.lib.multiplier import Multiplier, multiply
from hdl.lib.result_queue import ResultQueue, queue_results
from hdl.painting.positions import POSITION_PAYLOAD
from hdl.painting.tiles import FRAME_SIDE

CHANNELS = 3
COLOUR = data.ArrayLayout(8, CHANNELS)
"""Blue, green, red."""
PIXEL = data.StructLayout({"colour": COLOUR, "weight": WEIGHT_BITS})
"""A pixel of a frame with its weight, or of the canvas; in memory four bytes, blue first."""
BANK_WORDS = (WINDOW_PX // 2) ** 2
WINDOW_LOG2 = WINDOW_PX.bit_length() - 1
WINDOW_WRITE = data.StructLayout(
    {
        "valid": 1,
        "y": WINDOW_LOG2,
        "x": WINDOW_LOG2 - 1,
        "pixels": data.ArrayLayout(COLOUR, 2),
        "kept": data.ArrayLayout(1, 2),
    }
)
"""Two pixels of the frame side by side: the lower bits of their y, and the `window_column` of half the x of the left
one, which is even. Those that are not ``kept`` are not written."""
ADDRESS_CYCLES = 1
INTERPOLATION_CYCLES = Multiplier.latency_cycles + 1
READ_CYCLES = ADDRESS_CYCLES + LineMemory.latency_cycles
PIPELINE_CYCLES = READ_CYCLES + 2 * INTERPOLATION_CYCLES
WEIGHING_CYCLES = 2


class Sampling(wiring.Component):
    """Colours and weights of a frame at positions; equal to `golden_model.painting.sampling.sample`.

    Two windows of up to 64 x 128 pixels, or a wide one of 128 x 128, wait in four memories, by the parity of x and y:
    the four pixels around any position are read in the same clock. Their place is given by the lower bits of their
    coordinates in the frame, so a window may begin anywhere. The throughput is one pixel per clock. Nine multipliers.
    """

    i_width_px: In(FRAME_SIDE)
    """Size of the frame; constant while it is painted."""
    i_height_px: In(FRAME_SIDE)
    i_write: In(WINDOW_WRITE)
    """Not into a window that is read."""
    i: In(stream.Signature(POSITION_PAYLOAD))
    o: Out(stream.Signature(PIXEL))
    """In the order of the positions; weight 0 outside the frame, where the colour means nothing."""

    latency_cycles = PIPELINE_CYCLES + ResultQueue.latency_cycles
    """From a position to its pixel, where no pixel waits."""

    def elaborate(self, platform: object) -> Module:
        """Interpolate along x, then along y; find the weight meanwhile."""
        m = Module()
        queue = queue_results(m, self.i, self.o, pipeline_cycles=PIPELINE_CYCLES)
        position = self.i.payload
        banks = self._read(m)
        across = delayed(m, _share_of_odd(position.x), READ_CYCLES)
        down = delayed(m, _share_of_odd(position.y), READ_CYCLES + INTERPOLATION_CYCLES)
        result = data.View(PIXEL, queue.i_result)
        for n in range(CHANNELS):
            rows = []
            for parity, (even, odd) in enumerate(banks):
                # Half a step of the result enters here, where no adder is needed for it.
                start = Cat(Const(POSITION.one >> 1, POSITION.fraction_bits), even[n])
                rows.append(_interpolate(m, f"channel{n}_row{parity}", start, odd[n] - even[n], across))
            upper, lower = rows
            start = Cat(Const(0, POSITION.fraction_bits), upper)
            between = _interpolate(m, f"channel{n}", start, lower - upper, down)
            m.d.comb += result.colour[n].eq(between[2 * POSITION.fraction_bits :])
        weight, cycles = self._weigh(m)
        waiting = wait_cycles("weights", cycles, until=PIPELINE_CYCLES)
        m.d.comb += result.weight.eq(delayed(m, weight, waiting))
        return m

    def _read(self, m: Module) -> list[list[data.View]]:
        """Write windows, and read the four pixels around a position; by the parity of their y, then of their x."""
        position, written = self.i.payload, self.i_write
        # The even one of two neighbours is the left one or the upper one, or follows it.
        x, y = (
            [(half + parity)[: len(half)], half] for half, parity in map(_half_and_parity, (position.x, position.y))
        )
        x = [window_column(each, position.wide, position.window) for each in x]
        x, y = ([delayed(m, each, ADDRESS_CYCLES) for each in halves] for halves in (x, y))
        banks: list[list[data.View]] = [[], []]
        for n in range(4):
            bottom, right = divmod(n, 2)
            m.submodules[f"bank{bottom}{right}"] = bank = LineMemory(shape=COLOUR, depth=BANK_WORDS)
            m.d.comb += [
                bank.i_write.eq(written.valid & written.kept[right] & (written.y[0] == bottom)),
                bank.i_write_address.eq(Cat(written.x, written.y[1:])),
                bank.i_word.eq(written.pixels[right]),
                bank.i_read.eq(1),
                bank.i_read_address.eq(Cat(x[right], y[bottom])),
            ]
            banks[bottom].append(data.View(COLOUR, bank.o_word))
        return banks

    def _weigh(self, m: Module) -> tuple[Value, int]:
        """The weight of a position, and the clocks that it takes."""
        position = self.i.payload
        x, y = (each[POSITION.fraction_bits :].as_signed() for each in (position.x, position.y))
        # All four pixels around a position count: at 0 one of them is outside.
        last_x, last_y = delayed(m, self.i_width_px - 1, 1), delayed(m, self.i_height_px - 1, 1)
        distances = [Mux(position.blank, 0, x + 1), last_x - x, y + 1, last_y - y]
        left, right, top, bottom = (delayed(m, each, 1) for each in distances)
        nearest = smaller(m, smaller(m, left, right), smaller(m, top, bottom))
        return weigh(m, nearest, weight_shift(m, self.i_width_px, self.i_height_px)), 3 + WEIGHING_CYCLES


def window_column(half: Value, wide: Value, window: Value) -> Value:
    """Where half the x of a pixel is in the memories: the highest bit is that of x in a wide window, or says which."""
    low = half[: WINDOW_LOG2 - 2]
    return Cat(low, Mux(wide, half[len(low)], window))


def weight_shift(m: Module, width_px: Value, height_px: Value) -> Signal:
    """Bits that a distance drops, as in `golden_model.painting.sampling.weight_shift`; two clocks later."""
    upper = smaller(m, width_px, height_px)[WEIGHT_BITS + 1 :]
    shift = Signal(range(len(upper) + 1), reset_less=True)
    m.d.sync += shift.eq(0)
    for n in range(len(upper)):
        with m.If(upper[n]):
            m.d.sync += shift.eq(n + 1)
    return shift


def weigh(m: Module, distance: Value, shift: Value) -> Value:
    """The weight by the distance to the border, as `golden_model.painting.sampling.weigh`; `WEIGHING_CYCLES` later."""
    is_inside = delayed(m, distance > 0, 1)
    # A bit more than a weight needs: the distances of a whole tile are not all those of one pixel.
    shifted = delayed(m, (distance >> shift)[: WEIGHT_BITS + 1], 1)
    return delayed(m, Mux(is_inside, shifted | ~shifted.any(), 0), 1)


def smaller(m: Module, a: Value, b: Value) -> Value:
    """The smaller one, a clock later."""
    return delayed(m, Mux(a < b, a, b), 1)


def _half_and_parity(position: Value) -> tuple[Value, Value]:
    """Half of a pixel's coordinate in a window, and whether it is odd."""
    coordinate = position[POSITION.fraction_bits :][:WINDOW_LOG2]
    return coordinate[1:], coordinate[0]


def _share_of_odd(position: Value) -> Value:
    """Share in 1/64 of the odd one of two neighbours, whichever comes first."""
    part = position[: POSITION.fraction_bits]
    _, first_is_odd = _half_and_parity(position)
    return Mux(first_is_odd, POSITION.one - part, part)[: POSITION.fraction_bits + 1]


def _interpolate(m: Module, name: str, start: Value, difference: Value, share: Value) -> Value:
    """``start`` + ``difference`` ``share``, which is as wide as ``start``; `INTERPOLATION_CYCLES` later."""
    product = multiply(m, name, difference, share)
    return delayed(m, (delayed(m, start, Multiplier.latency_cycles) + product)[: len(start)], 1)
