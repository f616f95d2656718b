"""Scores homographies by the matches in the accelerator. Needs Python 3.10 and numpy."""

import numpy as np
import skymosaic_map as register_map
from skymosaic_registers import AcceleratorError

MAX_HYPOTHESES = 1024


class Scorer:
    """Sends hypotheses to the accelerator, which scores them by the matches of the newest frame."""

    def __init__(self, bus):
        self.bus = bus
        self._sent = bus.allocate(MAX_HYPOTHESES * register_map.HYPOTHESIS.itemsize)
        # Room for the answer to a record that ends a broken packet.
        self._received = bus.allocate((MAX_HYPOTHESES + 1) * register_map.SCORE.itemsize)

    def score(self, homographies):
        """Score homographies.

        Parameters
        ----------
        homographies : float64 ndarray, shape (M, 3, 3)
            At least one and at most `MAX_HYPOTHESES`. They map pixels of the reference to pixels of the newest
            frame; points in front of the camera have a positive third coordinate.

        Returns
        -------
        structured ndarray, shape (M,)
            Records of `skymosaic_map.SCORE`. ``frame`` is the number in the status of the matches. Where ``causes``
            is not 0, there is no score, for example without matches.

        Raises
        ------
        AcceleratorError
            For a wrong number of homographies, one that is zero or not finite, or answers that do not come.
        """
        return self.score_integers(quantise(np.asarray(homographies, dtype=np.float64)))

    def score_integers(self, hypotheses):
        """Score homographies given as 32-bit integers (M, 3, 3) in the fixed point of `quantise`."""
        if not 1 <= len(hypotheses) <= MAX_HYPOTHESES:
            raise AcceleratorError(f"{len(hypotheses)} homographies; send 1 to {MAX_HYPOTHESES} at a time")
        records = np.zeros(len(hypotheses), register_map.HYPOTHESIS)
        records["tag"], records["number"] = register_map.HYPOTHESIS_TAG, np.arange(len(records))
        for row, column in np.ndindex(3, 3):
            records[f"h{row}{column}"] = hypotheses[:, row, column].astype(np.int32).view(np.uint32)
        self._sent[: records.nbytes] = records.view(np.uint8)
        length = len(records) * register_map.SCORE.itemsize
        if self.bus.exchange(self._sent, records.nbytes, self._received) != length:
            raise AcceleratorError(f"the scores do not have {length} bytes; load the bitstream again")
        scores = np.array(self._received[:length]).view(register_map.SCORE)
        if (scores["tag"] != register_map.SCORE_TAG).any() or (scores["number"] != records["number"]).any():
            raise AcceleratorError("the answers are not the scores of these homographies; load the bitstream again")
        return scores


def quantise(homographies):
    """Convert homographies (M, 3, 3) to integers: positions in units of 4096 px, the largest element 2^24 - 1."""
    units = np.array([register_map.UNIT_PX, register_map.UNIT_PX, 1.0])
    scaled = homographies * units / units[:, np.newaxis]
    largest = np.abs(scaled).max(axis=(1, 2), initial=0)
    wrong = np.flatnonzero(~(np.isfinite(largest) & (largest > 0)))
    if wrong.size:
        raise AcceleratorError(f"homography {wrong[0]} is zero or not finite; leave it out")
    normalised = scaled / largest[:, np.newaxis, np.newaxis]
    return np.floor(normalised * register_map.MAX_ELEMENT + 0.5).astype(np.int64)
