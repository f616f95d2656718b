"""What of a build the command line changes, and what it leaves as the board has it."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from golden_model.config import PRESETS, EstimatorConfig
from hdl.build import BUILDS, VIDEO_BITS, Build
from skymosaic.cli.export import BuildOptions, CameraOptions, _export
from skymosaic.common.errors import InputError
from skymosaic.common.options import options_of
from tests.conftest import Run
from tests.system.command_line import only_error

ULX3S = BUILDS["ulx3s"]


@pytest.mark.parametrize("usual", BUILDS.values(), ids=BUILDS)
def test_without_options_the_usual_build_is_built(usual: Build) -> None:
    named: dict[str, Any] = {"preset": usual.config.preset}
    assert BuildOptions(**named).build(usual) == usual


def test_only_an_explicit_configuration_replaces_that_of_a_board() -> None:
    assert BuildOptions(preset="thesis").build(ULX3S).config == PRESETS["thesis"]
    assert BuildOptions(config=PRESETS["aerial"]).build(ULX3S).config == PRESETS["aerial"]
    matcher = replace(ULX3S.config.matcher, rule_base="none")
    assert BuildOptions(rules="none").build(ULX3S).config == replace(ULX3S.config, matcher=matcher)


def test_options_replace_what_they_name() -> None:
    camera = BUILDS["camera"]
    changed = BuildOptions(homography=True, lanes=4, max_width_px=640, max_height_px=480, video_bits=8).build(camera)
    config = replace(camera.config, estimator=EstimatorConfig())
    assert changed == replace(camera, config=config, lanes=4, max_width_px=640, max_height_px=480, video_bits=8)
    assert CameraOptions(homography=True).build(camera) == replace(camera, config=config)
    assert CameraOptions(homography=True, painter=True).build(camera) == replace(camera, config=config, painter=True)


def test_the_help_offers_only_widths_of_video_that_a_camera_has() -> None:
    (about,) = (each.help for each in options_of(CameraOptions) if each.name == "video_bits")
    assert set(map(int, re.findall(r"\d+", about))) == set(VIDEO_BITS["camera"])


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("board", "breadboard"), "unknown board 'breadboard'; valid: arty_a7_100, "),
        (("board", "pynq_z2", "--build"), "--build makes the bitstream of the ulx3s"),
        (("block", "prewitt"), "unknown block 'prewitt'; valid: gray, "),
        (("camera", "--video-bits", "32"), "--video-bits with shell 'camera' is 32; valid: 24, 8"),
        (("camera", "--max-width", "63"), "--max-width is 63; it must be a whole number from 64 to 4096"),
        (("camera", "--painter"), "--painter paints frames where their homographies say; add --homography"),
    ],
)
def test_what_cannot_be_built_is_refused_before_anything_is_written(
    run: Run, tmp_path: Path, words: tuple[str, ...], message: str
) -> None:
    status, _, errors = run("export", *words, "-o", "made")
    assert status == 2
    assert message in only_error(errors)
    assert "writing" not in errors
    assert not (tmp_path / "made").exists()


def test_two_exports_to_one_folder_are_not_mixed(tmp_path: Path) -> None:
    output = tmp_path / "made"

    def write_as_another_does(folder: Path) -> None:
        for place, name in ((folder, "ours.v"), (output, "theirs.v")):
            place.mkdir()
            (place / name).touch()

    with pytest.raises(InputError, match=r"made: is a folder with files in it"):
        _export(output, write_as_another_does, overwrite=False)
    assert [path.name for path in output.iterdir()] == ["theirs.v"]
