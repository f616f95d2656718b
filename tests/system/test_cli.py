import json
import shutil
import sys
from pathlib import Path

import cv2
import pytest

from sim.scene import Flight, make_pair
from skymosaic.cli import main
from tests.conftest import Run
from tests.system.command_line import only_error, skymosaic

SEED = 5


def refusal(run: Run, *words: object) -> str:
    """The line of a command that ends with status 2."""
    status, _, errors = run(*map(str, words))
    assert status == 2, errors
    return only_error(errors)


@pytest.fixture(scope="module")
def flight() -> Flight:
    return make_pair(seed=SEED)


@pytest.fixture(scope="module")
def photographs(tmp_path_factory: pytest.TempPathFactory, flight: Flight) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("photographs")
    paths = folder / "left.png", folder / "right.png"
    for path, image in zip(paths, flight.images, strict=True):
        cv2.imwrite(str(path), image)
    return paths


def test_mosaic_writes_picture_and_report_with_the_configuration_of_a_file(
    photographs: tuple[Path, Path], tmp_path: Path
) -> None:
    (tmp_path / "c.toml").write_text('[front_end]\nlevels = 1\ndescriptor = "ilbp-256"\n')
    result = skymosaic("mosaic", *photographs, "-o", "m.png", "--config", "c.toml", "--report", "r", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    picture = cv2.imread(str(tmp_path / "m.png"))
    assert picture.shape[1] > 700
    names = {path.name for path in (tmp_path / "r").iterdir()}
    assert names == {"corners_left.png", "corners_right.png", "matches.png", "mosaic.jpg", "report.json", "index.html"}
    report = json.loads((tmp_path / "r" / "report.json").read_text())
    assert report["accepted"]
    configured = report["configuration"]["front_end"]
    assert (configured["levels"], configured["descriptor"]) == (1, "ilbp-256")


@pytest.mark.parametrize(
    ("backend", "says"),
    [("nonsense", "--backend is 'nonsense'; valid: golden, rtl"), ("board", "give it with --address")],
)
def test_the_demo_refuses_a_backend_before_it_begins(run: Run, tmp_path: Path, backend: str, says: str) -> None:
    assert says in refusal(run, "demo", "-o", "out", "--backend", backend)
    assert list(tmp_path.iterdir()) == []


def test_what_is_named_wrongly_is_one_line_that_fits(run: Run, tmp_path: Path) -> None:
    (tmp_path / "loop").symlink_to("loop")
    for words in (["mosaic", "-o", "m.png"], ["check"]):
        assert refusal(run, *words, "/nonexistent") == "error: /nonexistent: no such file; check the path"
        assert "loop: cannot be read (Too many levels of symbolic links)" in refusal(run, *words, "loop")
    assert "loop: cannot be read (Too many levels of symbolic links)" in refusal(run, "live", "loop", "-o", "m.png")
    assert refusal(run, "mosaic", "-o", "m.png", "").startswith("error: an argument is empty; ")
    assert "loop: is no folder" in refusal(run, "mosaic", "loop", "loop", "-o", "m.png", "--report", "loop")


def test_a_folder_of_one_photograph_is_named(run: Run, photographs: tuple[Path, Path], tmp_path: Path) -> None:
    (tmp_path / "one").mkdir()
    shutil.copy(photographs[0], tmp_path / "one")
    for words in (("mosaic", "one", "-o", "m.png"), ("check", "one")):
        assert refusal(run, *words).startswith("error: one: only one photograph; ")


def test_waves_and_low_frames_are_refused_before_the_run(run: Run, photographs: tuple[Path, Path]) -> None:
    assert "its folder does not exist" in refusal(run, "compare", *photographs, "--waves", "missing/w.vcd")
    assert "end the name in one of .vcd" in refusal(run, "compare", *photographs, "--waves", "w.png")
    low = refusal(run, "compare", *photographs, "--working-width", "64", "--backend", "golden")
    assert "left.png: 640x480 is reduced to 64x48" in low


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--backend", "abacus"), "golden"),
        (("--blending", "stirred"), "--blending is 'stirred'; valid: average, distance, multiband"),
        (("--rules", "golden"), "--rules is 'golden'; valid: aerial, ilbp, none, or an .fll or .fis file"),
        (("-o", "nowhere/m.png"), "folder does not exist"),
        (("--scale", "0"), "--scale is 0.0; it must be more than 0"),
        (("--detector", "sift", "--backend", "rtl"), "leave out --backend"),
        (("--config", "absent.toml"), "absent.toml"),
        (("--config", "unknown.toml"), "thresold"),
    ],
)
def test_bad_options_are_one_line(
    run: Run, photographs: tuple[Path, Path], tmp_path: Path, options: tuple[str, ...], says: str
) -> None:
    (tmp_path / "unknown.toml").write_text("[front_end]\nthresold = 4\n")
    output = () if "-o" in options else ("-o", "m.png")
    assert says in refusal(run, "mosaic", *photographs, *output, *options)
    assert not (tmp_path / "m.png").exists()


def test_an_opencv_without_contrib_is_an_error_that_names_the_fix(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delattr(cv2, "xfeatures2d")
    monkeypatch.setattr(sys, "argv", ["skymosaic", "register", "left.png", "right.png"])
    with pytest.raises(SystemExit) as stopped:
        main()
    assert stopped.value.code == 2
    assert "opencv-contrib-python-headless" in capsys.readouterr().err
