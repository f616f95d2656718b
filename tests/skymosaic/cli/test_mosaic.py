"""What is said of a mosaic, of each live frame and of what is left out; which words do not go together."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from skymosaic.cli.remarks import group_reasons, report_absent
from skymosaic.common.errors import RegistrationError
from skymosaic.mosaicking.live.growing_flight import Placement
from skymosaic.mosaicking.live.update import LiveUpdate
from tests.conftest import Run
from tests.system.command_line import only_error


@pytest.mark.parametrize(
    ("words", "fault"),
    [
        ("--camera c.toml", "--save-camera: the lens is given by --camera, so it is not estimated; leave one out"),
        ("", "--save-camera: two photographs are too few to estimate the lens; leave it out"),
        ("--mask a.png", "--save-camera: two photographs are too few to estimate the lens; leave it out"),
    ],
)
def test_a_lens_is_estimated_where_it_can_be(run: Run, tmp_path: Path, words: str, fault: str) -> None:
    names = ("width_px", "height_px", "focal_x_px", "focal_y_px", "centre_x_px", "centre_y_px")
    (tmp_path / "c.toml").write_text("".join(f"{name} = 80\n" for name in names))
    for name in ("a.png", "b.png"):
        cv2.imwrite(str(tmp_path / name), np.full((80, 80), 255, np.uint8))
    status, _, errors = run("mosaic", "a.png", "b.png", "-o", "m.png", "--save-camera", "lens.toml", *words.split())
    assert (status, only_error(errors)) == (2, f"error: {fault}")


PLACEMENT = Placement(np.eye(3), (4, 7), 31, 0.567)


@pytest.mark.parametrize(
    ("placement", "reason", "parts", "joined", "line"),
    [
        (None, "too few features", 2, (), "left out: too few features"),
        (None, "", 1, (), "starts a separate mosaic"),
        (None, "", 2, (), "starts a separate mosaic; 2 separate parts"),
        (PLACEMENT, "", 1, (), "31 ties to 4, 7, median 0.57 px"),
        (PLACEMENT, "", 3, (2,), "31 ties to 4, 7, median 0.57 px; joins part 2; 3 separate parts"),
    ],
)
def test_each_frame_is_one_line(
    placement: Placement | None, reason: str, parts: int, joined: tuple[int, ...], line: str
) -> None:
    assert str(LiveUpdate(0, "a.jpg", 0.1, np.eye(3), placement, reason, parts, joined=joined)) == line


@pytest.mark.parametrize(("absent", "strict"), [({}, True), ({1: "x"}, False), ({1: "x", 2: "y"}, True)])
def test_only_strictness_makes_what_is_left_out_an_error(
    absent: dict[int, str], capsys: pytest.CaptureFixture[str], *, strict: bool
) -> None:
    if strict and absent:
        with pytest.raises(RegistrationError, match=r"^2 left out, and --strict allows none; nothing was written$"):
            report_absent(absent, strict=strict)
    else:
        report_absent(absent, strict=strict)
    assert capsys.readouterr().err.splitlines() == [f"warning: left out: {reason}" for reason in absent.values()]


def test_what_is_left_out_for_one_reason_is_one_line() -> None:
    far = [f"{name}.jpg: in another group of 5 photographs: no" for name in "abcde"]
    assert group_reasons([*far[:2], "x.jpg: dark", "none"]) == [
        "a.jpg, b.jpg: in another group of 5 photographs: no",
        "x.jpg: dark",
        "none",
    ]
    assert group_reasons(far) == ["a.jpg, b.jpg, c.jpg and 2 more: in another group of 5 photographs: no"]
    assert group_reasons([]) == []
