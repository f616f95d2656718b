"""The painter in a simulation: a camera, a memory that waits and fails, and a host that sends poses."""

import ctypes
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from amaranth.hdl import Cat, Module, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out
from numpy.typing import NDArray

from golden_model.painting.tiles import TILE_PX
from hdl.axi.axi_read import AXI_READ
from hdl.axi.flat_ports import FlatTop
from hdl.blocks.flat import CLOCK, RESET, FlatBlock
from hdl.painting.frame_writer import BUFFERS, frame_pages
from hdl.painting.line_reader import PICTURE, SHOWN, add_reader
from hdl.painting.painter import Painter
from hdl.settings import PAGE_BYTES
from sim.backends.interface import silent
from sim.benches.memory import BASE, MemoryBench, MemoryRules
from sim.simulators import verilator
from sim.simulators.compiled import ADDRESS, WIDE, WORD, WORDS
from sim.simulators.design import Design, Ports

SETTINGS = (
    *("enable", "replace", "clear", "width_px", "height_px", "frames_page", "buffer_pages", "canvas_page"),
    *("columns", "rows", "max_links", "nowhere_valid", "nowhere_frame", "holds_0_valid", "holds_0_row", "stop"),
    *("pictures_valid", "pictures_columns", "pictures_lines", "pictures_border"),
)
PORTS = Ports(
    outputs=(),
    settings={f"i_{name}": 64 for name in SETTINGS},
    writers=("frames", "new_tiles"),
    readers=("windows", "old_tiles", "pictures"),
)
HARNESS = verilator.HARNESS / "painter.cpp"


@dataclass(frozen=True)
class Report:
    """A frame that has been painted; see `hdl.painting.painter.REPORT`."""

    cycle: int
    frame: int
    offered: int
    behind: int
    too_large: int
    cannot_win: int
    painted: int
    failed: int
    has_errors: int


class ShownPainter(wiring.Component):
    """The painter, and the reader of pictures, which has the second hold."""

    if TYPE_CHECKING:
        # The painter makes most of the ports; a type checker cannot know their names.
        def __getattr__(self, name: str) -> Any: ...

    def __init__(self) -> None:
        self._painter = Painter()
        pictures = {
            "i_pictures": In(stream.Signature(PICTURE)),
            "i_stop": In(1),
            "pictures": Out(AXI_READ),
            "o_picture": Out(stream.Signature(SHOWN)),
        }
        super().__init__({**self._painter.signature.members, **pictures})

    def elaborate(self, platform: object) -> Module:
        """Connect ports of the same names, and the reader to the painter."""
        m = Module()
        m.submodules.painter = painter = self._painter
        reader = add_reader(m, self.pictures, self.o_picture)
        for name, member in painter.signature.members.items():
            inner, outer = getattr(painter, name), getattr(self, name)
            if member.is_signature:
                wiring.connect(m, inner, wiring.flipped(outer))
            elif name != "i_holds":
                m.d.comb += inner.eq(outer) if member.flow == In else outer.eq(inner)
        m.d.comb += [
            painter.i_holds.eq(Cat(self.i_holds[0], reader.o_hold)),
            reader.i_page.eq(painter.o_page),
            reader.i_held.eq(painter.o_held[1]),
            reader.i_stop.eq(self.i_stop),
        ]
        wiring.connect(m, wiring.flipped(self.i_pictures), reader.i)
        return m


class PainterTop(FlatTop):
    """The painter and the reader of pictures with flat ports; clock and reset have the names that harnesses know."""

    def __init__(self) -> None:
        self._block = block = FlatBlock(ShownPainter())
        self._reset_n = Signal(name="reset_n")
        pins = {name: (member, getattr(block, name)) for name, member in block.signature.members.items()}
        clock = pins.pop(CLOCK)
        del pins[RESET]
        super().__init__({"aclk": clock, "aresetn": (In(1), self._reset_n), **pins})

    def elaborate(self, platform: object) -> Module:
        """Connect ports by name."""
        m = Module()
        m.submodules.block = self._block
        m.d.comb += getattr(self._block, RESET).eq(~self._reset_n)
        self.connect_pins(m)
        return m


class PainterBench(MemoryBench):
    """A running simulation.

    Parameters
    ----------
    width_px, height_px : int
        Size of the frames.
    columns, rows : int
        Size of the canvas, in tiles.
    replace : bool
        A frame makes a new canvas.
    rules
        How the memory behaves.

    Attributes
    ----------
    pages : uint8 ndarray, shape (1 or 2, rows, columns, 32, 32, 4)
        The tiles in memory, at first without a meaning; with ``replace`` there are two canvases.
    canvas : uint8 ndarray, shape (rows, columns, 32, 32, 4)
        The first of them.
    """

    def __init__(
        self, *, width_px: int, height_px: int, columns: int, rows: int, replace: bool = False, rules: MemoryRules
    ) -> None:
        design = Design("the painter", PORTS, PainterTop, "")
        pages = frame_pages(width_px, height_px)
        canvas_start = BUFFERS * pages * PAGE_BYTES
        length_bytes = canvas_start + (1 + replace) * columns * rows * PAGE_BYTES
        memory = np.random.default_rng(rules.seed).integers(0, 256, length_bytes, dtype=np.uint8)
        library = verilator.build_library(design, progress=silent, harness=HARNESS)
        super().__init__(library, "painter", _FUNCTIONS, memory, rules)
        self.pages = self.memory[canvas_start:].reshape(-1, rows, columns, TILE_PX, TILE_PX, 4)
        self.canvas = self.pages[0]
        self.reports: list[Report] = []
        self.set(
            width_px=width_px, height_px=height_px, frames_page=BASE // PAGE_BYTES, buffer_pages=pages,
            canvas_page=(BASE + canvas_start) // PAGE_BYTES, columns=columns, rows=rows, replace=replace, enable=1,
        )  # fmt: skip

    def reset(self) -> None:
        """Reset the design, and forget what waits for it."""
        super().reset()
        self.reports.clear()

    def set(self, **settings: int) -> None:
        """Change settings, by their names without ``i_``."""
        for name, value in settings.items():
            self.call("set", SETTINGS.index(name), value)

    def place(self, elements: NDArray[np.integer], frame: int, *, reference: int | None = None) -> None:
        """Queue the pose (3, 3) of a frame; with ``reference`` it is composed with that of this frame."""
        values = np.ascontiguousarray(elements, np.int32)
        self.call("pose", values.ctypes.data, frame, reference or 0, reference is not None)

    def run(self, clocks: int, *, reports: int = 1 << 30) -> list[Report]:
        """Run until so many frames have been painted since the start, or for so many clocks; returns the new ones."""
        fields = len(Report.__dataclass_fields__)
        rows = self.words("run", clocks, reports * fields).reshape(-1, fields)
        new = [Report(*row) for row in rows[len(self.reports) :].tolist()]
        self.reports += new
        return new

    @property
    def events(self) -> dict[str, int]:
        """How often a frame or a pose was given up, by the reason."""
        names = ("refused", "unmatched", "unplaced", "cut", "lost", "skipped")
        counts = zip(names, self.words("events").tolist(), strict=True)
        return {name: count for name, count in counts if count}

    @property
    def shown(self) -> int:
        """The page that is shown."""
        return int(self.call("shown"))

    @property
    def held(self) -> bool:
        """What is held will stay."""
        return bool(self.call("held") & 1)

    def display(self, waits: int) -> None:
        """Change how often, in 1/256, the display takes no pixel; 256: it has stopped."""
        self.call("display", waits)

    @property
    def pixels(self) -> NDArray[np.int64]:
        """What the display has got: 24 bits of data, then first, then last."""
        return self.words("pixels").astype(np.int64)

    @property
    def is_idle(self) -> bool:
        """Nothing is under way: the painter says so, no burst is open, and the camera has no frame left."""
        return bool(self.call("idle"))


_FUNCTIONS = {
    "set": (None, ctypes.c_int, WIDE),
    "pose": (None, ADDRESS, WORD, WORD, WORD),
    "run": (WIDE, WIDE, WIDE, WORDS),
    **dict.fromkeys(("events", "pixels"), (WIDE, WORDS)),
    "display": (None, WORD),
    **dict.fromkeys(("idle", "shown", "held"), (ctypes.c_int,)),
}
"""The functions that only painter.cpp has."""
