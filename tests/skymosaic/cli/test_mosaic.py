"""What is said of a mosaic, of each live frame and of what is left out; which words do not go together."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from skymosaic.cli import live, mosaic, remarks
from skymosaic.cli.remarks import group_reasons, report_absent
from skymosaic.cli.session import session
from skymosaic.common.errors import RegistrationError
from skymosaic.flight.mapping.place import MapPlace
from skymosaic.flight.picture.output import Delivery
from skymosaic.mosaicking.live.growing_flight import Placement
from skymosaic.mosaicking.live.update import LiveUpdate
from tests.conftest import Run
from tests.skymosaic.flight.made import PLACE, delivered
from tests.system.command_line import only_error

ABOUT = ("warp", "size", "light", "cut off", "bands", "range", "map", "contradiction", "map note")
OF_FLIGHTS = [
    "affine; as good as a homography",
    "overlaps: 0 of 0 pairs that overlap by half agree; 0 cannot tell",
    "linked pairs: 0.3 px",
]
WARNED = ("size", "light", "contradiction")
EVERYWHERE = ["warning: odd", *(f"warning: m.tif: the {about}" for about in WARNED)]


def written(name: str, *, pair: bool, on_map: bool, note: str = "", tiles: bool = False) -> Delivery:
    of_two = SimpleNamespace(seconds={"warping and blending": 1.0}) if pair else None
    facts = {"map_note": note, "tiles": Path("tiles") if tiles else None}
    return delivered(path=Path(name), pair=of_two, place=PLACE if on_map else MapPlace(), **facts)


@pytest.fixture
def _fake(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mosaic, "layout_errors", lambda *_: SimpleNamespace(description="0.3 px"))
    monkeypatch.setattr(mosaic, "doubts", lambda *_: ["odd"])
    monkeypatch.setattr(remarks, "describe_mosaic", lambda _: {about: f"the {about}" for about in ABOUT})
    monkeypatch.setattr(remarks, "explain_absence", lambda path, _: f"{path}: no place")
    session.begin("", started_s=0, quiet=False, verbose=False, as_json=False)


@pytest.mark.usefixtures("_fake")
@pytest.mark.parametrize(
    ("name", "given", "warned"),
    [
        ("m.tif", {"pair": False, "on_map": True}, EVERYWHERE),
        ("m.tif", {"pair": False, "on_map": True, "note": "off", "tiles": True}, [*EVERYWHERE, "note: off"]),
        ("m.tif", {"pair": True, "on_map": True, "note": "off"}, [*EVERYWHERE[1:], "note: off"]),
        ("m.tif", {"pair": True, "on_map": False, "note": "off"}, [*EVERYWHERE[1:], "warning: m.tif: no place"]),
        ("m.png", {"pair": True, "on_map": False, "note": "off"}, EVERYWHERE[1:]),
        ("m.png", {"pair": False, "on_map": False, "note": "off"}, [*EVERYWHERE, "note: off"]),
        ("m.png", {"pair": False, "on_map": False}, EVERYWHERE),
    ],
)
def test_a_mosaic_is_described(
    capsys: pytest.CaptureFixture[str], name: str, given: dict[str, Any], warned: list[str]
) -> None:
    mosaic._show_mosaic(written(name, **given), Path(name))
    printed = capsys.readouterr()
    assert printed.err.splitlines() == [line.replace("m.tif", name) for line in warned]
    flown = [] if given["pair"] else OF_FLIGHTS
    tiles = ["tiles tiles/index.html"] if "tiles" in given else []
    lines = [f"{about}: the {about}" for about in ABOUT[:-1] if about not in WARNED]
    assert printed.out.splitlines() == [f"mosaic {name} (800x500), 3 photographs of 4", *flown, *tiles, *lines]
    assert session.seconds == ({"writing": pytest.approx(0.26)} if given["pair"] else {"blending and writing": 1.26})


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
    monkeypatch.setattr(remarks, "describe_mosaic", lambda _: {"size": "small", "map": "UTM"})
    monkeypatch.setattr(remarks, "explain_absence", lambda path, _: f"{path}: no place")
    grown: Any = SimpleNamespace(left_out_moving=left_out)
    pace: Any = SimpleNamespace(numbers={})
    live._show(written(name, pair=False, on_map=on_map), {3: "dark"}, grown, pace)
    printed = capsys.readouterr()
    assert printed.out == f"mosaic {name} (800x500): 3 frames, 1 left out\nmap: UTM\n"
    assert printed.err.splitlines() == [f"warning: {line}" for line in warned]
