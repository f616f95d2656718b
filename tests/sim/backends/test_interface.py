"""Backends by name."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from golden_model.records import FRAME_STATUS, HOMOGRAPHY, MATCH
from sim.backends import interface
from sim.backends.errors import BackendError
from sim.backends.interface import FrameResult


@pytest.mark.parametrize("name", ["fpga", "fpga:here", "golden:here", "rtl:7"])
def test_unknown_backend_names_the_valid_ones(name: str) -> None:
    with pytest.raises(BackendError, match=f"unknown backend '{name}'; valid: golden, rtl, board"):
        interface.load_backend(name)


@pytest.mark.parametrize(
    ("good", "causes", "accepted"), [(1, 0, True), (1, 2, False), (0, 0, None), (1, None, None), (0, None, None)]
)
def test_the_homography_of_a_good_frame_is_accepted_without_causes(
    good: int, causes: int | None, accepted: bool | None
) -> None:
    status, homography = np.zeros(1, FRAME_STATUS.dtype)[0], np.zeros(1, HOMOGRAPHY.dtype)[0]
    matches = np.zeros(5, MATCH.dtype)
    status["good"], homography["causes"], matches["verdict"] = good, causes or 0, (1, 0, 1, 1, 0)
    result = FrameResult.count_matches(matches[:0], matches, status)
    result = replace(result, homography=None if causes is None else homography)
    assert result.accepted is accepted
    assert (result.match_status["matches"], result.match_status["kept"], result.status["kept"]) == (5, 3, 0)


@pytest.mark.parametrize("name", ["golden", "board:somewhere"])
def test_only_a_simulation_has_waves(tmp_path: Path, name: str) -> None:
    with pytest.raises(BackendError, match=f"the backend {name.partition(':')[0]} cannot write waves; use rtl"):
        interface.load_backend(name, waves=tmp_path / "waves.vcd")
    assert not (tmp_path / "waves.vcd").exists()
