"""The whole accelerator on whole photographs, as the commands use it: pixels in, matches out, equal to the model."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from sim.scene import make_pair
from skymosaic.cli.commands import app
from skymosaic.imagery import images

WIDTH_PX, HEIGHT_PX = 448, 336


@pytest.fixture(scope="module")
def photographs(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    folder = tmp_path_factory.mktemp("pair")
    paths = str(folder / "left.png"), str(folder / "right.png")
    for path, image in zip(paths, make_pair(seed=1, size=(WIDTH_PX, HEIGHT_PX)).images, strict=True):
        images.save(Path(path), image)
    return paths


def run(*arguments: str) -> str:
    """What a command prints on standard output."""
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.stderr
    return result.stdout


@pytest.mark.parametrize(
    ("backend", "preset"),
    [
        ("rtl", "aerial"),
        # A build of its own. In `make test` cocotb's benches have the thesis's descriptor.
        pytest.param("rtl", "thesis", marks=pytest.mark.slow),
    ],
)
def test_compare_finds_every_field_equal(photographs: tuple[str, str], backend: str, preset: str) -> None:
    found = json.loads(run("compare", *photographs, "--backend", backend, "--preset", preset, "--json"))
    assert {"reading", "golden model", "building", "simulating", "comparing"} <= found["seconds"].keys()
    assert found["equal"], found["mismatch"]
    assert found["notes"] == []
    # Without selection by cells the clocks are not predicted.
    predicted = [13 + WIDTH_PX * HEIGHT_PX] * 2 if preset == "aerial" else []
    assert [frame["features_end"] - frame["first_pixel"] + 1 for frame in found["timelines"]] == predicted
    assert found["cycles_per_frame"] == predicted or preset == "thesis"


@pytest.mark.slow
def test_the_chip_estimates_what_the_golden_model_does(photographs: tuple[str, str]) -> None:
    found = json.loads(run("compare", *photographs, "--homography", "--json"))
    assert found["equal"], found["mismatch"]
    assert found["homographies"] == 2
    assert 0 < found["timelines"][1]["homography_end"] - found["timelines"][1]["matches_end"] <= 300_000
    options = ("register", *photographs, "--estimator", "fabric", "--json")
    golden, simulated = (json.loads(run(*options, "--backend", backend)) for backend in ("golden", "rtl"))
    assert golden["accepted"]
    assert golden["homography"] == simulated["homography"]


def test_the_mosaic_is_the_same_byte_for_byte(photographs: tuple[str, str], tmp_path: Path) -> None:
    mosaics = {name: tmp_path / f"{name}.png" for name in ("golden", "rtl")}
    for backend, path in mosaics.items():
        run("mosaic", *photographs, "-o", str(path), "--backend", backend)
    assert mosaics["golden"].read_bytes() == mosaics["rtl"].read_bytes()
