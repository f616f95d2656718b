"""Window correlation and the sum of absolute differences equal the golden model."""

import numpy as np
from numpy.typing import NDArray

from golden_model.matching import correlation
from hdl.matching.correlation import PIXELS, SumOfAbsoluteDifferences, WindowCorrelation
from sim.simulators.recording import Pauses
from tests.hdl.drivers import run_clocks, run_streams
from tests.hdl.matching.windows import check_latency, payloads


def windows() -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Pairs of windows: random, similar, the extremes of every score, flat, black, single pixels."""
    rng = np.random.default_rng(5)
    any_pair = rng.integers(0, 256, (2, 20, PIXELS))
    near = rng.integers(0, 256, (20, PIXELS))
    alike = np.stack([near, (near + rng.integers(-9, 10, near.shape)).clip(0, 255)])
    gain = np.stack([near, near // 2])
    flat = np.repeat(rng.integers(0, 256, (2, 8, 1)), PIXELS, axis=2)
    dots = np.eye(PIXELS, dtype=int)[:, [0, 4, 8, 4]].T * rng.integers(1, 256, (2, 4, 1))
    half = np.arange(PIXELS) % 2 * 255
    black, white = np.zeros(PIXELS, int), np.full(PIXELS, 255)
    extremes = np.array([[half, black, black, white, white, half], [255 - half, black, white, black, white, half]])
    pairs = np.concatenate([any_pair, alike, gain, flat, dots, extremes], axis=1).astype(np.uint8)
    return pairs[0], pairs[1]


def golden_scores(left: NDArray[np.uint8], right: NDArray[np.uint8]) -> NDArray[np.int64]:
    return np.stack([score(left, right) for score in (correlation.sad, correlation.zssd, correlation.ncc)], axis=1)


def test_scores_equal_the_golden_model() -> None:
    left, right = windows()
    expected = golden_scores(left, right)
    assert expected.min(axis=0).tolist() == [0, 0, 0]
    assert expected.max(axis=0).tolist() == [9 * 255, 81 * 255**2 - 255**2, 256]
    dut = WindowCorrelation()
    limit, pauses = 4 * len(left) * dut.latency_cycles, Pauses(gaps=100, stalls=180, seed=4)
    received = run_streams(dut, {"i": payloads(left, right)}, {"o": len(left)}, pauses=pauses, cycle_limit=limit)["o"]
    np.testing.assert_array_equal([(scores.sad, scores.zssd, scores.ncc) for scores in received], expected)


def test_a_result_takes_exactly_the_latency() -> None:
    check_latency(WindowCorrelation())


def test_sum_of_absolute_differences_equals_the_golden_model() -> None:
    rng = np.random.default_rng(5)
    windows = rng.integers(0, 256, (40, 2, 9), dtype=np.uint8)
    windows[0], windows[1, 0], windows[1, 1] = 255, 255, 0
    dut = SumOfAbsoluteDifferences(pixels=9)
    ports = [*dut.i_left, *dut.i_right]
    inputs = [list(zip(ports, pixels, strict=True)) for pixels in windows.reshape(len(windows), -1).tolist()]
    inputs += [[]] * dut.latency_cycles
    sums = [total for (total,) in run_clocks(dut, inputs, [dut.o_sum])[dut.latency_cycles :]]
    np.testing.assert_array_equal(sums, correlation.sad(windows[:, 0], windows[:, 1]))
