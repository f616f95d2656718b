"""The host's side of a board: addresses, and what of an answer is believed."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from golden_model.config import EstimatorConfig, preset_config
from golden_model.records import FRAME_STATUS, HOMOGRAPHY, MATCH, Cause, Tag
from sim.backends.errors import BackendError
from sim.backends.interface import FrameResult
from skymosaic.features.board_client import PORT, BoardBackend, _check_status, _list_packets

TOO_MANY = int(Cause.TOO_MANY_FEATURES)


@pytest.mark.parametrize(
    ("address", "reached"),
    [("pynq", ("pynq", PORT)), ("pynq:", ("pynq", PORT)), ("10.0.0.7:0", ("10.0.0.7", 0)), ("b:65535", ("b", 65535))],
)
def test_a_port_may_be_left_out(address: str, reached: tuple[str, int]) -> None:
    assert BoardBackend(address).address == reached


@pytest.mark.parametrize("address", [":", ":7", "b:65536", "b:-1", "b:x", "b:7:8", ""])
def test_what_is_no_address_is_refused(address: str) -> None:
    with pytest.raises(BackendError, match=r"is missing; give it with|is not the address of a board; give HOST or"):
        BoardBackend(address)


@pytest.mark.parametrize(
    ("where", "changed", "says"),
    [
        ("status", {}, ""),
        ("status", {"good": 0, "causes": TOO_MANY}, ""),
        ("match_status", {"good": 0, "causes": TOO_MANY}, ""),
        ("status", {"tag": Tag.MATCH}, "sent an answer without a frame's status; restart"),
        ("match_status", {"frame": 4}, "sent frame 4 instead of 0; restart"),
        ("match_status", {"width": 95}, "sent a frame of 95x64; restart"),
        ("status", {"height": 65}, "sent a frame of 96x65; restart"),
        ("status", {"causes": TOO_MANY}, r"sent a bad frame \(causes 0x10\); restart"),
        ("status", {"good": 0}, r"sent a bad frame \(causes 0x0\); restart"),
        ("match_status", {"good": 0, "causes": TOO_MANY | 1}, r"sent a bad frame \(causes 0x11\); restart"),
        ("homography", {}, ""),
        ("homography", {"tag": Tag.MATCH}, "sent another frame's homography; restart"),
        ("homography", {"frame": 5}, "sent another frame's homography; restart"),
    ],
)
def test_an_answer_has_to_be_of_the_frame_that_was_sent(where: str, changed: dict[str, int], says: str) -> None:
    """Its number wraps with the counter of the board."""
    config = preset_config("aerial")
    parts: dict[str, Any] = {name: np.zeros(1, FRAME_STATUS.dtype) for name in ("status", "match_status")}
    for status in parts.values():
        status["tag"], status["good"], status["width"], status["height"] = Tag.FRAME_STATUS, 1, 96, 64
    if where == "homography":
        parts["homography"] = np.zeros(1, HOMOGRAPHY.dtype)
        parts["homography"]["tag"] = Tag.HOMOGRAPHY
    for name, value in changed.items():
        parts[where][name] = value
    features, matches = np.zeros(0, config.front_end.pattern.record.dtype), np.zeros(0, MATCH.dtype)
    result = FrameResult(features, matches, cycles=0, **{name: part[0] for name, part in parts.items()})
    for shape in ((64, 96), (64, 96, 3)):
        if says:
            with pytest.raises(BackendError, match=f"the board at here {says} serve.py on it$"):
                _check_status(result, 1 << 32, shape, "here")
        else:
            _check_status(result, 1 << 32, shape, "here")


@pytest.mark.parametrize("estimator", [None, EstimatorConfig()])
def test_packets_are_as_long_as_all_records_that_fit(estimator: EstimatorConfig | None) -> None:
    aerial = preset_config("aerial")
    packets = _list_packets(replace(aerial, estimator=estimator))
    feature, status = aerial.front_end.pattern.record.record_bytes, FRAME_STATUS.record_bytes
    most = aerial.front_end.max_features
    expected = [(most * feature, feature), (status, status), (most * MATCH.record_bytes, MATCH.record_bytes)]
    homography = [(HOMOGRAPHY.record_bytes, HOMOGRAPHY.record_bytes)] if estimator else []
    found = [(most * dtype.itemsize, dtype.itemsize) for dtype, most in packets]
    assert found == [*expected, (status, status), *homography]
