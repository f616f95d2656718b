"""A flight masks what moves with its camera, as the file in its report would."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from golden_model.arrays import Array, Pixels
from skymosaic.flight.checking.check import check_flight
from skymosaic.flight.linking.links import Link
from skymosaic.flight.pairing.own_mask import _explains, find_mask
from skymosaic.imagery.lens import load_lens
from skymosaic.mosaicking.api import open_run
from skymosaic.mosaicking.options import MosaicOptions
from skymosaic.reports.flight import write_report
from tests.skymosaic.geometry.covered import at_night, ground, seen


def with_frame(image: Pixels) -> Pixels:
    """A dark border with text, as scanned film has."""
    # Little contrast on the ground: the border has the strongest matches.
    shown = np.asarray(90 + 0.25 * cv2.GaussianBlur(image, (0, 0), 1.5), dtype=np.uint8)
    shown[:, :90] = 20
    for line in range(19):
        cv2.putText(shown, f"F{line}7.{line}", (8, 20 + 25 * line), cv2.FONT_HERSHEY_SIMPLEX, 0.7, (255, 255, 255), 2)
    return shown


@pytest.fixture(scope="module")
def flight() -> list[Pixels]:
    place = ground(8)
    corners = ((50, 40), (230, 60), (240, 240), (60, 260))
    return [with_frame(seen(place, *corner, degrees=2 * turn)) for turn, corner in enumerate(corners)]


def test_a_border_is_masked_as_the_file_of_the_report_masks_it(flight: list[Pixels], tmp_path: Path) -> None:
    report = tmp_path / "report"
    with open_run(flight, MosaicOptions()) as run:
        (delivery,) = run.write(tmp_path / "own.png")
        write_report(report, run.flight, [delivery])
        assert any("is masked; a report has the mask" in problem for problem in check_flight(run.flight).problems)
    mask = cv2.imread(str(report / "mask.png"), cv2.IMREAD_GRAYSCALE)
    assert mask is not None
    assert (mask[:, : 80 * mask.shape[1] // 640] == 0).mean() > 0.9
    assert (mask[:, 130 * mask.shape[1] // 640 :] == 255).mean() > 0.95
    with open_run(flight, MosaicOptions(lens=load_lens(None, report / "mask.png"))) as run:
        run.write(tmp_path / "given.png")
        assert run.flight.found_mask is None
    assert (tmp_path / "own.png").read_bytes() == (tmp_path / "given.png").read_bytes()
    picture = cv2.imread(str(tmp_path / "own.png"))
    assert picture is not None
    # The text is white, and the ground is not.
    assert picture.max() < 220


def test_no_mask_without_a_flight_that_moves_with_its_camera(flight: list[Pixels]) -> None:
    with open_run(flight[:3], MosaicOptions()) as run:
        views = run.flight.views
    points = np.stack(np.meshgrid(np.arange(0, 640, 12.0), np.arange(0, 480, 12.0)), axis=-1).reshape(-1, 2)
    here = points[points[:, 0] < 100]
    thumbnails = [view.thumbnail for view in views]

    def links(moving: Array) -> list[Link]:
        nothing = np.zeros((0, 2))
        ends = ((0, 1), (0, 2), (1, 2))
        return [Link(*pair, nothing, nothing, 0, 0, left_moving=moving, right_moving=moving) for pair in ends]

    assert find_mask(views, links(here), thumbnails) is not None
    # Not of half of the flight, of all the picture, or of several sizes.
    assert find_mask(views, links(here)[:1], thumbnails) is None
    assert find_mask(views, links(points), thumbnails) is None
    assert find_mask(views, links(here), [thumbnails[0][:-8], *thumbnails[1:]]) is None
    # Nor where nothing is drawn: the matches are on a sensor's pattern.
    dark = [at_night(seen(ground(5), *corner), 0)[::2, ::2] for corner in ((50, 40), (230, 60), (240, 240))]
    assert find_mask(views, links(here), dark) is None


def test_what_a_layout_explains_does_not_move_with_the_camera() -> None:
    points = np.random.default_rng(0).uniform(0, 300, (20, 2))
    transforms = {view: np.array([[1.0, 0, 50 * view], [0, 1, 0], [0, 0, 1]]) for view in range(3)}
    for off_px, right, explained in ((11, 2, True), (13, 2, False), (0, 3, False)):
        moved = points - [100 + off_px, 0]
        for ends in ((0, right), (right, 0)):
            pair = (points, moved) if ends[0] == 0 else (moved, points)
            link = Link(*ends, points[:0], points[:0], 0, 0, left_moving=pair[0], right_moving=pair[1])
            assert _explains(transforms, link) is explained
