"""The accelerator's registers and packets, for every host program of an export. Needs Python 3.10 and numpy."""

import skymosaic_map as register_map


class AcceleratorError(Exception):
    """The accelerator cannot do what was requested; the message is one line with the reason and what to do."""


class Registers:
    """Register fields by name; the bus has ``read(offset)`` and ``write(offset, value)`` for words of 32 bits.

    Raises
    ------
    AcceleratorError
        If another design is loaded, or a build that was not exported with this folder.
    """

    def __init__(self, bus):
        self.bus = bus
        for name, expected in register_map.BUILT.items():
            value = self.read(name)
            if value != expected:
                raise AcceleratorError(
                    f"{name} reads {value:#x}, this program is for {expected:#x}; load the bitstream of the same export"
                )

    def read(self, field):
        """Read a register field."""
        offset, low, bits = register_map.FIELDS[field]
        return self.bus.read(offset) >> low & (1 << bits) - 1

    def check(self, fields):
        """Check that every field can be written, and that its value is valid for this build."""
        for name, value in fields.items():
            if name not in register_map.WRITABLE:
                raise AcceleratorError(f"{name} cannot be written; valid: {', '.join(sorted(register_map.WRITABLE))}")
            smallest, largest = register_map.WRITABLE[name]
            # The size has a built limit besides that of its field.
            largest = min(largest, register_map.BUILT.get("built_" + name, largest))
            if not smallest <= value <= largest:
                raise AcceleratorError(f"{name} is {value}; it must be {smallest} to {largest}")

    def write(self, **fields):
        """Set register fields; other fields of the same registers keep their values."""
        self.check(fields)
        words = {}
        for name, value in fields.items():
            offset, low, bits = register_map.FIELDS[name]
            # A pending request reads 1; written back, it would be made again.
            kept = self.bus.read(offset) & ~register_map.REQUEST_BITS.get(offset, 0)
            word = words.get(offset, kept)
            words[offset] = word & ~((1 << bits) - 1 << low) | value << low
        for offset, word in words.items():
            self.bus.write(offset, word)


def split_packet(packet, dtype):
    """Split a packet, an array of bytes, into its records and the FrameStatus at its end.

    Raises
    ------
    AcceleratorError
        If it has another length, or no status.
    """
    if packet.size < dtype.itemsize or packet.size % dtype.itemsize:
        raise AcceleratorError(
            f"a packet has {packet.size} bytes, which is not a multiple of {dtype.itemsize}-byte records"
        )
    status = packet[packet.size - dtype.itemsize :][: register_map.STATUS.itemsize].view(register_map.STATUS)[0]
    if status["tag"] != register_map.STATUS_TAG:
        raise AcceleratorError("a packet does not end with a frame's status; clear the accelerator and try again")
    return packet.view(dtype)[:-1], status
