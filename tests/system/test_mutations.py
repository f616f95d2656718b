"""The tests themselves on trial: each of these one-line faults has to make one fail."""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]

MUTATIONS = {
    "k of Harris": (
        "golden_model/pixel/harris.py", "k_numerator / (1 << k_shift)", "(k_numerator + 1) / (1 << k_shift)",
        "tests/golden_model/pixel/test_harris.py::test_response_follows_corner_harris",
    ),
    "rule of ties": (
        "golden_model/pixel/nms.py", "code >= largest_after", "code > largest_after",
        "tests/golden_model/pixel/test_pixel.py",
    ),
    "radius of a ring": (
        "golden_model/feature/ilbp.py", "(0, 2, 4, 6, 9, 12, 15)", "(0, 2, 4, 6, 9, 12, 14)",
        "tests/golden_model/feature/test_ilbp.py",
    ),
    "one feature more a cell": (
        "golden_model/selection/selection.py", "rank < per_cell", "rank <= per_cell",
        "tests/golden_model/test_front_end.py::test_cells_keep_their_best_in_the_order_of_emission",
    ),
    "second best of the columns": (
        "golden_model/matching/hamming.py",
        "np.minimum(others.min(axis=1)[left]",
        "np.maximum(others.min(axis=1)[left]",
        "tests/golden_model/matching/test_hamming.py",
    ),
    "rounding of the smoothing": (
        "hdl/pixel/smooth.py", "(1 << shift >> 1)", "(1 << shift >> 2)",
        "tests/hdl/pixel/test_rows.py",
    ),
    "shift of Harris": (
        "hdl/pixel/harris.py", "scaled >> self.k_shift)", "scaled >> self.k_shift + 1)",
        "tests/hdl/pixel/test_rows.py",
    ),
    "equal pixels in a descriptor": (
        "hdl/feature/ilbp.py", "rings[a][n] >= rings[b]", "rings[a][n] > rings[b]",
        "tests/hdl/feature/test_rows.py",
    ),
    "border": (
        "hdl/selection/level_scan.py", "(x >= first_px - n,", "(x > first_px - n,",
        "tests/hdl/selection/test_level_scan.py",
    ),
    "rounding of the sub-pixel position": (
        "hdl/feature/subpixel.py", "POSITION.fraction_bits) + total, total)", "POSITION.fraction_bits), total)",
        "tests/hdl/feature/test_subpixel.py",
    ),
    "ties of the nearest": (
        "hdl/matching/hamming.py", "(distance < row.best)", "(distance <= row.best)",
        "tests/hdl/matching/test_nearest_neighbours.py",
    ),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("fault", MUTATIONS)
def test_a_planted_fault_fails_a_test(tmp_path: Path, fault: Any) -> None:
    file, line, faulty, test = MUTATIONS[fault]
    shutil.copytree(ROOT, tmp_path, dirs_exist_ok=True, ignore=shutil.ignore_patterns(".*", "docs", "demo", "build"))
    path = tmp_path / file
    source = path.read_text(encoding="utf-8")
    assert source.count(line) == 1
    path.write_text(source.replace(line, faulty), encoding="utf-8")
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "-n", "0", test]
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    # 1: a test failed; anything else would be a faulty trial.
    assert done.returncode == 1, done.stdout
