"""The records that the accelerator sends, declared in one place.

NumPy dtypes (host, golden model) and hardware layouts (``hdl/streams.py``) are both derived from the field lists here.
Records are little-endian, a whole number of 64-bit words, and carry a type tag in their first byte; every record of one
stream has the same length.
"""

import enum
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

WORD_BYTES = 8
ELEMENTS = tuple(f"h{row}{column}" for row, column in np.ndindex(3, 3))
"""Names of a homography's elements, row by row."""


class Tag(enum.IntEnum):
    """First byte of every record: its type."""

    FEATURE = 1
    MATCH = 2
    FRAME_STATUS = 3
    HOMOGRAPHY = 6


class Cause(enum.IntFlag):
    """Why a frame is bad (bits of ``FrameStatus.causes``); 0 is a good frame."""

    SHORT_LINE = 1
    LONG_LINE = 2
    EARLY_END = 4
    MISSING_START = 8
    TOO_MANY_FEATURES = 16
    INVALID_SETTINGS = 32
    CLEARED = 64


@dataclass(frozen=True)
class Field:
    """One unsigned field of ``bits`` bits, stored in the next larger 8, 16 or 32 bits, or as a row of bytes."""

    name: str
    bits: int
    is_bytes: bool = False

    @property
    def storage_bytes(self) -> int:
        """Bytes that the field occupies in the record."""
        if self.is_bytes:
            return self.bits // 8
        return next(size for size in (1, 2, 4) if 8 * size >= self.bits)

    @property
    def dtype(self) -> np.dtype[np.generic]:
        """The field's NumPy type: an unsigned integer, or a row of bytes."""
        return np.dtype(("u1", (self.storage_bytes,)) if self.is_bytes else f"<u{self.storage_bytes}")


@dataclass(frozen=True)
class Record:
    """A record: its tag and its fields in order. The tag is the first byte and not among the fields."""

    tag: Tag
    fields: tuple[Field, ...]

    @property
    def payload_bytes(self) -> int:
        """Bytes up to the end of the last field, tag included."""
        return 1 + sum(field.storage_bytes for field in self.fields)

    @property
    def record_bytes(self) -> int:
        """Length of the record, padded to whole words."""
        return -(-self.payload_bytes // WORD_BYTES) * WORD_BYTES

    def offsets(self) -> Iterator[tuple[Field, int]]:
        """Yield each field with its byte offset in the record."""
        # The tag is byte 0.
        offset = 1
        for field in self.fields:
            yield field, offset
            offset += field.storage_bytes

    @cached_property
    def dtype(self) -> np.dtype[np.void]:
        """Structured dtype of one record, ``record_bytes`` long, the tag under the name ``tag``."""
        return self.dtype_padded_to(self.record_bytes)

    def dtype_padded_to(self, length_bytes: int) -> np.dtype[np.void]:
        """Make the dtype of the record for a stream whose records are ``length_bytes`` long."""
        names = ["tag", *(field.name for field in self.fields)]
        formats = [np.dtype("u1"), *(field.dtype for field in self.fields)]
        offsets = [0, *(offset for _, offset in self.offsets())]
        return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": length_bytes})


def feature_record(descriptor_bytes: int, window_bytes: int = 0) -> Record:
    """Make the Feature record for a descriptor of ``descriptor_bytes`` and a gray window of ``window_bytes``.

    ``x`` and ``y`` are UQ12.4 in full-resolution pixels, ``response`` is the 15-bit code of
    `golden_model.formats`, ``sector`` counts sixteenths of a full circle, ``index`` is the order of emission.
    """
    return Record(
        Tag.FEATURE,
        (
            Field("level", 1),
            Field("sector", 4),
            # Puts fields of 16 and 32 bits at multiples of their size, and the descriptor at the start of a word.
            Field("reserved", 8),
            Field("index", 16),
            Field("response", 15),
            Field("x", 16),
            Field("y", 16),
            Field("frame", 32),
            Field("descriptor", 8 * descriptor_bytes, is_bytes=True),
            *((Field("window", 8 * window_bytes, is_bytes=True),) if window_bytes else ()),
        ),
    )


MATCH = Record(
    Tag.MATCH,
    (
        Field("verdict", 1),
        Field("rule", 5),
        Field("weight", 8),
        Field("left_index", 16),
        Field("right_index", 16),
        Field("left_x", 16),
        Field("left_y", 16),
        Field("right_x", 16),
        Field("right_y", 16),
        Field("distance", 16),
        Field("margin", 16),
        Field("turn", 4),
        Field("peak_turn", 4),
        Field("reference", 16),
    ),
)
"""One mutual match: ``verdict`` 1 kept, 0 rejected; ``rule`` is the dominant rule's index; ``weight`` UQ0.8;
``turn`` is the relative orientation, the right sector minus the left one, and ``peak_turn`` the peak of its histogram,
both in sixteenths of a full circle; ``reference`` is the lower half of the number of the frame that left belongs to."""

FRAME_STATUS = Record(
    Tag.FRAME_STATUS,
    (
        Field("good", 1),
        Field("causes", 16),
        Field("frame", 32),
        Field("width", 16),
        Field("height", 16),
        Field("features", 16),
        Field("matches", 16),
        Field("kept", 16),
        Field("threshold", 15),
        Field("cycles", 32),
    ),
)
"""Last record of every frame on both streams, padded to the stream's record length. ``cycles`` counts clocks
from the frame's first pixel to its last feature; the golden model has no clock and leaves it 0."""

HOMOGRAPHY = Record(
    Tag.HOMOGRAPHY,
    (
        Field("causes", 8),
        Field("inliers", 16),
        Field("frame", 32),
        Field("score", 32),
        Field("support", 32),
        Field("cycles", 32),
        Field("cells", 16),
        Field("reference", 16),
        *(Field(name, 32) for name in ELEMENTS),
    ),
)
"""What the matches of ``frame`` give (`golden_model.geometry.estimator.Estimate`); elements in two's complement.
``reference`` is that of the matches, 0 without any."""
