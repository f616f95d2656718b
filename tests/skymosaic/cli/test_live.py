"""What a live mosaic says of each frame, and of those that it leaves out."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from skymosaic.cli import live
from skymosaic.cli.live import _find_unused, group_reasons, report_absent
from skymosaic.common.errors import RegistrationError
from skymosaic.mosaicking.live.growing_flight import Placement
from skymosaic.mosaicking.live.update import LiveUpdate
from tests.skymosaic.cli.test_mosaic import delivered

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


def test_a_name_that_nothing_has_is_found(tmp_path: Path) -> None:
    assert _find_unused(tmp_path / "m.png") == tmp_path / "m.png"
    for name in ("m.png", "m_2.png"):
        (tmp_path / name).touch()
    assert _find_unused(tmp_path / "m.png") == tmp_path / "m_3.png"


@pytest.mark.parametrize(
    ("name", "on_map", "left_out", "warned"),
    [
        ("m.tif", True, True, ["m.tif: small"]),
        ("m.tif", False, True, ["m.tif: small", "m.tif: no place"]),
        ("m.png", False, True, ["m.png: small"]),
        ("m.png", False, False, ["still moves", "m.png: small"]),
    ],
)
def test_a_live_mosaic_is_described(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    name: str,
    warned: list[str],
    *,
    on_map: bool,
    left_out: bool,
) -> None:
    monkeypatch.setattr(live, "describe_moving", lambda _: "still moves")
    monkeypatch.setattr(live, "describe_mosaic", lambda _: {"size": "small", "map": "UTM"})
    monkeypatch.setattr(live, "explain_absence", lambda path, _: f"{path}: no place")
    grown: Any = SimpleNamespace(left_out_moving=left_out)
    pace: Any = SimpleNamespace(numbers={})
    live._show(delivered(name, pair=False, on_map=on_map), {3: "dark"}, grown, pace)
    printed = capsys.readouterr()
    assert printed.out == f"mosaic {name} (30x40): 2 frames, 1 left out\nmap: UTM\n"
    assert printed.err.splitlines() == [f"warning: {line}" for line in warned]
