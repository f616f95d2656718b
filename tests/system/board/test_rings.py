"""The reader of a camera build's rings over a memory that the test fills: order, faults, wrap, and what is released."""

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from golden_model.arrays import Pixels
from golden_model.config import EstimatorConfig
from hdl.build import BUILDS
from hdl.settings import REQUESTED, matched_frame_settings
from sim.benches.exported import host_programs

PLAIN = dataclasses.replace(BUILDS["tiny"], shell="camera", video_bits=24)
ESTIMATING = dataclasses.replace(PLAIN, config=dataclasses.replace(PLAIN.config, estimator=EstimatorConfig()))
SLOTS = 3


class Memory:
    """Registers that keep what is written, and buffers at addresses beyond 4 GB."""

    def __init__(self, maps: Any) -> None:
        self.maps, self.words = maps, dict[int, int]()
        self.buffers: list[Pixels] = []
        self.waits = 0
        for name, value in maps.BUILT.items():
            self.set(name, value)

    def set(self, field: str, value: int) -> None:
        offset, low, bits = self.maps.FIELDS[field]
        self.words[offset] = self.words.get(offset, 0) & ~((1 << bits) - 1 << low) | value << low

    def get(self, field: str) -> int:
        offset, low, bits = self.maps.FIELDS[field]
        return self.words.get(offset, 0) >> low & (1 << bits) - 1

    def read(self, offset: int) -> int:
        return self.words.get(offset, 0)

    def write(self, offset: int, value: int) -> None:
        self.words[offset] = value

    def allocate(self, length_bytes: int) -> Pixels:
        self.buffers.append(np.zeros(length_bytes, np.uint8))
        return self.buffers[-1]

    def address(self, buffer: Pixels) -> int:
        index = next(index for index, each in enumerate(self.buffers) if each is buffer)
        return (index + 1 << 32) + 4096 * (index + 5)

    def invalidate(self, _buffer: Pixels) -> None:
        pass

    def wait(self, _seconds: float) -> None:
        self.waits += 1


class Camera:
    """Writes packets into the rings, as the accelerator does."""

    def __init__(self, reader: Any, build: Any) -> None:
        self.maps = reader.register_map
        self.memory = Memory(self.maps)
        settings = matched_frame_settings(build.config, 80, 64, gray_input=False)
        self.rings = reader.RingReader(
            self.memory, {name: settings[name] for name in REQUESTED} | {"gray_input": 0}, slots=SLOTS
        )
        self.written = dict.fromkeys(reader.RINGS, 0)

    def deliver(self, ring: str, number: int, count: int, **header: int) -> None:
        """Write the packet of a frame with ``count`` records, whose first bytes are the frame's number."""
        dtype = {"features": self.maps.FEATURE, "matches": self.maps.MATCH}.get(ring)
        if dtype is None:
            packet = np.zeros(1, self.maps.HOMOGRAPHY).view(np.uint8)
            packet[0] = self.maps.HOMOGRAPHY_TAG
        else:
            records = np.zeros(count + 1, dtype)
            packet = records.view(np.uint8)
            packet[: count * dtype.itemsize : dtype.itemsize] = number
            status = packet[count * dtype.itemsize :][: self.maps.STATUS.itemsize].view(self.maps.STATUS)
            status["tag"], status["good"] = self.maps.STATUS_TAG, number % 2
        self.written[ring] += 1
        head = np.zeros(1, self.maps.HEADER)
        values = {"sequence": self.written[ring], "length_bytes": packet.size, "number": number, "time": 1000 * number}
        for name, value in {**values, "clocks": 7 * number, **header}.items():
            head[name] = value
        buffer = self.memory.buffers[list(self.written).index(ring)]
        slot = buffer.reshape(SLOTS, -1)[(self.written[ring] - 1) % SLOTS]
        slot[: head.nbytes] = head.view(np.uint8)
        slot[self.maps.HEADER_BYTES :][: packet.size] = packet
        self.memory.set(f"{ring}_written", self.written[ring])

    def show(self, number: int, **header: int) -> None:
        for ring in self.written:
            self.deliver(ring, number, 2 if ring == "features" else 1, **header)

    @property
    def released(self) -> set[int]:
        return {self.memory.get(f"{ring}_read") for ring in self.written}


@pytest.fixture(params=[PLAIN, ESTIMATING], ids=["plain", "estimating"])
def camera(request: pytest.FixtureRequest) -> Iterator[Camera]:
    with host_programs(request.param) as load:
        yield Camera(load("skymosaic_rings"), request.param)


def test_frames_come_in_order_through_a_ring_that_wraps(camera: Camera) -> None:
    assert camera.rings.next_frame(0) is None
    for number in range(1, 2 * SLOTS + 2):
        camera.show(number)
        frame = camera.rings.next_frame(0)
        assert (frame.number, frame.time, frame.clocks, frame.good) == (number, 1000 * number, 7 * number, number % 2)
        assert (len(frame.features), len(frame.matches)) == (2, 1)
        assert set(frame.features.view(np.uint8)[:: frame.features.dtype.itemsize]) == {number}
        assert (frame.homography is None) == ("homographies" not in camera.written)
        assert frame.homography_clocks in (None, 7 * number)
        # The slot stays until it is given back.
        assert camera.released == {number - 1}
        camera.rings.release()
        assert camera.released == {number}
    assert camera.rings.damaged == 0


def test_a_frame_is_there_when_all_of_its_packets_are(camera: Camera) -> None:
    camera.deliver("features", 1, 2)
    assert camera.rings.next_frame(0.01) is None
    assert camera.memory.waits == 5
    for ring in list(camera.written)[1:]:
        camera.deliver(ring, 1, 1)
    assert camera.rings.next_frame(0).number == 1


@pytest.mark.parametrize("fault", [{"flags": 2}, {"sequence": 9}, {"length_bytes": 1 << 20}, {"length_bytes": 4}])
def test_damaged_packets_are_skipped_and_counted(camera: Camera, fault: dict[str, int]) -> None:
    camera.show(1, **fault)
    camera.show(2)
    assert camera.rings.next_frame(0).number == 2
    assert camera.rings.damaged == 1


def test_packets_whose_last_record_is_another_one_are_skipped_and_counted(camera: Camera) -> None:
    maps = camera.maps
    lengths = {"features": maps.FEATURE.itemsize, "matches": maps.MATCH.itemsize}
    for n, (ring, buffer) in enumerate(zip(camera.written, camera.memory.buffers, strict=True)):
        camera.show(n + 1)
        slot = buffer.reshape(SLOTS, -1)[n]
        length = int(slot[: maps.HEADER.itemsize].view(maps.HEADER)[0]["length_bytes"])
        # The tag of a status, or of a homography.
        slot[maps.HEADER_BYTES + length - lengths.get(ring, length)] ^= 1
    assert camera.rings.next_frame(0) is None
    assert camera.rings.damaged == len(camera.written)


def test_a_ring_that_lost_a_packet_does_not_shift_the_others(camera: Camera) -> None:
    camera.deliver("features", 1, 2)
    camera.show(2)
    # The others have no packet of frame 1, so that of the features goes.
    frame = camera.rings.next_frame(0)
    assert (frame.number, camera.rings.damaged) == (2, 1)
    assert {ring: camera.memory.get(f"{ring}_read") for ring in camera.written} == {
        ring: int(ring == "features") for ring in camera.written
    }


def test_rings_are_set_up_at_their_addresses_and_closed(camera: Camera) -> None:
    for index, ring in enumerate(camera.written):
        names = ("base_high", "base_low", "slots", "read", "enable")
        assert [camera.memory.get(f"{ring}_{name}") for name in names] == [index + 1, 4096 * (index + 5), SLOTS, 0, 1]
        pages = camera.memory.get(f"{ring}_slot_pages")
        assert len(camera.memory.buffers[index]) == SLOTS * pages * 4096
    camera.rings.close()
    assert {camera.memory.get(f"{ring}_enable") for ring in camera.written} == {0}
    assert camera.memory.get("enable") == 0
    camera.memory.set("clearing", 1)
    with pytest.raises(Exception, match="clearing does not become 0; the memory does not answer: restart the board"):
        camera.rings.close()
