"""The accelerator's registers and packets behind a serial port, with the methods of `pynq_bus.PynqBus`.

A command is a letter and two bytes, the lower first: an address, or a number of pixels. `R` reads, `W` and four more
bytes write, `P` sends pixels, and `L` sends pixels up to the end of a frame. The board answers a read or write by `A`,
a byte that is 0 on success, and four bytes of data. It sends a word of features, matches or homographies as 16, 32 or
48, plus 1 at the packet's end, and eight bytes.
"""

import time

import numpy as np
from skymosaic_registers import AcceleratorError

BAUD = 1_000_000
TIMEOUT_SECONDS = 0.2
"""Timeout of a read of the port: after such a pause, nothing more comes."""
ANSWER_SECONDS = 2.0
MAX_PIXELS = 65535
CHUNK_BYTES = 1024
"""After each chunk, received bytes are fetched, which must not overflow the computer's buffers meanwhile."""
ANSWER, ANSWER_BYTES = ord("A"), 6
CHANNELS = {0x10: "features", 0x20: "matches", 0x30: "homographies"}
WORD_BYTES = 9
LOST, LAST = 0x80, 0x01


class SerialBus:
    """Registers, frames and packets over a port.

    Parameters
    ----------
    port : serial.Serial
        With a timeout; or any object with its ``read``, ``write`` and ``in_waiting``.
    """

    def __init__(self, port):
        self._port = port
        self._forget()
        self.reset()

    def read(self, offset):
        """Read a register."""
        return self._access(b"R" + offset.to_bytes(2, "little"))

    def write(self, offset, value):
        """Write a register."""
        self._access(b"W" + offset.to_bytes(2, "little") + int(value).to_bytes(4, "little"))

    def allocate(self, length_bytes):
        """Allocate memory for a frame or a packet."""
        return np.zeros(length_bytes, np.uint8)

    def start_send(self, buffer, length_bytes):
        """Keep a frame until `wait` sends it."""
        self._sent = bytes(buffer[:length_bytes])

    def start_receive(self, channel, buffer):
        """Set the buffer for the next packet of ``channel``."""
        self._receiving[channel] = buffer

    def wait(self, timeout_seconds):
        """Send the frame, and receive the packets of the started channels; returns their lengths in bytes."""
        for start in range(0, len(self._sent), MAX_PIXELS):
            pixels = self._sent[start : start + MAX_PIXELS]
            # Only the last command of a frame ends it.
            letter = b"L" if start + len(pixels) == len(self._sent) else b"P"
            self._send(letter + len(pixels).to_bytes(2, "little") + pixels)
        self._sent = b""
        end = time.monotonic() + timeout_seconds
        while any(not self._complete[channel] for channel in self._receiving):
            if time.monotonic() > end:
                raise AcceleratorError(f"no packets within {timeout_seconds:g} s; press the reset button")
            self._fetch(1)
        lengths = {}
        for channel, buffer in self._receiving.items():
            packet = self._complete[channel].pop(0)
            buffer[: len(packet)] = np.frombuffer(packet, np.uint8)
            lengths[channel] = len(packet)
        self._receiving = {}
        return lengths

    def reset(self):
        """Wait until nothing more comes, and drop everything received, and what was lost before."""
        while self._port.read(CHUNK_BYTES):
            pass
        self._forget()

    def _forget(self):
        self._bytes = b""
        self._is_first = True
        self._answers = []
        self._words = {channel: bytearray() for channel in CHANNELS.values()}
        self._complete = {channel: [] for channel in CHANNELS.values()}
        self._receiving, self._sent = {}, b""

    def _access(self, command):
        """Send a command, and wait for the data of its answer."""
        self._send(command)
        end = time.monotonic() + ANSWER_SECONDS
        while not self._answers:
            if time.monotonic() > end:
                raise AcceleratorError("the board does not answer; check the port, and load the bitstream")
            self._fetch(1)
        status, data = self._answers.pop(0)
        # The first answer after a reset tells of bytes lost before it.
        is_first, self._is_first = self._is_first, False
        if status & LOST and not is_first:
            raise AcceleratorError("bytes were lost on the way to the board; send the frame again")
        return data

    def _send(self, data):
        for start in range(0, len(data), CHUNK_BYTES):
            self._port.write(data[start : start + CHUNK_BYTES])
            if self._port.in_waiting:
                self._fetch(self._port.in_waiting)

    def _fetch(self, count):
        """Take up to ``count`` bytes from the port, and sort complete messages."""
        self._bytes += self._port.read(count)
        while self._bytes:
            tag = self._bytes[0]
            length = ANSWER_BYTES if tag == ANSWER else WORD_BYTES
            # Without a checksum, an unknown tag is what noise or another device looks like.
            if tag != ANSWER and tag & ~LAST not in CHANNELS:
                raise AcceleratorError(f"the port sends {tag:#x}, which is not from the accelerator; check the port")
            if len(self._bytes) < length:
                return
            message, self._bytes = self._bytes[:length], self._bytes[length:]
            if tag == ANSWER:
                self._answers.append((message[1], int.from_bytes(message[2:], "little")))
                continue
            channel = CHANNELS[tag & ~LAST]
            self._words[channel] += message[1:]
            if tag & LAST:
                self._complete[channel].append(bytes(self._words[channel]))
                self._words[channel] = bytearray()
