"""What is said of a mosaic that was written, and which words do not go together."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from skymosaic.cli import live, mosaic
from skymosaic.cli.session import session
from tests.conftest import Run
from tests.system.command_line import only_error

ABOUT = ("warp", "size", "light", "cut off", "bands", "range", "map", "contradiction", "map note")
WARNED = ("size", "light", "contradiction")
EVERYWHERE = ["warning: odd", *(f"warning: m.tif: the {about}" for about in WARNED)]


def delivered(name: str, *, pair: bool, on_map: bool, note: str = "", tiles: bool = False) -> Any:
    flight = SimpleNamespace(names="abc", pair=SimpleNamespace(seconds={"warping and blending": 2.0}) if pair else None)
    layout = SimpleNamespace(members="ab", model="similarity", reason="as it is flat")
    layout.agreement = SimpleNamespace(description="most")
    place = SimpleNamespace(contradictions=("two places",))
    composition = SimpleNamespace(size=(30, 40), place=place, reduced="small", uneven="", placements="ab")
    return SimpleNamespace(
        path=Path(name), flight=flight, layout=layout, composition=composition, map_note=note, seconds=5.0,
        tiles=Path("tiles") if tiles else None, georeference=object() if on_map else None,
    )  # fmt: skip


@pytest.fixture
def _fake(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mosaic, "layout_errors", lambda *_: SimpleNamespace(description="0.3 px"))
    monkeypatch.setattr(mosaic, "doubts", lambda *_: ["odd"])
    monkeypatch.setattr(live, "describe_mosaic", lambda _: {about: f"the {about}" for about in ABOUT})
    monkeypatch.setattr(live, "explain_absence", lambda path, _: f"{path}: no place")
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
    mosaic._show_mosaic(delivered(name, **given), Path(name))
    printed = capsys.readouterr()
    assert printed.err.splitlines() == [line.replace("m.tif", name) for line in warned]
    flight = [] if given["pair"] else ["similarity; as it is flat", "overlaps: most", "linked pairs: 0.3 px"]
    tiles = ["tiles tiles/index.html"] if "tiles" in given else []
    lines = [f"{about}: the {about}" for about in ABOUT[:-1] if about not in WARNED]
    assert printed.out.splitlines() == [f"mosaic {name} (30x40), 2 photographs of 3", *flight, *tiles, *lines]
    assert session.seconds == ({"writing": 3.0} if given["pair"] else {"blending and writing": 5.0})


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
