"""Data types between the blocks: beats inside the pixel pipeline, stream payloads and records at its edges.

A *beat* is a struct ``{valid, x, y, ...}`` without ``ready``. An admitted pixel never waits: a stall signal through
the whole pipeline limited the clock in every placed prototype (139 MHz with it, 165 MHz without). Clocks without a
pixel (``valid`` 0) may occur anywhere.

``x, y`` is the *scan position*: the position, in its own level, of the pixel that entered last. Every block passes it
on unchanged, delayed with the data. A block whose window is centred behind the scan position has a constant ``lag_px``:
its output at scan (x, y) describes pixel (x - lag_px, y - lag_px). Lags add up along the pipeline.

No block counts pixels: line memories are addressed by x. A reset in mid-frame, or a frame that breaks off, leaves only
old pixels in the memories, which the next frame overwrites before it reads them. Where a block's window leaves the
frame, its output is unspecified; `FrontEndConfig.border_px` keeps features away from there.

A block's ``latency_cycles`` are the clocks from a beat at its input to the same beat at its output.

A beat may hold two horizontally adjacent pixels: a block's ``pixels_per_clock`` is 1 or 2. The beat's scan position is
then that of the left one, whose x is even; pixel n of the beat has the scan position (x + n, y), with the same lag. A
line of odd width ends with a beat whose right pixel is outside the frame, where every value is unspecified.
"""

# No postponed annotations here: data.Struct reads its fields from them.
from collections.abc import Iterator, Sequence
from typing import Any

from amaranth import Cat, Elaboratable, Module, Shape, ShapeLike, Value, ValueLike, unsigned
from amaranth.lib import data, stream

from golden_model.config import MAX_FRAME_PX
from golden_model.formats import RESPONSE_CODE
from golden_model.records import WORD_BYTES, Record
from hdl.lib.delay import delayed
from hdl.settings import FRONT_END

COORDINATE = Shape.cast(range(MAX_FRAME_PX))
"""x or y of a beat."""
WORD = unsigned(8 * WORD_BYTES)


def beat(pixels_per_clock: int = 1, /, **payload: ShapeLike) -> data.StructLayout:
    """Layout of a beat: ``valid``, the scan position ``x``, ``y``, and the fields of the payload.

    In a beat of several pixels, each field of the payload is an array, the leftmost pixel first.
    """
    fields = {name: pixels(shape, pixels_per_clock) for name, shape in payload.items()}
    return data.StructLayout({"valid": 1, "x": COORDINATE, "y": COORDINATE, **fields})


def pixels(shape: ShapeLike, pixels_per_clock: int) -> ShapeLike:
    """Shape of a field in a beat: ``shape`` for one pixel, an array of it for several."""
    return shape if pixels_per_clock == 1 else data.ArrayLayout(shape, pixels_per_clock)


def each_pixel(field: Any, pixels_per_clock: int) -> list[Any]:
    """List the values of a field, one for each pixel of the beat."""
    # One pixel per beat has no array of one, so that most blocks need no index.
    return [field] if pixels_per_clock == 1 else list(field)


def pixelwise(pixels_per_clock: int, *fields: Any) -> Iterator[tuple[Any, ...]]:
    """The values of several fields, for one pixel of the beat after the other."""
    return zip(*(each_pixel(field, pixels_per_clock) for field in fields), strict=True)


def pixel_beats(source: data.View, pixels_per_clock: int) -> list[data.View]:
    """Split a beat into one for each pixel; ``x`` remains that of the leftmost."""
    if pixels_per_clock == 1:
        return [source]
    fields = {str(name): field.shape for name, field in source.shape() if name not in ("valid", "x", "y")}
    layout = beat(**{name: shape.elem_shape for name, shape in fields.items()})
    scan = (source.valid, source.x, source.y)
    return [data.View(layout, Cat(scan, (source[name][n] for name in fields))) for n in range(pixels_per_clock)]


def add_submodules(m: Module, name: str, blocks: Sequence[Elaboratable]) -> None:
    """Add the blocks of a beat's pixels; a single one is called ``name``, several have a number behind it."""
    for n, block in enumerate(blocks):
        m.submodules[name if len(blocks) == 1 else f"{name}{n}"] = block


def carry_scan(m: Module, source: data.View, sink: data.View, cycles: int) -> None:
    """Pass ``valid``, ``x`` and ``y`` of one beat on to another, with ``cycles`` clocks of delay.

    Only ``valid`` is reset: registers without reset pack into shift-register LUTs.
    """
    m.d.comb += [
        sink.valid.eq(delayed(m, source.valid, cycles, reset_less=False)),
        Cat(sink.x, sink.y).eq(delayed(m, Cat(source.x, source.y), cycles)),
    ]


def fork(m: Module, source: stream.Interface, *sinks: stream.Interface) -> None:
    """Send each payload to all sinks at once, when all are ready.

    Each valid depends on every sink's ready, so no ready may depend on its valid (`hdl.lib.skid_buffer`).
    """
    all_ready: Value = sinks[0].ready
    for sink in sinks[1:]:
        all_ready = all_ready & sink.ready
    m.d.comb += source.ready.eq(all_ready)
    for sink in sinks:
        m.d.comb += [sink.valid.eq(source.valid & all_ready), sink.payload.eq(source.payload)]


def join(m: Module, sink: stream.Interface, **sources: stream.Interface) -> None:
    """Send a payload of each source at once, as the field of the sink's payload that has its name.

    Each ready depends on every source's valid and on the sink's ready, so none of these may depend on the other.
    """
    m.d.comb += sink.valid.eq(Cat(source.valid for source in sources.values()).all())
    for name, source in sources.items():
        m.d.comb += [source.ready.eq(sink.valid & sink.ready), sink.payload[name].eq(source.payload)]


def pixel_payload(pixels_per_clock: int = 1) -> data.StructLayout:
    """Payload at the input of frame admission.

    Members
    -------
    data : for each pixel G in bits 7..0, B in 15..8, R in 23..16 (the order of UG934); or gray in 7..0.
    first : first pixel of a frame; without meaning in memory mode.
    last : last pixel of a line; in memory mode of a transfer.
    """
    return data.StructLayout({"data": pixels(24, pixels_per_clock), "first": 1, "last": 1})


class WordPayload(data.Struct):
    """A word of a record at the front end's output; ``last`` ends the frame (the last word of its FrameStatus)."""

    data: WORD
    last: unsigned(1)


class RowPayload(data.Struct):
    """A word of a Feature record of one level, or the end of one of its cell rows.

    Members
    -------
    data : word of a record; index and frame number are still 0, `hdl.level_merge` fills them in.
    ends_row : the payload holds no word but marks the end of a cell row. Every cell row, even an empty one, ends with
        such a payload. Without selection the whole level is one row.
    ends_level : valid with ``ends_row``: this was the frame's last cell row in this level.
    """

    data: WORD
    ends_row: unsigned(1)
    ends_level: unsigned(1)


CANDIDATE = beat(
    present=1,
    code=RESPONSE_CODE.bits,
    left=RESPONSE_CODE.bits,
    right=RESPONSE_CODE.bits,
    up=RESPONSE_CODE.bits,
    down=RESPONSE_CODE.bits,
    ends_row=1,
    ends_level=1,
)
"""A corner candidate where ``present``: its response code (0 without a candidate) and those of its four neighbours.

``ends_row`` marks the last beat of a cell row. ``ends_level``, valid with ``ends_row``, marks the frame's last.
Candidates of a line are at least 2 px apart.
"""


FRONT_END_SETTINGS = data.StructLayout({setting.name: setting.bits for setting in FRONT_END})
"""Run-time settings of the front end (`hdl.settings.FRONT_END`), which take effect at the start of a frame."""


def record_layout(record: Record, length_bytes: int | None = None) -> data.FlexibleLayout:
    """Hardware layout of a record, its tag included, padded with zeros to ``length_bytes`` (None: its own length)."""
    fields: dict[int | str, data.Field] = {"tag": data.Field(unsigned(8), 0)}
    fields |= {field.name: data.Field(unsigned(field.bits), 8 * offset) for field, offset in record.offsets()}
    # A packet's status is padded to its records, so that a host can view the packet as one array.
    length_bytes = record.record_bytes if length_bytes is None else length_bytes
    return data.FlexibleLayout(8 * length_bytes, fields)


def words(record: ValueLike) -> list[Value]:
    """Split a record into its 64-bit words, the first word first."""
    bits = Value.cast(record)
    # Records are little-endian: the first word is in the lowest bits.
    return [bits[low : low + WORD.width] for low in range(0, len(bits), WORD.width)]
