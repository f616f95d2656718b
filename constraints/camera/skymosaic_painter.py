"""Paints a camera's frames onto a canvas in memory. Needs Python 3.10 and numpy.

    rings = RingReader(bus, settings)
    painter = Painter(rings.registers, columns=64, rows=48)
    painter.start()
    for frame in rings:
        painter.follow(frame)
        if it is known where an earlier frame lies:
            painter.anchor(its number, pose)
    show(painter.picture())
    painter.close()
    rings.close()

Frames have the numbers of their records here: ``frame.homography["frame"]``. A pose maps pixels of the canvas to pixels
of a frame, (3, 3); points that the camera sees have a positive third coordinate.
"""

import numpy as np
import skymosaic_map as register_map
from skymosaic_map import PAGE_BYTES
from skymosaic_registers import AcceleratorError
from skymosaic_steady import SteadyPath

TILE_PX, PIXEL_BYTES, FRAME_BUFFERS, MAX_TILES = 32, 4, 3, 128
FOLLOWED = 1000
"""Homographies that are remembered, to carry a pose on."""
WAIT_SECONDS, TIMEOUT_SECONDS = 0.002, 5.0
COUNTERS = (
    *("frames_painted", "frames_last", "frames_cut", "frames_lost", "frames_skipped", "frames_unplaced"),
    *("pose_refused", "pose_causes", "pose_unmatched", "pose_lost", "pose_ignored"),
    *("tiles_behind", "tiles_too_large", "tiles_failed", "painter_errors", "pages_repeated"),
    *("pictures_begun", "pictures_failed"),
)


class Painter:
    """The painter of a camera build that has one, and its memory: 4 KiB for each tile, and three frames.

    Parameters
    ----------
    registers : Registers
        As `RingReader` has them, with the size of the frames.
    columns, rows : int
        Size of the canvas in tiles of 32 px, 1 to 128.
    replace : bool
        Every frame makes a new canvas, as stabilised video needs it: one of two, of which the other is shown.
    steady : dict
        Parameters of `skymosaic_steady.SteadyPath`, for a camera that moves: as ``replace``, and `follow` sets the pose
        of each frame. Without, poses are those of the chip and of `anchor` and `place`.
    max_links : int
        Homographies that may follow a pose of the host, at most 255; frames after them are not painted.
    picture_lines : int
        Lines for a display, at most 32 for each row; 0: none is connected.
    picture_border : int
        What it shows where nothing was painted: green in the lowest byte, then blue, red.
    """

    def __init__(
        self, registers, columns, rows, *, replace=False, steady=None, max_links=255, picture_lines=0, picture_border=0
    ):
        if not register_map.BUILT.get("built_painter"):
            raise AcceleratorError("this build has no painter; export the camera with --homography --painter")
        self.registers, self.bus = registers, registers.bus
        replace |= steady is not None
        width, height = registers.read("width_px"), registers.read("height_px")
        row_bytes = -(-width // TILE_PX) * TILE_PX * PIXEL_BYTES
        pages = -(-row_bytes * height // PAGE_BYTES)
        self._settings = {
            "painter_replace": int(replace),
            # With 0 a frame waits for the host's pose until the next one is there.
            "painter_max_links": max_links if steady is None else 0,
            "picture_enable": int(picture_lines > 0),
            "picture_lines": picture_lines,
            "picture_border": picture_border,
            "canvas_columns": columns,
            "canvas_rows": rows,
            "frames_buffer_pages": pages,
        }
        if picture_lines > rows * TILE_PX:
            raise AcceleratorError(f"a picture of {picture_lines} lines; the canvas has {rows * TILE_PX}")
        if not (1 <= columns <= MAX_TILES and 1 <= rows <= MAX_TILES):
            raise AcceleratorError(f"a canvas of {columns}x{rows} tiles; each side has 1 to {MAX_TILES}")
        registers.check(self._settings)
        picture = columns * TILE_PX, picture_lines or rows * TILE_PX
        self._path = None if steady is None else SteadyPath((width, height), picture, **steady)
        self._shape = rows, columns, TILE_PX, TILE_PX, PIXEL_BYTES
        self._canvas = self._allocate("canvas", columns * rows * (1 + int(replace)))
        self._frames = self._allocate("frames", FRAME_BUFFERS * pages)
        self._links, self._newest = {}, None

    def _allocate(self, area, pages):
        buffer = self.bus.allocate(pages * PAGE_BYTES)
        address = self.bus.address(buffer)
        if address % PAGE_BYTES:
            raise AcceleratorError(f"the {area} lie at {address:#x}, not at a multiple of {PAGE_BYTES}")
        self._settings |= {f"{area}_base_low": address & 0xFFFF_FFFF, f"{area}_base_high": address >> 32}
        return buffer

    def start(self):
        """Begin with an empty canvas and no pose; also after `RingReader.restart`."""
        self.close()
        self._canvas[:] = 0
        self.bus.flush(self._canvas)
        self._links, self._newest = {}, None
        if self._path is not None:
            self._path.begin()
        self.registers.write(**self._settings)
        self.registers.write(painter_enable=1)
        faults = self.registers.read("painter_refused")
        if faults:
            raise AcceleratorError(f"the painter stays off: painter_refused is {faults}; see the register map")

    def close(self):
        """Switch the painter off, finish the frame that is being painted, and forget all poses.

        Only then may its memory be freed. The canvas stays as it is.
        """
        self.registers.write(painter_enable=0, painter_hold=0)
        self.registers.write(painter_clear=1)
        self._wait(lambda: not self.registers.read("painter_clear") and self.registers.read("painter_idle"))

    def follow(self, frame):
        """Remember the homography of a frame from the rings, if the chip has accepted it.

        With ``steady``, set its pose as well: soon, since the frame waits no longer than the next one comes.
        """
        record = frame.homography
        if record["causes"]:
            return
        number = int(record["frame"])
        # The record has the lower half of its reference's number, which is before its own.
        reference = number - 1 - (number - 1 - int(record["reference"]) & 0xFFFF)
        units = np.array([register_map.UNIT_PX, register_map.UNIT_PX, 1.0])
        elements = np.array([record[f"h{row}{column}"] for row, column in np.ndindex(3, 3)]).astype(np.int32)
        self._links[number] = reference, elements.reshape(3, 3) * units[:, np.newaxis] / units
        self._newest = number
        if len(self._links) > FOLLOWED:
            del self._links[min(self._links)]
        if self._path is not None:
            self.place(number, self._path.follow(number, *self._links[number]))

    def anchor(self, number, pose):
        """Say where a frame lies that may be past; carried on to the newest one that was followed, the pose is set.

        Returns whether it counts, as `place`. It does not if homographies from that frame to the newest are missing.
        """
        carried, frame = np.eye(3), self._newest
        while frame != number:
            if frame not in self._links:
                return False
            frame, link = self._links[frame]
            carried = carried @ link
            carried /= np.abs(carried).max()
        return self.place(self._newest, carried @ pose)

    def place(self, number, pose):
        """Set the pose of a frame that has come, with which those of the next ones are composed.

        What the camera sees has a positive third coordinate; with a horizon on the canvas, a pose that was divided by
        its last element may have the wrong sign, and counts as mirrored.

        Returns
        -------
        bool
            Whether it counts. It does not if the next frame was faster, or if the pose is singular, mirrored or out of
            range (``pose_answer`` has the causes): try again with a newer frame.
        """
        elements = quantise(np.asarray(pose, dtype=np.float64))
        names = (f"pose_h{row}{column}" for row, column in np.ndindex(3, 3))
        self._wait(lambda: not self.registers.read("pose_waiting"))
        self.registers.write(**{name: int(e) & 0xFFFF_FFFF for name, e in zip(names, elements.flat, strict=True)})
        self.registers.write(pose_frame=number & 0xFFFF, pose_set=1)
        self._wait(lambda: not self.registers.read("pose_waiting"))
        ahead = self.registers.read("pose_newest") - number & 0xFFFF
        return self.registers.read("pose_answer") == 0 and not 0 < ahead < 1 << 15

    @property
    def tiles(self):
        """The canvas as it lies in memory, without a copy: a uint8 array (rows, columns, 32, 32, 4).

        A pixel is blue, green, red and its weight, which is 0 where nothing has been painted. While it is read, the
        painter may change it: `picture` holds what it reads.
        """
        self.bus.invalidate(self._canvas)
        return self._canvas.reshape(-1, *self._shape)[self.registers.read("painter_page")]

    def picture(self):
        """Copy the canvas row by row: a uint8 array (height, width, 4).

        With ``replace`` it is that of one frame. Otherwise painting goes on meanwhile: the tiles of a row are of one
        moment, each of them whole, and those of the next row of a later one.
        """
        copy = np.empty(self._shape, np.uint8)
        try:
            for row in range(len(copy)):
                self.registers.write(painter_hold=1, painter_hold_row=row)
                self._wait(lambda: self.registers.read("painter_held"))
                copy[row] = self.tiles[row]
        finally:
            self.registers.write(painter_hold=0)
        return copy.swapaxes(1, 2).reshape(len(copy) * TILE_PX, -1, PIXEL_BYTES)

    def counts(self):
        """Read what became of frames, poses and tiles since the rings' start."""
        return {name: self.registers.read(name) for name in COUNTERS}

    def _wait(self, is_over):
        for _ in range(round(TIMEOUT_SECONDS / WAIT_SECONDS)):
            if is_over():
                return
            self.bus.wait(WAIT_SECONDS)
        raise AcceleratorError("the painter does not answer; is the camera on, and does the memory answer?")


def quantise(pose):
    """Convert a pose (3, 3) to integers: positions in units of 4096 px, the largest element 2^24 - 1."""
    units = np.array([register_map.UNIT_PX, register_map.UNIT_PX, 1.0])
    scaled = pose * units / units[:, np.newaxis]
    largest = np.abs(scaled).max()
    if not (np.isfinite(largest) and largest > 0):
        raise AcceleratorError("the pose is zero or not finite; leave it out")
    return np.floor(scaled / largest * register_map.MAX_ELEMENT + 0.5).astype(np.int64)
