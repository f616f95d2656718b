"""Matches two gray images on the board: python3 pair.py LEFT.npy RIGHT.npy (uint8 arrays of one shape)."""

import sys

import numpy as np
from pynq_bus import PynqBus
from skymosaic_driver import Accelerator

left, right = (np.load(path) for path in sys.argv[1:3])
accelerator = Accelerator(PynqBus("skymosaic.bit"))
# Of the preset "aerial". Cells are larger above 640x480, or the features of 1920x1080 would not fit; for sizes between,
# the host keeps more in a cell.
settings = {
    "width_px": left.shape[1],
    "height_px": left.shape[0],
    "cell_log2": 5 if left.size <= 640 * 480 else 6,
    "per_cell": 5 if left.size <= 640 * 480 else 3,
    "detector": 0,
    "threshold_code": 2,
    "keep_above": 64,
}
frames = accelerator.run([left, right], settings, hold_reference=True)
for name, frame in zip(("left", "right"), frames, strict=True):
    print(f"{name}: {len(frame.features)} features, {frame.status['cycles']} clocks")
matches = frames[1].matches
print(f"{len(matches)} mutual matches, {np.count_nonzero(matches['verdict'])} kept")
