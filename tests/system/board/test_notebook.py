"""The notebook of the export, executed as it is by a Jupyter kernel on the simulated accelerator, and its page."""

import base64
import dataclasses
import re
from typing import Any

import cv2
import nbformat
import numpy as np
import pytest

from golden_model.config import PRESETS, EstimatorConfig
from sim.scene import make_pair
from skymosaic.features.backends import load_backend
from skymosaic.geometry.fabric import homography_in_pixels
from tests.system.board import notebook
from tests.system.board.pynq_package import NEWEST, OLDER

SIZE_PX = (160, 120)
SOURCES = [cell.source for cell in nbformat.read(notebook.NOTEBOOK, as_version=4).cells]


@pytest.mark.needs("pynq")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of Jupyter's own packages
@pytest.mark.parametrize("version", [NEWEST, *(pytest.param(older, marks=pytest.mark.slow) for older in OLDER)])
def test_the_notebook_runs_and_gives_what_the_golden_model_gives(version: str) -> None:
    made = notebook.run_notebook(SIZE_PX, version)
    assert [cell.source for cell in made.cells] == SOURCES
    outputs = [output for cell in made.cells for output in cell.get("outputs", [])]
    printed = "".join(output.text for output in outputs if output.output_type == "stream")
    images = [np.ascontiguousarray(image[..., 1]) for image in make_pair(seed=9, size=SIZE_PX).images]
    left, right = load_backend("golden").run(images, PRESETS["aerial"])
    assert f"left: {len(left.features)} features, {SIZE_PX[0] * SIZE_PX[1]} clocks" in printed
    assert f"right: {len(right.features)} features" in printed
    kept = np.count_nonzero(right.matches["verdict"])
    assert f"{len(right.matches)} mutual matches, {kept} kept" in printed
    drawn = [base64.b64decode(output.data["image/png"]) for output in outputs if "image/png" in output.get("data", {})]
    assert len(drawn) == 3
    decoded = [cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR) for png in drawn]
    assert all(picture is not None and np.ptp(picture) > 100 for picture in decoded)


def test_the_page_in_docs_has_every_cell_and_its_pictures() -> None:
    text = notebook.PAGE.read_text()
    for source in SOURCES:
        # The title stands above the note on the page.
        assert source.removeprefix("# skymosaic on the board\n").strip() in text, (
            "run: python -m tests.system.board.notebook"
        )
    drawn = re.findall(r"\]\((\S+\.webp)\)", text)
    assert len(drawn) == 3
    assert all((notebook.PAGE.parent / picture).is_file() for picture in drawn)
    assert "not yet run on a board" in text


def test_the_notebook_shows_the_homography_in_pixels(capsys: pytest.CaptureFixture[str]) -> None:
    config = dataclasses.replace(PRESETS["aerial"], estimator=EstimatorConfig(passes=2))
    second = load_backend("golden").run(make_pair(seed=9, size=SIZE_PX).images, config)[1]
    (source,) = [source for source in SOURCES if "second.homography" in source]
    names: dict[str, Any] = {"second": second, "np": np}
    exec(source, names)
    assert second.homography is not None
    expected = homography_in_pixels(second.homography)
    assert expected is not None
    np.testing.assert_allclose(names["homography"], expected)
    assert f"{second.homography['inliers']} inliers, causes 0\n" in capsys.readouterr().out
