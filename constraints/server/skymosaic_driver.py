"""Driver of the skymosaic accelerator. Needs Python 3.10 and numpy.

`Accelerator` uses a *bus*: registers and three DMA channels. On the board it is `pynq_bus.PynqBus`; tests pass an
object with the same methods that runs a simulation.

    from pynq_bus import PynqBus
    from skymosaic_driver import Accelerator

    accelerator = Accelerator(PynqBus("skymosaic.bit"))
    frames = accelerator.run([left, right], settings, hold_reference=True)
"""

import itertools

import numpy as np

import skymosaic_map as register_map
from skymosaic_registers import AcceleratorError, Registers, split_packet

CHANNELS = tuple(register_map.PACKET_BYTES)
TIMEOUT_SECONDS = 5.0


class Frame:
    """The results of one frame.

    Attributes
    ----------
    features, matches : structured ndarray
        Records of `skymosaic_map.FEATURE` and `skymosaic_map.MATCH`.
    status, match_status : structured scalar
        `skymosaic_map.STATUS`, from the end of the feature packet and of the match packet.
    homography : structured scalar or None
        `skymosaic_map.HOMOGRAPHY`; None where the build estimates none.
    """

    def __init__(self, feature_packet, match_packet, homography_packet=None):
        self.features, self.status = split_packet(feature_packet, register_map.FEATURE)
        self.matches, self.match_status = split_packet(match_packet, register_map.MATCH)
        self.homography = None if homography_packet is None else homography_packet.view(register_map.HOMOGRAPHY)[0]


class Accelerator(Registers):
    """The accelerator behind a bus.

    Parameters
    ----------
    bus : PynqBus or an object with its methods
    timeout_seconds : float
        Maximum time for one frame.

    Raises
    ------
    AcceleratorError
        If another design is loaded, or a build that was not exported with this folder.
    """

    def __init__(self, bus, timeout_seconds=TIMEOUT_SECONDS):
        super().__init__(bus)
        self.timeout_seconds = timeout_seconds
        self.video_bits = self.read("built_video_bits")
        self.max_width_px, self.max_height_px = self.read("built_width_px"), self.read("built_height_px")
        self._received = {channel: bus.allocate(length) for channel, length in register_map.PACKET_BYTES.items()}
        # With two pixels per clock, a line of odd width has one more.
        self._sent = bus.allocate(4 * (self.max_width_px + 1) * self.max_height_px)

    def run(self, frames, settings, hold_reference):
        """Extract the features of each frame, and match it with its reference; the first frame has no matches.

        Parameters
        ----------
        frames : iterable of uint8 ndarray, shape (H, W) or (H, W, 3) BGR
            At least one, all of one shape; taken one at a time, so that a server need not keep them all.
        settings : dict
            Values of the register fields in `skymosaic_map.REQUESTED`; those in `skymosaic_map.ESTIMATION` keep theirs
            if they are left out.
        hold_reference : bool
            Match every frame with the first; otherwise each with the good one before, which its matches name. Once a
            build with homographies has accepted one, it passes over frames whose own is refused.
        """
        self.check(settings)
        frames = iter(frames)
        first = next(frames)
        self.check_frame(first.shape)
        self._recover()
        self.write(
            **settings,
            memory_mode=1,
            gray_input=int(first.ndim == 2),
            **{channel + "_enable": 1 for channel in CHANNELS},
            hold_reference=int(hold_reference),
        )
        # Alone, since it starts the accelerator: the fields above are in several registers.
        self.write(enable=1)
        size_px = settings["width_px"], settings["height_px"]
        return [self._run_one(frame, size_px) for frame in itertools.chain([first], frames)]

    def check_frame(self, shape):
        """Check that the input takes a frame of this shape, and that a DMA can send it at once."""
        bits = self.video_bits
        if len(shape) == 3 and bits in (8, 16):
            raise AcceleratorError(f"this build's {bits}-bit input takes gray frames only; convert the frame to gray")
        height, width = shape[:2]
        if bits in (16, 48):
            width += width % 2
        length_bytes = height * width * (4 if len(shape) == 3 or bits in (24, 48) else 1)
        largest = register_map.MAX_TRANSFER_BYTES
        if length_bytes > largest:
            raise AcceleratorError(
                f"a frame of {shape[1]}x{height} has {length_bytes} bytes, a DMA sends at most {largest}; "
                "send a smaller or a gray one"
            )

    def _recover(self):
        """End whatever an interrupted run has left: transfers, frames and unfinished packets."""
        self.bus.reset()
        self.write(enable=0, clear=1)
        # AXI4-Stream withdraws no word: the accelerator completes an unfinished packet, and someone has to take it.
        for channel in CHANNELS:
            if self.read(channel + "_waiting"):
                self.bus.start_receive(channel, self._received[channel])
                self.bus.wait(self.timeout_seconds)
        if self.read("clearing"):
            raise AcceleratorError("a packet does not end after a clear; load the bitstream again")
        # A DMA takes some words before it is asked to: they may be such a rest.
        self.bus.reset()

    def _run_one(self, frame, size_px):
        if frame.shape[1::-1] != size_px:
            raise AcceleratorError(
                f"a frame has {frame.shape[1]}x{frame.shape[0]} px; SIZE is {size_px[0]}x{size_px[1]}"
            )
        # Into the one buffer that the DMA can read.
        words = as_words(frame, self.video_bits)
        self._sent[: words.nbytes] = words.view(np.uint8)
        # Receive before send: the outputs stall the accelerator until their DMAs are ready.
        for channel in CHANNELS:
            self.bus.start_receive(channel, self._received[channel])
        self.bus.start_send(self._sent, words.nbytes)
        lengths = self.bus.wait(self.timeout_seconds)
        packets = [np.array(self._received[channel][: lengths[channel]]) for channel in CHANNELS]
        return Frame(*packets)


def as_words(frame, video_bits=32):
    """Convert a frame to the format of memory mode: four gray pixels in a 32-bit word, or one pixel as R, G, B, X.

    An 8-bit input takes gray pixels as bytes; for a 24-bit one, each has a word of its own. An input of 16 or 48 bits
    takes two pixels at once, and every line starts with a new pair: two bytes of gray, or 64 bits with R, G, B (or gray
    in their places) of both pixels and two bytes that are dropped.

    Bytes are returned as they are: only an input of 32 bits drops what fills the last word; on a narrower one it would
    begin the next frame.
    """
    count = 2 if video_bits in (16, 48) else 1
    if frame.shape[1] % count:
        frame = np.pad(frame, [(0, 0), (0, 1), (0, 0)][: frame.ndim])
    if frame.ndim == 2 and video_bits not in (24, 48):
        pixels = frame.reshape(-1)
        if video_bits != 32:
            return pixels
        return np.concatenate((pixels, np.zeros(-pixels.size % 4, np.uint8))).view(np.uint32)
    height, width = frame.shape[:2]
    words = np.zeros((height, width // count, 4 * count), np.uint8)
    # A view: the pixels of each word or pair.
    pixels = words[..., : 3 * count].reshape(height, -1, count, 3)
    pixels[..., : 1 if frame.ndim == 2 else 3] = frame.reshape(height, -1, count, frame[0, 0].size)[..., ::-1]
    return words.reshape(-1).view(np.uint32)
