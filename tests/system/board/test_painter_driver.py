"""The host's side of the painter over registers that the test answers: what is set up, and where frames lie."""

import dataclasses
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.arrays import Array, Pixels
from golden_model.geometry.fixed_point import quantise
from golden_model.records import HOMOGRAPHY
from hdl.registers.painter_register_map import PainterFault
from sim.benches.exported import host_programs
from tests.system.board.test_rings import ESTIMATING, Memory

PAINTING = dataclasses.replace(ESTIMATING, painter=True)
COLUMNS, ROWS = 3, 2
WIDTH_PX, HEIGHT_PX = 100, 65


class PainterMemory(Memory):
    """Obeys requests at once, and keeps the poses that are set."""

    def __init__(self, maps: Any) -> None:
        super().__init__(maps)
        self.poses: list[tuple[int, NDArray[np.int64]]] = []
        self.flushed, self.invalidated, self.held = list[int](), list[int](), list[int]()
        self.answers = True
        self.set("width_px", WIDTH_PX)
        self.set("height_px", HEIGHT_PX)
        self.set("painter_idle", 1)

    def write(self, offset: int, value: int) -> None:
        super().write(offset, value)
        if self.answers:
            self.set("painter_clear", 0)
            self.set("painter_held", self.get("painter_hold"))
            if self.get("painter_hold"):
                self.held.append(self.get("painter_hold_row"))
        if self.get("pose_set"):
            self.set("pose_set", 0)
            words = [self.get(f"pose_h{row}{column}") for row, column in np.ndindex(3, 3)]
            elements = np.array(words, np.uint32).astype(np.int32).reshape(3, 3)
            self.poses.append((self.get("pose_frame"), elements.astype(np.int64)))

    def invalidate(self, buffer: Pixels) -> None:
        self.invalidated.append(self.address(buffer))

    def flush(self, buffer: Pixels) -> None:
        assert not buffer.any()
        self.flushed.append(self.address(buffer))


@pytest.fixture
def host() -> Iterator[Any]:
    """The driver, and the registers that it finds."""
    with host_programs(PAINTING) as load:
        driver = load("skymosaic_painter")
        memory = PainterMemory(driver.register_map)
        registers = load("skymosaic_registers").Registers(memory)
        yield SimpleNamespace(
            driver=driver,
            memory=memory,
            registers=registers,
            error=driver.AcceleratorError,
            make=lambda **options: driver.Painter(registers, COLUMNS, ROWS, **options),
        )


def frame(number: int, link: Array, *, reference: int | None = None, causes: int = 0) -> SimpleNamespace:
    record = np.zeros(1, HOMOGRAPHY.dtype)[0]
    record["frame"], record["causes"] = number, causes
    record["reference"] = (number - 1 if reference is None else reference) & 0xFFFF
    for (row, column), element in np.ndenumerate(quantise(link[np.newaxis])[0]):
        record[f"h{row}{column}"] = int(element) & 0xFFFF_FFFF
    return SimpleNamespace(homography=record)


def shift(x: float, y: float) -> Array:
    return np.array([[1, 0, x], [0, 1, y], [0, 0, 1.0]])


def test_it_is_set_up_before_it_is_switched_on(host: Any) -> None:
    painter = host.make(replace=True, max_links=9, picture_lines=50, picture_border=7)
    get, (canvas, frames) = host.memory.get, host.memory.buffers
    canvas[:] = 7
    assert not get("painter_enable")
    painter.start()
    assert get("painter_enable")
    assert (get("painter_replace"), get("painter_max_links"), get("canvas_columns"), get("canvas_rows")) == (1, 9, 3, 2)
    assert [get(f"picture_{name}") for name in ("enable", "lines", "border")] == [1, 50, 7]
    for area, buffer in (("canvas", canvas), ("frames", frames)):
        assert get(f"{area}_base_low") | get(f"{area}_base_high") << 32 == host.memory.address(buffer)
    # Rows of 128 px, 65 of them: 33,280 bytes.
    assert get("frames_buffer_pages") == 9
    assert (canvas.size, frames.size) == (2 * COLUMNS * ROWS * 4096, 3 * 9 * 4096)
    assert host.memory.flushed == [host.memory.address(canvas)]


def test_a_request_that_is_pending_is_not_made_again_by_other_fields(host: Any) -> None:
    host.memory.answers = False
    host.memory.set("painter_clear", 1)
    host.registers.write(painter_enable=1)
    assert (host.memory.get("painter_enable"), host.memory.get("painter_clear")) == (1, 0)


def test_a_past_frame_is_an_anchor_of_the_newest(host: Any) -> None:
    """Also where numbers wrap in the records, and past frames that the chip has refused."""
    painter = host.make()
    start, turn = 65533, np.array([[1, 0.1, 3], [-0.1, 1, 5], [1e-5, 0, 1.0]])
    painter.follow(frame(start, shift(1000, 0)))
    painter.follow(frame(start + 1, shift(2, 1)))
    painter.follow(frame(start + 2, turn))
    painter.follow(frame(start + 3, shift(500, 500), causes=1))
    painter.follow(frame(start + 4, shift(4, 0), reference=start + 2))
    painter.follow(frame(start + 5, shift(500, 500), causes=8))
    pose = np.array([[0.9, 0.2, -400], [-0.2, 0.9, -300], [0, 0, 1.0]])
    assert painter.anchor(start, pose)
    ((number, elements),) = host.memory.poses
    assert number == (start + 4) & 0xFFFF
    expected = quantise((shift(4, 0) @ turn @ shift(2, 1) @ pose)[np.newaxis])[0]
    assert np.abs(elements - expected).max() <= 8


@pytest.mark.parametrize("pose", [np.zeros((3, 3)), np.full((3, 3), np.nan), np.diag([1, np.inf, 1])])
def test_a_pose_without_a_scale_is_refused(host: Any, pose: Array) -> None:
    with pytest.raises(host.error, match="the pose is zero or not finite"):
        host.make().place(7, pose)
    assert host.memory.poses == []


def test_an_anchor_needs_a_way_to_the_newest_frame(host: Any) -> None:
    painter = host.make()
    painter.follow(frame(65536, shift(3, 0), reference=0))
    # From the newest itself there is no way to go.
    for anchor, pose in ((0, shift(4, 0)), (65536, shift(7, 0))):
        assert painter.anchor(anchor, pose)
        number, elements = host.memory.poses.pop()
        assert number == 0
        assert (elements == quantise(shift(7, 0)[np.newaxis])[0]).all()
    painter = host.make()
    assert not painter.anchor(1, shift(0, 0))
    painter.follow(frame(4, shift(1, 0), reference=2))
    assert not painter.anchor(3, shift(0, 0))
    assert not painter.anchor(9, shift(0, 0))
    assert host.memory.poses == []
    assert painter.anchor(2, shift(0, 0))


def test_the_way_through_the_last_frames_is_remembered_until_a_start(host: Any) -> None:
    painter, followed = host.make(), host.driver.FOLLOWED
    for number in range(1, followed + 3):
        painter.follow(frame(number, shift(0.5, 0)))
    assert not painter.anchor(1, np.eye(3))
    assert painter.anchor(2, np.eye(3))
    ((number, elements),) = host.memory.poses
    assert number == followed + 2
    assert elements[0, 2] / elements[0, 0] * 4096 == pytest.approx(followed / 2, abs=0.01)
    painter.start()
    painter.follow(frame(followed + 3, shift(0.5, 0)))
    assert not painter.anchor(followed + 1, np.eye(3))


@pytest.mark.parametrize(
    ("newest", "causes", "counts"), [(7, 0, True), (6, 0, True), (8, 0, False), (65535, 0, True), (7, 2, False)]
)
def test_a_pose_that_does_not_count_is_reported(host: Any, newest: int, causes: int, counts: bool) -> None:
    host.memory.set("pose_newest", newest)
    host.memory.set("pose_answer", causes)
    assert host.make().place(7, shift(0, 0)) == counts


@pytest.mark.parametrize("page", [0, 1], ids=["first page", "second page"])
def test_tiles_become_a_picture(host: Any, page: int) -> None:
    painter = host.make(replace=bool(page))
    host.memory.set("painter_page", page)
    tiles = painter.tiles
    tiles[1, 2, 5, 9] = 1, 2, 3, 4
    picture = painter.picture()
    assert picture.shape == (ROWS * 32, COLUMNS * 32, 4)
    assert picture[32 + 5, 64 + 9].tolist() == [1, 2, 3, 4]
    assert np.count_nonzero(picture) == 4
    assert host.memory.buffers[0][page * ROWS * COLUMNS * 4096 :].any(), "the tiles are a copy"
    # Held row by row, and invalidated while it is held.
    assert (host.memory.held, host.memory.get("painter_hold")) == (list(range(ROWS)), 0)
    assert host.memory.invalidated == (1 + ROWS) * [host.memory.address(host.memory.buffers[0])]
    host.memory.answers = False
    with pytest.raises(host.error, match="does not answer"):
        painter.picture()
    assert not host.memory.get("painter_hold")


def test_a_fault_a_hang_and_unaligned_memory_are_errors(host: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    painter = host.make()
    host.memory.set("painter_refused", PainterFault.FRAMES_TOO_SMALL)
    with pytest.raises(host.error, match="painter_refused is 8"):
        painter.start()
    host.memory.answers = False
    with pytest.raises(host.error, match="does not answer"):
        painter.close()
    monkeypatch.setattr(host.memory, "address", lambda _buffer: 0x1_0000_0080)
    with pytest.raises(host.error, match="0x100000080"):
        host.make()


@pytest.mark.parametrize("columns", [0, 129])
def test_a_canvas_that_cannot_be_is_refused(host: Any, columns: int) -> None:
    with pytest.raises(host.error, match=f"{columns}x2 tiles"):
        host.driver.Painter(host.registers, columns, 2)
    with pytest.raises(host.error, match="a picture of 65 lines; the canvas has 64"):
        host.make(picture_lines=65)
    assert host.memory.buffers == []


def test_a_build_without_a_painter_says_how_to_get_one() -> None:
    with host_programs(ESTIMATING) as load:
        driver = load("skymosaic_painter")
        registers = load("skymosaic_registers").Registers(Memory(driver.register_map))
        with pytest.raises(driver.AcceleratorError, match="--painter"):
            driver.Painter(registers, 1, 1)


def test_each_frame_of_steady_video_is_set_on_its_path(host: Any) -> None:
    """Those that the chip refuses are not: the last picture stays."""
    painter = host.make(steady={"crop": 0.2}, picture_lines=50)
    painter.start()
    assert [host.memory.get(name) for name in ("painter_replace", "painter_max_links")] == [1, 0]
    path = host.driver.SteadyPath((WIDTH_PX, HEIGHT_PX), (COLUMNS * 32, 50), crop=0.2)
    for number in (1, 2, 4):
        painter.follow(frame(number, shift(2, 1), reference=max(number - 1, 1) if number < 4 else 2))
    painter.follow(frame(5, shift(500, 0), causes=1))
    poses = [path.follow(n, reference, shift(2, 1)) for n, reference in ((1, 1), (2, 1), (4, 2))]
    assert [number for number, _ in host.memory.poses] == [1, 2, 4]
    for (_, elements), pose in zip(host.memory.poses, poses, strict=True):
        assert np.abs(elements - quantise(pose[np.newaxis])[0]).max() <= 8
    # A session begins a path of its own.
    painter.start()
    painter.follow(frame(5, shift(2, 1)))
    assert (host.memory.poses[-1][1] == host.memory.poses[0][1]).all()
    taken = len(host.memory.buffers)
    with pytest.raises(ValueError, match="crop"):
        host.make(steady={"crop": 2})
    assert len(host.memory.buffers) == taken
