"""What users of other command lines expect of this one: docs/how-to/command_line.md promises it."""

import json
import re
import shutil
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from sim.scene import make_pair
from skymosaic.cli.demo import OWN_NAMES
from skymosaic.imagery.video import write_video
from tests.conftest import Run
from tests.system.command_line import only_error

DOCUMENT = Path(__file__).parents[2] / "docs" / "how-to" / "command_line.md"
COMMON = {"command", "program", "version", "written", "status", "error", "warnings", "outputs", "notes", "seconds"}
WRITES_JSON = {
    "register": ("left.png", "right.png"),
    "mosaic": ("left.png", "right.png", "-o", "m.png"),
    "check": ("left.png", "right.png"),
    "live": ("film.mkv", "-o", "m.png"),
    "demo": ("--backend", "golden", "-o", "shown"),
    "fuzzy": ("ransac",),
}


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with an overlapping pair, as pictures and as a film."""
    folder = tmp_path_factory.mktemp("pair")
    left, right = make_pair(seed=5, size=(320, 240)).images
    for name, image in (("left", left), ("right", right)):
        cv2.imwrite(str(folder / f"{name}.png"), image)
    film(folder / "film.mkv", left, right)
    return folder


@pytest.fixture(autouse=True)
def _photographs(pair: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The current folder is a copy of it."""
    shutil.copytree(pair, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def film(path: Path, *frames: np.ndarray) -> None:
    with write_video(path, Fraction(25)) as write:
        for frame in frames:
            write(frame)


def documented(command: str) -> set[str]:
    row = re.search(rf"^\| .*`{command}` \|(.*)\|$", DOCUMENT.read_text(), re.MULTILINE)
    assert row is not None
    return set(re.findall(r"`([a-z_]+)`", row[1]))


@pytest.mark.parametrize("name", WRITES_JSON)
def test_json_ends_with_an_object_with_the_documented_keys(run: Run, name: str) -> None:
    status, out, errors = run(name, *WRITES_JSON[name], "--json")
    assert status == 0, errors
    *frames, last = out.splitlines()
    assert bool(frames) == (name == "live")
    found = json.loads(last)
    assert set(found) >= COMMON
    assert set(found) - COMMON <= documented(name)
    assert (found["command"], found["status"], found["error"]) == (name, 0, None)
    assert all(Path(path).exists() for path in found["outputs"])
    assert all(re.fullmatch(OWN_NAMES, path.name) for path in Path().glob("shown/*"))
    seconds = found["seconds"]
    total, processor = seconds.pop("total"), seconds.pop("processor")
    assert processor > 0
    assert sum(seconds.values()) == pytest.approx(total, abs=0.01)
    assert min(seconds.values()) >= 0


def test_json_has_the_notes_of_photographs(run: Run) -> None:
    left = np.asarray(cv2.imread("left.png"))
    turned = Image.fromarray(np.rot90(left)[..., ::-1])
    exif = Image.Exif()
    exif[0x0112] = 6
    turned.save("turned.png", exif=exif)
    twice = "left.png: the same picture as left.png"
    upright = "turned.png: turned upright by its EXIF orientation"
    assert json.loads(run("register", "left.png", "left.png", "--json")[1])["notes"] == [twice]
    for photographs, keys in ((("turned.png", "right.png"), ("pair",)), (("turned.png", "right.png", "left.png"), ())):
        status, out, errors = run("mosaic", *photographs, "-o", "m.png", "--json", "--overwrite")
        assert status == 0, errors
        found = json.loads(out)
        for numbers in (found, *(found[key] for key in keys)):
            assert upright in numbers["notes"]


def test_results_go_to_stdout_and_failures_are_objects_too(run: Run) -> None:
    status, out, errors = run("register", "left.png", "absent.png", "--json")
    found = json.loads(out)
    assert status == found["status"] == 2
    assert only_error(errors) == f"error: {found['error']}"
    _, out, errors = run("register", "left.png", "right.png")
    assert b"inliers" in out
    assert out.count(b"e+0") + out.count(b"e-0") == 9
    assert errors.splitlines()[0] == "registering"
    assert "inliers" not in errors


@pytest.mark.parametrize(
    ("words", "lines"),
    [
        (
            ("mosaic", "left.png", "right.png", "left.png", "-o", "m.png", "--report", "shown"),
            (r"mosaic m\.png \(\d+x\d+\), \d photographs of 3", "linked pairs: median .*", "report shown.index.html"),
        ),
        (("check", "left.png", "right.png"), ("linked pairs: median .*", "complete: the photographs make one mosaic")),
        (("live", "film.mkv", "-o", "m.png"), (r"mosaic m\.png \(\d+x\d+\): 2 frames, 0 left out",)),
    ],
    ids=["mosaic", "check", "live"],
)
def test_results_are_said_and_only_a_failure_is_an_error(
    run: Run, words: tuple[str, ...], lines: tuple[str, ...]
) -> None:
    status, out, errors = run(*words)
    assert status == 0
    for line in lines:
        assert re.search(rf"^{line}$", out.decode(), re.MULTILINE), out.decode()
    assert "error: " not in errors + out.decode()


def test_quiet_prints_results_only_and_verbose_versions(run: Run) -> None:
    loud = run("register", "left.png", "right.png")
    for words in (("-q", "register", "left.png", "right.png"), ("register", "left.png", "right.png", "--quiet")):
        assert run(*words) == (0, loud[1], "")
    _, _, errors = run("fuzzy", "ransac", "-v")
    assert re.match(r"skymosaic \S+, Python 3\.", errors)


def test_a_picture_on_stdout_is_nothing_but_the_picture(run: Run) -> None:
    status, out, errors = run("mosaic", "left.png", "right.png", "-o", "-")
    assert status == 0
    assert cv2.imdecode(np.frombuffer(out, np.uint8), cv2.IMREAD_COLOR) is not None
    assert out.endswith(b"IEND\xaeB`\x82")
    assert "mosaic -" in errors
    assert "--json" in only_error(run("mosaic", "left.png", "right.png", "-o", "-", "--json")[2])


@pytest.mark.parametrize("words", [("mosaic", "left.png", "right.png", "flat.png"), ("live", "cloud.mkv")])
def test_a_photograph_left_out_is_a_warning_and_with_strict_an_error(run: Run, words: tuple[str, ...]) -> None:
    flat = np.full((240, 320, 3), 90, np.uint8)
    cv2.imwrite("flat.png", flat)
    left, right = (np.asarray(cv2.imread(f"{name}.png")) for name in ("left", "right"))
    film(Path("cloud.mkv"), left, flat, right)
    status, out, errors = run(*words, "-o", "m.png", "--json")
    assert status == 0, errors
    (warning,) = json.loads(out.splitlines()[-1])["warnings"]
    assert f"warning: {warning}" in errors
    status, _, errors = run(*words, "-o", "strict.png", "--strict")
    assert status == 3
    assert "1 left out" in only_error(errors)
    assert not Path("strict.png").exists()


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("register", "left.png"), "Missing argument"),
        (("mosaic", "left.png", "right.png"), "--output"),
        (("register", "left.png", "right.png", "--sed", "1"), "--seed"),
        (("paint",), "paint"),
    ],
)
def test_a_wrong_command_line_is_one_line_that_names_the_help(run: Run, words: tuple[str, ...], says: str) -> None:
    status, out, errors = run(*words)
    assert (status, out, errors.count("\n")) == (2, b"", 1)
    assert says in only_error(errors)
    assert errors.rstrip().endswith("--help")


def test_version_and_choices(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    assert re.fullmatch(rb"skymosaic \d+\.\d+\.\d+\S*\n", run("--version")[1])
    monkeypatch.setenv("COLUMNS", "300")
    shown = run("mosaic", "--help")[1].decode()
    for choices in ("aerial|thesis", "golden|rtl", "refuse|keep", "average|distance|multiband", "fast|normal|thorough"):
        assert choices in shown
