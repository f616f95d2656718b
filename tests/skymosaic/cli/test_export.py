"""What of a build the command line changes, and what it leaves as the board has it."""

import re
import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from golden_model.config import PRESETS, EstimatorConfig
from golden_model.fuzzy.rules import SHIPPED
from golden_model.version import VERSION
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


def test_options_replace_what_they_name_and_nothing_else() -> None:
    assert BuildOptions(preset="thesis").build(ULX3S).config == PRESETS["thesis"]
    assert BuildOptions(config=PRESETS["aerial"]).build(ULX3S).config == PRESETS["aerial"]
    matcher = replace(ULX3S.config.matcher, rule_base="none")
    assert BuildOptions(rules="none").build(ULX3S).config == replace(ULX3S.config, matcher=matcher)
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
        (("board", "zybo-z720"), "did you mean zybo_z7_20?"),
        (("board", "pynq_z2", "--build"), "--build makes the bitstream of the ulx3s"),
        (("block", "prewitt"), "unknown block 'prewitt'; valid: gray, "),
        (("block", "half", "--set", "lanes=8"), "half does not depend on 'lanes'; valid: width_px"),
        (("block", "gray", "--set", "width_px=640"), "gray does not depend on 'width_px'; valid: pixels_per_clock"),
        (("block", "half", "--set", "width_px=63"), "width_px is 63; it must be a whole number from 64 to 4096"),
        (("block", "half", "--set", "width_px=wide"), "width_px is 'wide'; it must be a whole number"),
        (("block", "half", "--set", "width_px"), "--set width_px: give NAME=VALUE, as in --set width_px=640"),
        (("block", "matcher", "--set", "lanes=3"), "lanes is 3; valid: 2, 4, 8, "),
        (("block", "matcher", "--set", "rule_base=ilbp"), "rule base 'ilbp' needs the gray window"),
        (("block", "harris", "--set", "smoothed_gradients=false"), "smoothed_gradients is 5; valid: 3"),
        (("block", "half", "--model", "mine:model"), "half has a golden model; --model is for a MODULE:CLASS"),
        (("block", "hdl.pixel.gray:Gray", "--set", "lanes=8"), "hdl.pixel.gray:Gray: takes no settings"),
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


def test_every_export_says_what_it_is_and_has_its_name(run: Run, tmp_path: Path) -> None:
    fll = str(SHIPPED / "aerial-turn.fll")
    digests = set()
    for kind, *words in (("block", "gray"), ("block", "half"), ("fuzzy", fll), ("fuzzy", fll, "--entries", "32")):
        status, _, errors = run("export", kind, *words, "--name", "mine", "-o", "made", "--overwrite")
        assert status == 0, errors
        text = (tmp_path / "made" / "mine.v").read_text()
        licence, command, digest, timescale = text.splitlines()[:4]
        assert (licence, timescale) == ("// SPDX-License-Identifier: Apache-2.0", "`timescale 1ns / 1ps")
        assert command.startswith(f"// Made by skymosaic {VERSION}: ")
        assert command.endswith(f"export {shlex.join([kind, *words])} --name mine -o made --overwrite")
        digests.add(digest)
        assert "\nmodule mine(" in text
        # Modules inside have its name, too, so that two exports can be in one FPGA.
        assert all(name.lstrip("\\").startswith("mine") for name in re.findall(r"^module (\S+)", text, re.MULTILINE))
        assert "name: skymosaic:vision:mine:" in (tmp_path / "made" / "mine.core").read_text()
        for name in ("LICENSE", "NOTICE"):
            assert (tmp_path / "made" / name).read_text() == (Path(__file__).parents[3] / name).read_text()
    assert len(digests) == 4


def test_a_line_break_on_the_command_line_ends_no_comment(run: Run, tmp_path: Path) -> None:
    assert run("export", "block", "gray", "-o", "a\nb")[0] == 0
    assert "-o 'a\\nb'\n// Digest" in (tmp_path / "a\nb" / "gray.v").read_text()


def test_a_class_of_ones_own_has_a_bench_with_a_model_alone(run: Run, tmp_path: Path) -> None:
    status, _, says = run("export", "block", "hdl.pixel.gray:Gray", "-o", "made")
    assert status == 0
    assert "without a golden model there is no test bench; give one by --model MODULE:FUNCTION" in says
    assert {path.name for path in (tmp_path / "made").iterdir()} == {
        *("LICENSE", "NOTICE", "README.md", "gray.core", "gray.v")
    }
    assert "There is no test bench" in (tmp_path / "made" / "README.md").read_text()


def test_two_exports_to_one_folder_are_not_mixed(tmp_path: Path) -> None:
    output = tmp_path / "made"

    def write_as_another_does(folder: Path) -> None:
        for place, name in ((folder, "ours.v"), (output, "theirs.v")):
            place.mkdir()
            (place / name).touch()

    with pytest.raises(InputError, match=r"made: is a folder with files in it"):
        _export(output, write_as_another_does, overwrite=False)
    assert [path.name for path in output.iterdir()] == ["theirs.v"]
