"""Reads the rings that a camera build of skymosaic writes. Needs Python 3.10 and numpy.

`RingReader` uses a *bus*: registers, memory that the accelerator can write, and a wait. On a board it is
`ring_bus.RingBus`; tests pass an object with the same methods that runs a simulation.

    rings = RingReader(bus, settings)
    for frame in rings:
        use(frame.number, frame.features, frame.matches)
    print(rings.counts())
    rings.close()
"""

import skymosaic_map as register_map
from skymosaic_map import HEADER_BYTES, PACKET_BYTES, PAGE_BYTES
from skymosaic_registers import AcceleratorError, Registers, split_packet

RINGS = {"features": register_map.FEATURE, "matches": register_map.MATCH}
if register_map.BUILT["built_homographies"]:
    RINGS["homographies"] = register_map.HOMOGRAPHY
WAIT_SECONDS = 0.002
TIMEOUT_SECONDS = 5.0
COUNTERS = ("camera_frames", "dropped", "cut")


class RingFrame:
    """A frame in memory; the arrays are views of the rings, valid until the next frame is requested.

    Attributes
    ----------
    number : int
        Number of the camera's frame, from 1 on; gaps are dropped frames.
    time, clocks : int
        Clock of its first pixel, and clocks from there until its matches were in memory.
    good : bool
        Whether the frame was complete; the features of a bad one are invalid.
    features, matches : structured ndarray
        Records of `skymosaic_map.FEATURE` and `skymosaic_map.MATCH`.
    status, match_status : structured scalar
        `skymosaic_map.STATUS`.
    homography : structured scalar or None
        `skymosaic_map.HOMOGRAPHY`; None where the build estimates none.
    homography_clocks : int or None
        Clocks from the first pixel until it was in memory.
    """

    def __init__(self, feature_slot, match_slot, homography_slot=None):
        (header, self.features, self.status), (later, self.matches, self.match_status) = feature_slot, match_slot
        self.number, self.time, self.clocks = int(header["number"]), int(header["time"]), int(later["clocks"])
        self.good = bool(self.status["good"])
        self.homography, self.homography_clocks = None, None
        if homography_slot is not None:
            header, _, self.homography = homography_slot
            self.homography_clocks = int(header["clocks"])


class Ring:
    """One ring of slots in memory.

    Parameters
    ----------
    registers : Registers
    name : str
        A key of `RINGS`, where the type of its records is.
    slots : int
    """

    def __init__(self, registers, name, slots):
        self.registers, self.name, self.dtype, self.slots = registers, name, RINGS[name], slots
        self.slot_pages = -(-(HEADER_BYTES + PACKET_BYTES[name]) // PAGE_BYTES)
        self.buffer = registers.bus.allocate(slots * self.slot_pages * PAGE_BYTES)
        self.address = registers.bus.address(self.buffer)
        if self.address % PAGE_BYTES:
            raise AcceleratorError(f"the ring of {name} lies at {self.address:#x}, not at a multiple of {PAGE_BYTES}")
        self.read = 0

    def start(self):
        """Set the ring up and switch it on; it starts at its first slot."""
        self.read = 0
        self.registers.write(
            **{
                f"{self.name}_base_low": self.address & 0xFFFF_FFFF,
                f"{self.name}_base_high": self.address >> 32,
                f"{self.name}_slots": self.slots,
                f"{self.name}_slot_pages": self.slot_pages,
                f"{self.name}_read": 0,
            }
        )
        # After the others, which may change only while the ring is off.
        self.registers.write(**{f"{self.name}_enable": 1})

    def waiting(self):
        """Count the packets in memory that have not been released."""
        return (self.registers.read(f"{self.name}_written") - self.read) % (1 << 32)

    def head(self):
        """View header, records and status (or the homography) of the oldest packet; None if it is damaged."""
        start = self.read % self.slots * self.slot_pages * PAGE_BYTES
        slot = self.buffer[start : start + self.slot_pages * PAGE_BYTES]
        self.registers.bus.invalidate(self.buffer)
        header = slot[: register_map.HEADER.itemsize].view(register_map.HEADER)[0]
        end = HEADER_BYTES + int(header["length_bytes"])
        # An old sequence number: the memory refused the header, and the one before is still there.
        is_expected = int(header["sequence"]) == (self.read + 1) % (1 << 32)
        if not is_expected or header["flags"] or end > slot.size:
            return None
        packet = slot[HEADER_BYTES:end]
        if self.name == "homographies":
            # A packet of one record, without a status.
            is_whole = packet.size == self.dtype.itemsize and packet[0] == register_map.HOMOGRAPHY_TAG
            return (header, None, packet.view(self.dtype)[0]) if is_whole else None
        try:
            return header, *split_packet(packet, self.dtype)
        except AcceleratorError:
            return None

    def release(self):
        """Return the oldest packet's slot to the accelerator."""
        self.read = (self.read + 1) % (1 << 32)
        self.registers.write(**{f"{self.name}_read": self.read})


class RingReader:
    """Frames of a camera with their features, matches and homographies, as they arrive in memory.

    Parameters
    ----------
    bus : RingBus or an object with its methods
    settings : dict
        Values of the register fields in `skymosaic_map.REQUESTED`, and ``gray_input``; those in
        `skymosaic_map.ESTIMATION` keep theirs if they are left out.
    slots : int
        Number of frames that fit the memory; with more, the host can pause for longer.
    hold_reference : bool
        Match every frame with the first; otherwise each with the good one before, which its matches name. Once a build
        with homographies has accepted one, it passes over frames whose own is refused.

    Attributes
    ----------
    damaged : int
        Packets that were skipped because the memory had reported an error.
    """

    def __init__(self, bus, settings, slots=8, hold_reference=False):
        self.registers = Registers(bus)
        self.settings = settings
        self.hold_reference = hold_reference
        self.damaged = 0
        self._rings = {name: Ring(self.registers, name, slots) for name in RINGS}
        self.restart()

    def restart(self):
        """Start again with empty rings, whatever was in progress."""
        self.close()
        self.registers.write(**self.settings, memory_mode=0, hold_reference=int(self.hold_reference))
        for ring in self._rings.values():
            ring.start()
        self.registers.write(enable=1)

    def close(self):
        """Switch camera and rings off, and wait until the accelerator has ended its bursts into memory.

        Only then may the rings' memory be freed, the design be reset, or another one be loaded.
        """
        self.registers.write(enable=0, clear=1)
        for _ in range(round(TIMEOUT_SECONDS / WAIT_SECONDS)):
            if not self.registers.read("clearing"):
                self.registers.write(**{f"{ring}_enable": 0 for ring in RINGS})
                return
            self.registers.bus.wait(WAIT_SECONDS)
        raise AcceleratorError("clearing does not become 0; the memory does not answer: restart the board")

    def counts(self):
        """Read the shell's counters since its reset, and why the last frame was dropped."""
        rings = (f"{ring}_{name}" for ring in RINGS for name in ("errors", "lost"))
        refusals = ["refused", *(["homographies_refused"] if "homographies" in RINGS else [])]
        names = (*COUNTERS, *rings, "dropped_reason", *refusals, "camera_stopped")
        return {name: self.registers.read(name) for name in names}

    def __iter__(self):
        """Iterate over the frames until none comes for `TIMEOUT_SECONDS`."""
        while True:
            frame = self.next_frame(TIMEOUT_SECONDS)
            if frame is None:
                return
            yield frame
            self.release()

    def next_frame(self, timeout_seconds):
        """Wait for the oldest frame, or return None if none comes in time; `release` frees its memory."""
        waits = round(timeout_seconds / WAIT_SECONDS)
        while True:
            # A frame is there when all of its packets are.
            if all(ring.waiting() for ring in self._rings.values()):
                slots = [ring.head() for ring in self._rings.values()]
                numbers = [None if slot is None else int(slot[0]["number"]) for slot in slots]
                if None not in numbers and len(set(numbers)) == 1:
                    return RingFrame(*slots)
                self._skip_damaged(numbers)
            elif waits:
                waits -= 1
                self.registers.bus.wait(WAIT_SECONDS)
            else:
                return None

    def _skip_damaged(self, numbers):
        """Release all packets where one is damaged, or the older ones where a ring has lost its own."""
        self.damaged += 1
        for number, ring in zip(numbers, self._rings.values(), strict=True):
            if None in numbers or number < max(numbers):
                ring.release()

    def release(self):
        """Return the slots of the frame read last to the accelerator."""
        for ring in self._rings.values():
            ring.release()
