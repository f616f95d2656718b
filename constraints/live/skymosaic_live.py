"""Reads the rings that a live build of skymosaic writes. Needs Python 3.10 and numpy, nothing else.

`Live` uses a *bus*: registers, memory that the accelerator can write, and a wait. On a board that is
`live_bus.LiveBus`; tests pass an object with the same methods that runs a simulation.

    live = Live(bus, settings)
    for frame in live:
        use(frame.number, frame.features, frame.matches)
    print(live.counts())
    live.close()
"""

import skymosaic_map as register_map
from skymosaic_registers import AcceleratorError, Registers

RINGS = ("features", "matches")
PAGE_BYTES = 4096
HEADER_BYTES = 128
WAIT_SECONDS = 0.002
TIMEOUT_SECONDS = 5.0
SPARE_RECORDS = 2
COUNTERS = (
    "camera_frames", "dropped", "cut", "features_errors", "matches_errors", "features_lost", "matches_lost", "scored",
    "unscored",
)  # fmt: skip


class LiveFrame:
    """A frame in memory; the arrays are views of the rings, valid until the next frame is asked for.

    Attributes
    ----------
    number : int
        Of the camera's frame, from 1 on; a gap is a frame that was dropped.
    time, clocks : int
        Clock of its first pixel, and clocks from there until its matches were in memory.
    good : bool
        Whether the frame was whole; a bad one has no features that count.
    features, matches : structured ndarray
        Records of `skymosaic_map.FEATURE` and `skymosaic_map.MATCH`.
    status, match_status : structured scalar
        `skymosaic_map.STATUS`.
    """

    def __init__(self, feature_slot, match_slot):
        (header, self.features, self.status), (later, self.matches, self.match_status) = feature_slot, match_slot
        self.number, self.time, self.clocks = int(header["number"]), int(header["time"]), int(later["clocks"])
        self.good = bool(self.status["good"])


class Ring:
    """One ring of slots in memory.

    Parameters
    ----------
    registers : LiveRegisters
    name : {"features", "matches"}
    dtype : numpy.dtype
        Of its records.
    slots : int
    """

    def __init__(self, registers, name, dtype, slots):
        self.registers, self.name, self.dtype, self.slots = registers, name, dtype, slots
        longest = HEADER_BYTES + (register_map.BUILT["built_max_features"] + SPARE_RECORDS) * dtype.itemsize
        self.slot_pages = -(-longest // PAGE_BYTES)
        self.buffer = registers.bus.allocate(slots * self.slot_pages * PAGE_BYTES)
        self.address = registers.bus.address(self.buffer)
        if self.address % PAGE_BYTES:
            raise AcceleratorError(f"the ring of {name} lies at {self.address:#x}, not at a multiple of {PAGE_BYTES}")
        self.read = 0

    def stop(self):
        """Switch the ring off, and wait until nothing of it is being written."""
        self.registers.write(**{f"{self.name}_enable": 0})
        self.registers.wait_for(f"{self.name}_active", 0)

    def start(self):
        """Set the ring up from its first slot on, and switch it on."""
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
        self.registers.write(**{f"{self.name}_enable": 1})

    def waiting(self):
        """How many packets are in memory that have not been released."""
        return (self.registers.read(f"{self.name}_written") - self.read) % (1 << 32)

    def head(self):
        """Header, records and status of the oldest packet, as views; None if it is damaged."""
        start = self.read % self.slots * self.slot_pages * PAGE_BYTES
        slot = self.buffer[start : start + self.slot_pages * PAGE_BYTES]
        self.registers.bus.invalidate(self.buffer)
        header = slot[: register_map.HEADER.itemsize].view(register_map.HEADER)[0]
        length = int(header["length_bytes"])
        records, rest = divmod(length, self.dtype.itemsize)
        is_mine = int(header["sequence"]) == (self.read + 1) % (1 << 32)
        if not is_mine or header["flags"] or rest or not records or HEADER_BYTES + length > slot.size:
            return None
        packet = slot[HEADER_BYTES : HEADER_BYTES + length]
        status = packet[length - self.dtype.itemsize :][: register_map.STATUS.itemsize].view(register_map.STATUS)[0]
        if status["tag"] != register_map.STATUS_TAG:
            return None
        return header, packet.view(self.dtype)[:-1], status

    def release(self):
        """Give the oldest packet's slot back."""
        self.read = (self.read + 1) % (1 << 32)
        self.registers.write(**{f"{self.name}_read": self.read})


class LiveRegisters(Registers):
    """Registers that can be waited for, with the time of the bus."""

    def wait_for(self, field, value):
        """Wait until a field has a value."""
        for _ in range(round(TIMEOUT_SECONDS / WAIT_SECONDS)):
            if self.read(field) == value:
                return
            self.bus.wait(WAIT_SECONDS)
        raise AcceleratorError(f"{field} does not become {value}; the memory does not answer: load the bitstream again")


class Live:
    """Frames of a camera with their features and matches, as they come into memory.

    Parameters
    ----------
    bus : LiveBus or an object with its methods
    settings : dict
        Values of the register fields in `skymosaic_map.REQUESTED`, and ``gray_input``.
    slots : int
        Frames that memory holds; more let the host pause for longer.
    hold_reference : bool
        Match every frame with the first; otherwise each with the previous one.

    Attributes
    ----------
    damaged : int
        Packets that were left out because the memory reported an error.
    """

    def __init__(self, bus, settings, slots=8, hold_reference=False):
        self.registers = LiveRegisters(bus)
        self.settings = settings
        self.hold_reference = hold_reference
        self.damaged = 0
        self._rings = {
            name: Ring(self.registers, name, dtype, slots)
            for name, dtype in zip(RINGS, (register_map.FEATURE, register_map.MATCH), strict=True)
        }
        self.restart()

    def restart(self):
        """Start over with empty rings, whatever was under way."""
        self.close()
        self.registers.write(**self.settings, memory_mode=0, hold_reference=int(self.hold_reference))
        for ring in self._rings.values():
            ring.start()
        self.registers.write(enable=1)

    def close(self):
        """Switch camera and rings off. Until then the accelerator writes the rings' memory: do not free it before."""
        self.registers.write(enable=0, clear=1)
        for ring in self._rings.values():
            ring.stop()

    def counts(self):
        """What the shell has counted since its reset, and why the last frame was dropped."""
        return {name: self.registers.read(name) for name in (*COUNTERS, "dropped_reason", "refused", "camera_stopped")}

    def __iter__(self):
        """Frames for as long as they come."""
        while True:
            frame = self.next_frame(TIMEOUT_SECONDS)
            if frame is None:
                return
            yield frame
            self.release()

    def next_frame(self, timeout_seconds):
        """The oldest frame, or None if none comes in time; `release` gives its memory back."""
        waits = round(timeout_seconds / WAIT_SECONDS)
        while True:
            if all(ring.waiting() for ring in self._rings.values()):
                slots = [ring.head() for ring in self._rings.values()]
                numbers = [None if slot is None else int(slot[0]["number"]) for slot in slots]
                if None not in numbers and numbers[0] == numbers[1]:
                    return LiveFrame(*slots)
                self._leave_out(numbers)
            elif waits:
                waits -= 1
                self.registers.bus.wait(WAIT_SECONDS)
            else:
                return None

    def _leave_out(self, numbers):
        """A damaged packet takes the other ring's with it; where one ring has lost a packet, the older one goes."""
        self.damaged += 1
        ahead = None not in numbers and numbers[0] > numbers[1]
        for position, ring in enumerate(self._rings.values()):
            if None in numbers or position == ahead:
                ring.release()

    def release(self):
        """Give the memory of the frame read last back to the accelerator."""
        for ring in self._rings.values():
            ring.release()
