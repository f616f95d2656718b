"""Frames as beats, seeded pauses, and answers of registers."""

import numpy as np
import pytest

from sim.backends.errors import BackendError
from sim.simulators.recording import Output, Pauses, check_access, flatten_frame

GRAY = np.array([[1, 2, 3], [4, 5, 6]], np.uint8)
COLOUR = np.stack([GRAY, GRAY + 0x10, GRAY + 0x20], axis=-1)


@pytest.mark.parametrize(
    ("image", "pair_bits", "words", "flags"),
    [
        (GRAY, 0, [1, 2, 3, 4, 5, 6], [1, 0, 2, 0, 0, 2]),
        (GRAY, 16, [0x201, 0xFF03, 0x504, 0xFF06], [1, 2, 0, 2]),
        (COLOUR[:1], 0, [0x210111, 0x220212, 0x230313], [1, 0, 2]),
        (COLOUR[:1], 48, [0x220212210111, 0xFFFFFF230313], [1, 2]),
        (GRAY[:1, :1], 0, [1], [3]),
    ],
    ids=["gray", "gray pairs", "colour", "colour pairs", "one pixel"],
)
def test_a_frame_is_beats_with_flags(image: np.ndarray, pair_bits: int, words: list[int], flags: list[int]) -> None:
    data, marked = flatten_frame(image, pair_bits=pair_bits)
    assert (data.tolist(), marked.tolist()) == (words, flags)


@pytest.mark.parametrize(("name", "limit"), [("gaps", 256), ("stalls", 256), ("seed", 1 << 24)])
def test_pauses_have_limits(name: str, limit: int) -> None:
    for inside in (0, limit - 1):
        Pauses(**{name: inside})
    for outside in (-1, limit):
        with pytest.raises(ValueError, match=f"{name} is {outside}; it must be 0 to {limit - 1}"):
            Pauses(**{name: outside})


def test_pauses_come_as_often_as_asked_and_differ_between_streams() -> None:
    pauses = Pauses(gaps=64, stalls=192, seed=5)
    gaps, others = ([pauses.gap(cycle, stream) for cycle in range(4000)] for stream in (0, 1))
    stalls = [pauses.stall(cycle, 0) for cycle in range(4000)]
    assert [np.mean(each) for each in (gaps, others, stalls)] == pytest.approx([0.25, 0.25, 0.75], abs=0.03)
    assert gaps != others
    assert not any(Pauses().gap(cycle) for cycle in range(500))


@pytest.mark.parametrize(("response", "says"), [(-1, "got no answer"), (2, r"was refused \(response 2\)")])
def test_a_register_that_refuses_is_named(response: int, says: str) -> None:
    check_access("read", 0x1C, 0)
    with pytest.raises(BackendError, match=f"the read of register 0x01c {says}"):
        check_access("read", 0x1C, response)


def test_only_whole_packets_are_packets() -> None:
    words = np.arange(7, dtype=np.uint64)
    assert [each.tolist() for each in Output(words, np.array([[3, 9], [5, 12]], np.uint64)).packets] == [
        [0, 1, 2],
        [3, 4],
    ]
