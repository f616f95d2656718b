from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import rasterio

from golden_model.arrays import Pixels
from golden_model.config import preset_config
from sim.scene.flight import Flight
from skymosaic.common.errors import AppearedError, InputError
from skymosaic.geometry.homography import apply, estimate_similarity
from skymosaic.imagery.exif import Metadata, Position
from skymosaic.imagery.images import Photograph, check_output
from skymosaic.imagery.live_frames import LiveFrame
from skymosaic.maps.georeference import project_to_utm
from skymosaic.mosaicking.live.mosaic import LiveMosaic
from skymosaic.mosaicking.live.run import grow
from skymosaic.mosaicking.live.update import LiveUpdate
from skymosaic.mosaicking.options import LiveOptions
from tests.skymosaic.conftest import IMAGES, SIZE
from tests.skymosaic.mosaicking.live.conftest import pair_errors_px

CONFIG = preset_config("aerial")


def test_every_frame_is_registered_on_arrival_and_adjusted_in_the_end(flight: Flight, frames: list[Pixels]) -> None:
    """Without that, errors add up from frame to frame to more than a pixel."""
    live = LiveMosaic(config=CONFIG)
    updates = [live.add(frame) for frame in frames]
    assert [update.number for update in updates] == list(range(IMAGES))
    assert updates[0].placement is None
    assert all(update.placement for update in updates[1:])
    assert any(len(update.placement.neighbours) > 1 for update in updates[1:]), "no leg holds another"
    assert live.left_out == {}
    errors = pair_errors_px(live.transforms, flight)
    assert len(errors) > IMAGES
    assert errors.mean() < 0.7
    assert errors.max() < 2.0
    assert live.preview.any(axis=2).mean() > 0.5
    before = dict(live.transforms)
    live.finish()
    # The last layout was that of eight frames.
    assert np.abs(live.transforms[IMAGES - 2] - before[IMAGES - 2]).max() > 1e-6
    grid = np.stack(np.meshgrid(np.linspace(0, SIZE[0] - 1, 4), np.linspace(0, SIZE[1] - 1, 4)), -1).reshape(-1, 2)
    found = np.concatenate([apply(live.transforms[index], grid) for index in range(IMAGES)])
    true = np.concatenate(
        [apply(np.asarray(np.linalg.inv(flight.homographies[index]), np.float64), grid) for index in range(IMAGES)]
    )
    aligned = apply(estimate_similarity(found, true), found)
    assert np.linalg.norm(aligned - true, axis=1).mean() < 0.3


def test_the_homographies_of_the_chip_alone_lay_the_frames_out(
    flight: Flight, frames: list[Pixels], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each frame follows from the one before it; nothing else of the flight is matched."""
    monkeypatch.setattr("skymosaic.mosaicking.live.mosaic.link_by_features", None)
    live = LiveMosaic(config=CONFIG, estimator="fabric")
    updates = [live.add(frame) for frame in frames[:5]]
    assert [update.placement.neighbours for update in updates[1:] if update.placement] == [(0,), (1,), (2,), (3,)]
    errors = pair_errors_px(live.transforms, flight)
    assert len(errors) > 5
    assert errors.mean() < 0.8
    assert errors.max() < 2.5
    with pytest.raises(InputError, match="prosac, fabric"):
        LiveMosaic(config=CONFIG, estimator="magsac")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("order", "parts"),
    [
        ([0, 3, 4, 1, 2], [1, 2, 2, 1, 1]),  # into the later part, which is the larger
        ([3, 4, 0, 1, 2], [1, 1, 2, 1, 1]),  # into the earlier part
        ([0, 8, 7], [1, 2, 1]),  # both of one frame
    ],
)
def test_parts_join_once_a_frame_overlaps_both(
    flight: Flight, frames: list[Pixels], order: list[int], parts: list[int], tmp_path: Path
) -> None:
    live = LiveMosaic(config=CONFIG)
    updates = [live.add(frames[index]) for index in order]
    assert [update.parts for update in updates] == parts
    assert len({update.part for update in updates[:2]}) == parts[1]
    (joining,) = [update for update in updates if update.joined]
    # Names are of the parts that there were.
    assert {joining.part, *joining.joined} == {update.part for update in updates[: joining.number]}
    told = joining.summary()
    assert (told["part"], told["joined"]) == (joining.part, list(joining.joined))
    assert all(len(repr(update)) < 150 and repr(update).count("\n") == 0 for update in updates)
    placed = {order[number]: transform for number, transform in live.transforms.items()}
    assert sorted(placed) == sorted(order)
    assert pair_errors_px(placed, flight).max() < 1.5
    # The ties of both parts are there: the layout of the whole rests on them.
    assert len(live.save(tmp_path / "m.png").composition.placements) == len(order)
    live.finish()
    placed = {order[number]: transform for number, transform in live.transforms.items()}
    assert pair_errors_px(placed, flight).max() < 1.0


def test_frames_of_another_part_are_said_to_be_there(frames: list[Pixels]) -> None:
    live = LiveMosaic(config=CONFIG)
    # Nothing links mirrored ground.
    for frame in (*frames[:3], *(np.ascontiguousarray(frame[:, ::-1]) for frame in frames[:2])):
        live.add(frame)
    assert set(live.transforms) == {0, 1, 2}
    assert all("in another part of 2 frames, which nothing joins" in live.left_out[number] for number in (3, 4))


def elsewhere() -> Pixels:
    """A frame that overlaps no other."""
    grain = np.random.default_rng(1).integers(0, 256, (360, 480, 3), dtype=np.uint8)
    return np.asarray(cv2.GaussianBlur(grain, (0, 0), 2), np.uint8)


def test_frames_that_come_close_are_composed_by_some_of_them(frames: list[Pixels], tmp_path: Path) -> None:
    live = LiveMosaic(config=CONFIG)
    for step in range(12):
        assert not live.add(frames[0][8 * step :][:240]).reason
    written = live.save(tmp_path / "m.png")
    assert len(live.transforms) == 12
    assert 2 <= len(written.flight.views) <= 4
    assert written.flight.left_out == {}
    assert written.composition.size[1] == pytest.approx(240 + 8 * 11, abs=3)


@pytest.mark.parametrize("stamp", [0.9, float("nan"), float("inf")])
def test_a_stamp_that_runs_backwards_is_refused(frames: list[Pixels], stamp: float) -> None:
    live = LiveMosaic(config=CONFIG)
    assert live.add(frames[0], stamp=1.0).summary()["time"] == 1.0
    with pytest.raises(InputError, match=f"`stamp` {stamp}: a finite number, at least that of the frame before, 1"):
        live.add(frames[1], stamp=stamp)
    assert live.add(frames[1]).number == 1


def test_frames_without_overlap_and_flat_frames_are_left_out(frames: list[Pixels]) -> None:
    live = LiveMosaic(config=CONFIG)
    for frame in (*frames[:2], elsewhere(), np.full((360, 480, 3), 90, np.uint8)):
        live.add(frame)
    assert set(live.left_out) == {2, 3}
    assert "does not overlap the mosaic" in live.left_out[2]
    assert "too few features" in live.left_out[3]


def test_what_happens_to_files_meanwhile_is_said_by_name(frames: list[Pixels], tmp_path: Path) -> None:
    live = LiveMosaic(config=CONFIG)
    for number, frame in enumerate(frames[:4]):
        cv2.imwrite(str(tmp_path / f"{number}.png"), frame)
        live.add(tmp_path / f"{number}.png")
    live.add(tmp_path / "missing.png")
    (tmp_path / "link.png").symlink_to("2.png")
    for name in ("1.png", "link.png", "missing.png"):
        with pytest.raises(InputError, match=f"{name}: is .*one of the inputs"):
            live.save(tmp_path / name, overwrite=True)
    (tmp_path / "0.png").unlink()
    cv2.imwrite(str(tmp_path / "3.png"), frames[0])
    written = live.save(tmp_path / "m.png")
    left_out = written.flight.absent_from(written.layout)
    assert sorted(left_out) == [0, 3, 4]
    assert "0.png" in left_out[0]
    assert "3.png: was replaced after it had been read" in left_out[3]


def test_a_full_disk_ends_the_growth_and_not_the_mosaic(
    frames: list[Pixels], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    live, told = LiveMosaic(config=CONFIG), list[str]()
    size = len(cv2.imencode(".png", frames[0], [cv2.IMWRITE_PNG_COMPRESSION, 1])[1])
    monkeypatch.setattr("skymosaic.mosaicking.live.kept_frames.MAX_BYTES", int(3.5 * size))
    coming = (LiveFrame(Photograph("", frame)) for frame in frames)
    # Nor does a preview that cannot be written.
    grow(live, coming, tmp_path / "none" / "preview.jpg", told.append)
    assert sorted(live.transforms) == [0, 1, 2]
    assert any(line.startswith("stopped: frames take more than") for line in told)
    assert any(line.startswith("note: no preview: ") for line in told)
    assert len(live.save(tmp_path / "m.png").composition.placements) == 3


def test_a_preview_takes_no_name_that_another_run_has_taken_meanwhile(frames: list[Pixels], tmp_path: Path) -> None:
    check_output(preview := tmp_path / "m.preview.jpg")
    preview.write_bytes(b"another run's")
    with pytest.raises(AppearedError, match="choose another name"):
        grow(LiveMosaic(config=CONFIG), [LiveFrame(Photograph("", frames[0]))], preview, lambda _line: None)
    assert preview.read_bytes() == b"another run's"


def test_what_a_callback_raises_costs_no_frame(frames: list[Pixels], tmp_path: Path) -> None:
    seen: list[str] = []

    def break_at_the_third(update: LiveUpdate) -> None:
        seen.append(update.name)
        assert update.number != 2, "broken"

    with LiveMosaic(config=CONFIG, on_frame=break_at_the_third) as live:
        live.add(frames[0])
        live.add(frames[1])
        with pytest.raises(AssertionError, match="broken"):
            live.add(frames[2])
    assert seen == ["frame 0", "frame 1", "frame 2"]
    assert sorted(live.transforms) == [0, 1, 2]
    live.save(tmp_path / "m.png")


def test_a_frame_that_is_damaged_or_no_picture_has_its_reason(frames: list[Pixels], tmp_path: Path) -> None:
    live = LiveMosaic(config=CONFIG)
    update = live.add(tmp_path / "none.jpg")
    assert "none.jpg" in update.reason
    assert update.transform is None
    assert live.add(frames[0], name="first").number == 1
    (tmp_path / "m.png").touch()
    with pytest.raises(InputError, match="exists"):
        live.save(tmp_path / "m.png")
    data = bytearray(cv2.imencode(".jpg", frames[2])[1].tobytes())
    data[len(data) // 2 : len(data) // 2 + 400] = bytes(400)
    damaged = tmp_path / "damaged.jpg"
    damaged.write_bytes(data)
    for options, composed in ((LiveOptions(), 2), (LiveOptions(damaged="keep"), 3)):
        live = LiveMosaic(options)
        updates = [live.add(frame) for frame in (frames[0], frames[1], damaged)]
        assert ("damaged" in updates[2].reason) == (composed == 2)
        assert len(live.save(tmp_path / f"{composed}.png").composition.placements) == composed


def test_frames_with_gps_lie_on_the_map(flight: Flight, frames: list[Pixels], tmp_path: Path) -> None:
    metres, focal = 0.15, flight.camera.focal_px / (np.hypot(*SIZE) / 2)
    live = LiveMosaic(config=CONFIG)
    for frame, pose in zip(frames[:4], flight.poses, strict=False):
        position = Position(46 - metres * pose.y_px / 111_147, 7 + metres * pose.x_px / 77_329)
        live.add(frame, taken=Metadata(position=position, focal_half_diagonals=focal))
    live.save(tmp_path / "m.tif")
    assert live.place.georeference is not None
    with rasterio.open(tmp_path / "m.tif") as file:
        assert file.crs.to_epsg() == 32632
        # What a nearly upright camera has in the middle is below it.
        below = apply(live.place.georeference.to_map @ live.transforms[3], (np.array(SIZE) - 1) / 2)
        _, (truth,) = project_to_utm([position])
        np.testing.assert_allclose(below, truth, atol=5)
        assert file.bounds.left < truth[0] < file.bounds.right
        assert file.bounds.bottom < truth[1] < file.bounds.top
        assert np.hypot(file.transform.a, file.transform.d) == pytest.approx(metres, rel=0.05)
        assert 0.5 < (file.read(4) > 0).mean() < 1


def test_a_folder_is_added_whole_and_what_is_no_frame_is_an_error(frames: list[Pixels], tmp_path: Path) -> None:
    for number, frame in enumerate(frames[:2]):
        cv2.imwrite(str(tmp_path / f"{number}.png"), frame)
    live = LiveMosaic(config=CONFIG)
    assert [update.name for update in live.extend(str(tmp_path))] == [str(tmp_path / f"{n}.png") for n in (0, 1)]
    wrong: list[tuple[Any, str]] = [
        (None, "frame: NoneType is no photograph"),
        (tmp_path, "a folder is no frame; extend.. adds its pictures"),
        (str(tmp_path / "*.png"), "matches 2 files"),
        (frames[0].astype(np.float32), "frame: an array of float32, shape .*; give uint8 of shape"),
    ]
    for given, message in wrong:
        with pytest.raises(InputError, match=message):
            live.add(given)
    # A file that is missing or damaged is a reason, as it may be while a flight is recorded.
    assert live.add(tmp_path / "2.png").reason.endswith("no such file; check the path")
    assert sorted(live.transforms) == [0, 1]
    assert list(live.left_out) == [2]
