"""The layout of a slot in a ring: a header, and behind it a packet of records. Declared once, for hardware and host."""

import enum

import numpy as np

from golden_model.records import WORD_BYTES
from hdl.settings import PAGE_BYTES

HEADER_BYTES = 128
"""Where the packet starts in its slot."""


class HeaderFlag(enum.IntFlag):
    """Faults of a packet in memory."""

    OVERLONG = 1
    MEMORY_ERROR = 2


HEADER = np.dtype(
    [
        ("sequence", "<u4"),
        ("length_bytes", "<u4"),
        ("number", "<u4"),
        ("flags", "<u4"),
        ("time", "<u8"),
        ("status", "<u8"),
        ("clocks", "<u4"),
        ("reserved", "<u4"),
    ]
)
"""The header, a whole number of 64-bit words.

``sequence`` counts the ring's packets from 1, so that zeroed memory holds none; ``length_bytes`` is the length of the
packet with its FrameStatus. ``number`` counts the camera's frames from 1, dropped ones too: gaps are drops. ``time`` is
the clock of the frame's first pixel at the camera's gate, ``clocks`` the time from there to this header. ``status`` is
the first word of the packet's FrameStatus, and ``flags`` has the bits of `HeaderFlag`."""


def slot_pages(max_words: int) -> int:
    """Pages that a slot needs for packets of up to ``max_words`` words."""
    return -(-(HEADER_BYTES + max_words * WORD_BYTES) // PAGE_BYTES)
