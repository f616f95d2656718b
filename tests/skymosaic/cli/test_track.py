"""What is typed for tracking, and what is said of its result."""

from pathlib import Path

import pytest

from skymosaic.cli.track import _show_summary, _template_and_video
from skymosaic.common.errors import InputError
from skymosaic.tracking.output import TrackedCorners
from skymosaic.tracking.template import Roi

A, B = Path("a.png"), Path("b.mp4")


def test_the_object_is_a_picture_or_a_rectangle() -> None:
    assert _template_and_video([A, B], None) == (A, B)
    assert _template_and_video([B], "1,2,30,40") == (Roi(1, 2, 30, 40), B)
    for inputs, roi, fault in (
        ([B], None, "track takes TEMPLATE and VIDEO, or VIDEO and --roi"),
        ([A, B, B], None, "track takes TEMPLATE and VIDEO, or VIDEO and --roi"),
        ([A, B], "1,2,30,40", "with --roi, track takes the VIDEO alone"),
        ([B], "1,2,30", "--roi is '1,2,30'; give four whole numbers, x,y,width,height"),
        ([B], "1,2,30,4.5", "--roi is '1,2,30,4.5'; give four whole numbers, x,y,width,height"),
    ):
        with pytest.raises(InputError, match=f"^{fault}$"):
            _template_and_video(inputs, roi)


def test_the_summary_counts_and_says_where_the_object_was_lost(capsys: pytest.CaptureFixture[str]) -> None:
    corners = ((0.0, 0.0),) * 4
    reasons = ["", "hidden", "blurred", "", "", "left", ""]
    rows = [TrackedCorners(at, 0.1, None if why else corners, "", 0, why) for at, why in enumerate(reasons)]
    _show_summary(rows, 0.0126)
    assert capsys.readouterr().out.splitlines() == [
        "found in 4 of 7 frames, 13 ms per frame",
        "frames 1 to 2: blurred",
        "frames 5 to 5: left",
    ]
